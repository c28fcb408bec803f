"""The page that says what every sensor reports, made from the fields that the spaces are made from.

`python -m smarts.sensors.documentation` writes it.
"""

from __future__ import annotations

import dataclasses
import inspect
import math
from pathlib import Path

import numpy as np

from smarts.agents.interface import SENSOR_OPTIONS, AgentInterface
from smarts.agents.sensors import ALWAYS_ON, SENSORS
from smarts.agents.types import AgentType
from smarts.sensors.bounds import MOST
from smarts.types.interface import Field

PAGE = Path(__file__).parents[2] / "docs" / "guide" / "sensors.md"

_OPENING = """# Sensors

Written by `python -m smarts.sensors.documentation` from the fields that buffers and spaces are made of.

`AgentInterface` switches sensors on: `AgentInterface(waypoint_paths=True, top_down_rgb=RGB(64, 64, 1.0))`.
Arrays come in one block for all agents with the same options, shape (simulations, agents, *shape). Positions
are in the map frame, x east, y north; headings are counter-clockwise from +x. What lies beyond the bounds is
clipped; what is not there is 0, and a count says how much is there. `HiWayEnv` makes objects with the names
of the original out of these arrays when they are first read: each sensor is an attribute of `Observation`
(`smarts/sensors/observation.py`), whose type its section names.

Another sensor is one file and one line: a class as `smarts/sensors/protocol.py` describes it, and its name in
`SENSORS` (`smarts/agents/sensors.py`). `AgentInterface(my_sensor=True)` switches it on with its defaults,
`AgentInterface(my_sensor=MySensor(reach=30.0))` with options of its own. It is then an attribute of
`Observation`, an array of the observation `raw`, and a section of this page.
"""


def sensors_page() -> str:
    """Return the page as Markdown."""
    parts = [_OPENING, "## Agent types\n", _agent_types()]
    for name in SENSORS:
        sensor = SENSORS[name]()
        parts += [f"\n## {name}\n", f"{_first_paragraph(type(sensor))}\n", _options(name)]
        kind = inspect.signature(sensor.as_object).return_annotation
        parts += [f"Attribute of `Observation`: `{kind}`.\n"]
        parts += ["| field | shape | type | bounds | unit | meaning |", "|---|---|---|---|---|---|"]
        parts += [_row(field) for field in sensor.fields()]
    return "\n".join(parts) + "\n"


def _agent_types() -> str:
    rows = ["| type | acts by | sensors |", "|---|---|---|"]
    for kind in AgentType:
        interface = AgentInterface.from_type(kind)
        action = interface.action.name if interface.action is not None else ""
        rows.append(f"| {kind.name} | {action} | {', '.join(interface.sensors)} |")
    return "\n".join(rows) + "\n\nEvery agent also has ego_vehicle_state, mission and via_data."


def _first_paragraph(kind: type) -> str:
    return " ".join((kind.__doc__ or "").split("\n\n")[0].split())


def _options(name: str) -> str:
    if name in ALWAYS_ON:
        return "Always on.\n"
    if name not in SENSOR_OPTIONS:
        return f"Option: `True` or `{SENSORS[name].__name__}(...)`.\n"
    option = SENSOR_OPTIONS[name]
    defaults = ", ".join(
        f"{field.name}={_default(getattr(option(), field.name))}" for field in dataclasses.fields(option)
    )
    return f"Option: `{option.__name__}({defaults})`; the shapes are those of the defaults.\n"


def _default(value: object) -> str:
    return "BasicLidar" if dataclasses.is_dataclass(value) else repr(value)


def _row(field: Field) -> str:
    bounds = f"{_number(field.low)} .. {_number(field.high)}"
    shape = "x".join(map(str, field.shape)) or "scalar"
    kind = np.dtype(field.dtype).name
    return f"| {field.name} | {shape} | {kind} | {bounds} | {field.unit} | {field.meaning} |"


def _number(value: float) -> str:
    if math.isclose(abs(value), math.pi):
        return "pi" if value > 0 else "-pi"
    return "2^31 - 1" if value == MOST else f"{value:g}"


if __name__ == "__main__":
    PAGE.write_text(sensors_page())
