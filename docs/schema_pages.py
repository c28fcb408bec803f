"""Pages of the reference that are made from the schemas of the program: sensors and recorded episodes."""

from __future__ import annotations

import dataclasses
import inspect
import math
from collections.abc import Iterator

import numpy as np

from smarts.agents.interface import SENSOR_OPTIONS, AgentInterface
from smarts.agents.sensors import ALWAYS_ON, SENSORS
from smarts.agents.types import AgentType
from smarts.sensors.bounds import MOST
from smarts.types.episode_schema import TABLES, VERSION
from smarts.types.interface import Field


def sensors() -> Iterator[str]:
    """Yield the parts of the page on sensors, from the fields that buffers and spaces are made of."""
    yield "## Agent types"
    yield "\n".join(_agent_types())
    yield "Every agent also has `ego_vehicle_state`, `mission` and `via_data`."
    for name in SENSORS:
        sensor = SENSORS[name]()
        kind = inspect.signature(sensor.as_object).return_annotation
        yield f"## {name}"
        yield _first_paragraph(type(sensor))
        yield f"{_options(name)} Attribute of `Observation`: `{kind}`."
        yield "\n".join(map(_field, sensor.fields()))


def episodes() -> Iterator[str]:
    """Yield the parts of the page on recorded episodes, from the schema that writer and reader use."""
    yield f"Format {VERSION}. [How to record and read episodes](../guide/episodes.md)."
    for table in TABLES:
        yield f"## {table.name}"
        yield f"{table.meaning[0].upper()}{table.meaning[1:]}{', if any' if table.is_optional else ''}."
        yield "\n".join(
            f"- `{each.name}` ({each.kind}{f', {each.unit}' * bool(each.unit)}){': ' * bool(each.meaning)}"
            f"{each.meaning}"
            for each in table.columns
        )


def _agent_types() -> Iterator[str]:
    yield "| type | acts by | sensors |\n|---|---|---|"
    for kind in AgentType:
        interface = AgentInterface.from_type(kind)
        action = interface.action.name if interface.action is not None else ""
        yield f"| {kind.name} | {action} | {', '.join(interface.sensors)} |"


def _first_paragraph(kind: type) -> str:
    return " ".join((kind.__doc__ or "").split("\n\n")[0].split())


def _options(name: str) -> str:
    if name in ALWAYS_ON:
        return "Always on."
    if name not in SENSOR_OPTIONS:
        return f"Option: `True` or `{SENSORS[name].__name__}(...)`."
    option = SENSOR_OPTIONS[name]
    defaults = ", ".join(
        f"{field.name}={_default(getattr(option(), field.name))}" for field in dataclasses.fields(option)
    )
    return f"Option: `{option.__name__}({defaults})`; the shapes are those of the defaults."


def _default(value: object) -> str:
    return "BasicLidar" if dataclasses.is_dataclass(value) else repr(value)


def _field(field: Field) -> str:
    shape = "x".join(map(str, field.shape)) or "scalar"
    bounds = f"{_number(field.low)} .. {_number(field.high)} {field.unit}".strip()
    meaning = f": {field.meaning}" if field.meaning else ""
    return f"- `{field.name}` ({shape}, {np.dtype(field.dtype).name}, {bounds}){meaning}"


def _number(value: float) -> str:
    if math.isclose(abs(value), math.pi):
        return "pi" if value > 0 else "-pi"
    return "2^31 - 1" if value == MOST else f"{value:g}"
