"""The page on the vocabulary of scenario files, made from the docstrings of its types.

`python -m smarts.sstudio.documentation` writes it.
"""

from __future__ import annotations

import ast
import dataclasses
import enum
import inspect
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

from smarts.sstudio import types as t

PAGE = Path(__file__).parents[2] / "docs" / "scenario_language.md"

SUBJECTS = {
    "The scenario": (t.Scenario, t.Variation, t.StartVariation, t.ScenarioMetadata),
    "Missions": (t.Mission, t.EndlessMission, t.LapMission, t.GroupedLapMission, t.Via, t.UTurn, t.CutIn),
    "How agents enter": (t.EntryTactic, t.TrapEntryTactic, t.IdEntryTactic),
    "Routes": (t.Route, t.RandomRoute, t.JunctionEdgeIDResolver),
    "Traffic": (
        *(t.Traffic, t.Flow, t.Trip, t.Stop, t.TrafficActor, t.LaneChangingModel, t.JunctionModel),
        *(t.Distribution, t.TruncatedDistribution, t.UniformDistribution),
    ),
    "Areas": (t.MapZone, t.PositionalZone, t.ConfigurableZone, t.RoadSurfacePatch),
    "Conditions": (
        *(t.LiteralCondition, t.TimeWindowCondition, t.VehicleSpeedCondition, t.VehicleTypeCondition),
        *(t.OffRoadCondition, t.DependeeActorCondition, t.SubjectCondition),
        *(t.NegatedCondition, t.CompoundCondition, t.ConditionTrigger, t.ExpireTrigger),
    ),
    "Maps": (t.MapSpec,),
}
"""What the page tells, in its order."""

NOT_IN_USE = (
    *(t.Bubble, t.BubbleLimits, t.SocialAgentActor, t.BoidAgentActor, t.TrafficEngineActor),
    t.TrafficHistoryDataset,
)
"""Types that scenario files may use and that have no effect yet."""

_OPENING = """# The language of scenarios

Written by `python -m smarts.sstudio.documentation` from the types' docstrings.

A scenario is a folder with a map and a `scenario.py`:

```text
my_scenario/
    map.net.xml     SUMO's, or its sources (map.nod.xml, map.edg.xml, map.con.xml);
                    or map.xodr (OpenDRIVE), or map.osm (OpenStreetMap)
    scenario.py
```

`from smarts.sstudio import gen_scenario, types as t` brings the vocabulary; `gen_scenario(t.Scenario(...),
output_dir=Path(__file__).parent)` ends the file. A part of the map is told by an edge's id, a lane's index
(0 is the rightmost) and an offset in metres along it: `("south_in", 0, 40)`. `smarts-bench scenario build
my_scenario` says what is wrong with it, with names that are on the map, `smarts-bench scenario show
my_scenario --out map.png` draws it, and any environment takes its folder: `scenarios=["my_scenario"]`. A
whole one with two agents, one of which takes over a vehicle from the traffic if one comes within ten seconds,
on the map of the suite's intersection:

```python title="my_scenario/scenario.py"
from pathlib import Path

from smarts.sstudio import gen_scenario
from smarts.sstudio import types as t

cars = t.Flow(
    route=t.Route(begin=("south_in", 0, 10), end=("west_out", 0, "max")),
    rate=600,
    actors={t.TrafficActor("car", speed=t.Distribution(mean=1.0, sigma=0.2)): 1.0},
)
turn_left = t.Mission(
    t.Route(begin=("south_in", 1, 40), end=("west_out", 0, 60)),
    via=[t.Via("west_out", 0, 30, required_speed=8)],
)
take_over = t.Mission(
    t.Route(begin=("south_in", 0, 40), end=("west_out", 0, 60)),
    entry_tactic=t.TrapEntryTactic(wait_to_hijack_limit_s=10),
)
gen_scenario(
    t.Scenario(
        traffic={"busy": t.Traffic(flows=[cars], warm_up=20)},
        ego_missions=[turn_left, take_over],
        start_variation=t.StartVariation(offset=5, speed=(0, 8)),
    ),
    output_dir=Path(__file__).parent,
)
```

```python
import shutil
from pathlib import Path

from smarts.sstudio import build_scenario

for source in Path(build_scenario("intersection").source).glob("map.*.xml"):
    shutil.copy(source, "my_scenario")
```

```console
$ smarts-bench scenario build my_scenario
```

```text title="Output"
my_scenario: ... edges, ... lanes, traffic busy; ...
  .../my_scenario/build/...
```

Names and defaults of fields are the original's; a field that is new, or means something else here, says so.
"""


_ON_MAPS = """### What is left out of maps, or built again

Such changes are warnings of the logger `smarts`, whenever a scenario is built or found built.

- OpenDRIVE: connections of roads that do not exist and signals without a type are left out. So are the
  connections of direct junctions; netconvert guesses how lanes connect there. Other errors of netconvert,
  which runs with `ignore-errors`, leave out what they name. Left-hand traffic is refused.
- `.net.xml`: connections from or to lanes that do not exist are left out. Such a network, and one whose
  junctions have no lanes inside, is built again by netconvert: edges and lanes keep their ids, and roads end
  a little earlier where a junction gets lanes.
- OpenStreetMap: roads are those of SUMO's type map. Race tracks (`highway=raceway`, two lanes each way and
  79 km/h unless tagged otherwise) and roads of unknown class (`highway=road`) are open to cars as well.
  Service roads, tracks, fords and paths stay closed to cars and are not on the map; busways are for buses.
  The option `type-files` in `map.netccfg` beside the map names a table of types of your own, for example one
  with service roads. Roads that connect to no other are removed.
"""

_ORIGINAL = """## Scenario files of the original

Of the 57 files `scenario.py` in the original's folder `scenarios`, 26 play as they are written, 16 with
a warning that says what is missing, and 15 do not play. `python -m perf.scenario_files
path/to/SMARTS/scenarios` builds and resets each, and prints the table of all.

| files | how many | what happens | why |
|---|---|---|---|
| `sumo/*` but those below, `open_drive/od_4lane` | 26 | play as written | |
| `sumo/intersections/2lane_circle`, `4lane_t`, `6lane`, `sumo/loop`, `sumo/minicity`, \
`sumo/straight/3lane_bubble`, `sumo/tests/multi_agents_loop`, `sumo/zoo_intersection` | 8 | play without \
their social agents and bubbles | these have no effect so far |
| `sumo/straight/3lane_cut_in_agents_1`, `cutin_2lane_agents_1` | 2 | SUMO drives their traffic | there is \
no engine `SMARTS` so far |
| `open_drive/od_newmarket` | 1 | plays without 3 connections of its map | they name roads that do not exist |
| `NGSIM/*` (4), `INTERACTION/merging` | 5 | play without their recorded traffic | recorded traffic has no \
effect so far; the lanes inside the junctions of `merging` are built |
| `argoverse/*` (13), `waymo` | 14 | refused | their maps and traffic are data sets that cannot be read, and \
are not in the folder |
| `open_drive/od_merge` | 1 | refused | it names edges as the original's reader of OpenDRIVE does (`1_0_R`: \
road, section, side), not as netconvert (`-1#0`) |
""".replace("\\\n", "")


def language_page() -> str:
    """Return the page as Markdown."""
    parts = [_OPENING]
    for subject, kinds in SUBJECTS.items():
        parts.append(f"## {subject}\n")
        parts += [_section(kind) for kind in kinds]
    parts.append(_ON_MAPS)
    names = ", ".join(f"`{kind.__name__}`" for kind in NOT_IN_USE)
    text = f"Scenario files may use them; they have no effect but a warning: {names}."
    parts.append(f"## Without effect so far\n\n{text}\n")
    parts.append(_ORIGINAL)
    return "\n".join(parts)


def _section(kind: type) -> str:
    text = inspect.cleandoc(kind.__doc__ or "")
    rows = [_row(name, default, meaning) for name, default, meaning in _fields(kind)]
    table = ["| field | default | meaning |", "|---|---|---|", *rows, ""] if rows else []
    return "\n".join([f"### {kind.__name__}\n", f"{text}\n", *table])


def _fields(kind: type) -> Iterator[tuple[str, str, str]]:
    """Yield name, default and meaning of the fields that a user gives."""
    meanings = {name: text for each in reversed(kind.__mro__) for name, text in _attribute_docstrings(each)}
    for field in dataclasses.fields(kind) if dataclasses.is_dataclass(kind) else ():
        if field.init and not field.name.startswith("_"):
            yield field.name, _default(field), meanings.get(field.name, "")


def _default(field: dataclasses.Field[Any]) -> str:
    if field.default is not dataclasses.MISSING:
        return "" if field.default is t.MISSING else f"`{_shown(field.default)}`"
    return "required" if field.default_factory is dataclasses.MISSING else "its own"


def _shown(default: Any) -> str:
    if isinstance(default, enum.Enum):
        return default.name or ""
    if not dataclasses.is_dataclass(default):
        return repr(default)
    names = [field.name for field in dataclasses.fields(default) if field.init]
    values = ", ".join(f"{name}={_shown(getattr(default, name))}" for name in names)
    return f"{type(default).__name__}({values})"


def _attribute_docstrings(kind: type) -> Iterator[tuple[str, str]]:
    """Yield the fields of a class with the texts below them."""
    if not dataclasses.is_dataclass(kind):
        return
    (body,) = ast.parse(inspect.cleandoc(inspect.getsource(kind))).body
    statements = body.body if isinstance(body, ast.ClassDef) else []
    for field, text in pairwise(statements):
        if isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name):
            said = text.value if isinstance(text, ast.Expr) else None
            if isinstance(said, ast.Constant) and isinstance(said.value, str):
                yield field.target.id, " ".join(said.value.split())


def _row(name: str, default: str, meaning: str) -> str:
    cells = (cell.replace("|", "\\|") for cell in (name, default, meaning))
    return f"| {' | '.join(cells)} |"


if __name__ == "__main__":
    PAGE.write_text(language_page())
