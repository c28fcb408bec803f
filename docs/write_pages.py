"""Writes what pages repeat from the code: `make pages`.

- `docs/api/`: the reference, from signatures, docstrings and schemas.
- Blocks with `title="examples/..."`: that file.
- `examples/tour.ipynb`: the tour as a notebook.
"""

from __future__ import annotations

import functools
import json
import os
import re
from collections.abc import Iterator
from pathlib import Path

import griffe

from docs import schema_pages

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
EXAMPLE = re.compile(r'(```\w+ title="(examples/[^"]+)"\n).*?(^```$)', re.DOTALL | re.MULTILINE)
TOUR, NOTEBOOK = ROOT / "docs" / "guide" / "tour.md", ROOT / "examples" / "tour.ipynb"
FENCE = re.compile(r"^```(\w+)[^\n]*\n(.*?)^```$", re.DOTALL | re.MULTILINE)
LINK = re.compile(r"\]\((?!http)([^)]+)\)")
PICTURE = re.compile(r"--out (\S+\.(?:png|gif))")
MADE = "<!-- Made by `make pages` from the code: change that. -->"
TYPES = {
    "Scenario": "Scenario Variation StartVariation ScenarioMetadata MapSpec",
    "Missions": "Mission EndlessMission LapMission GroupedLapMission DrawnMission Via UTurn CutIn",
    "How agents enter": "EntryTactic TrapEntryTactic IdEntryTactic",
    "Routes": "Route RandomRoute JunctionEdgeIDResolver",
    "Traffic": "Traffic Flow Trip Stop Recording TrafficActor LaneChangingModel JunctionModel Distribution "
    "TruncatedDistribution UniformDistribution",
    "Bubbles": "Bubble BubbleLimits SocialAgentActor BoidAgentActor TrafficEngineActor",
    "Areas": "MapZone PositionalZone ConfigurableZone RoadSurfacePatch",
    "Conditions": "LiteralCondition TimeWindowCondition VehicleSpeedCondition VehicleTypeCondition "
    "OffRoadCondition DependeeActorCondition SubjectCondition NegatedCondition CompoundCondition "
    "ConditionTrigger ExpireTrigger",
}
"""Types of the scenario language, by section."""
STATE = {
    "smarts.types.vehicles": "VehicleStates",
    "smarts.types.agent_states": "AgentStates",
    "smarts.types.actions": "Actions Commands",
    "smarts.roads.arrays": "Roads",
}
"""Arrays that sensors, features, controllers, metrics and traffic engines read and write."""
REFERENCE = {
    "env": (
        "Environments",
        "`smarts.env`: the simulation as Gymnasium, PettingZoo, RLlib, PyMARL and arrays. Observations and "
        "rewards: [adapters](../guide/adapters.md).",
        {"smarts.env": "", "smarts.env.settings": "EnvSettings"},
    ),
    "agents": (
        "Agents",
        "`smarts.agents`: what agents observe and do (`AgentInterface`), their policies, both (`AgentSpec`).",
        {"smarts.agents": ""},
    ),
    "sstudio": (
        "Scenarios",
        "`smarts.sstudio`: build scenarios. Types of scenario files: [their reference](scenario_types.md).",
        {"smarts.sstudio": ""},
    ),
    "scenario_types": (
        "Types of scenario files",
        "`smarts.sstudio.types`, with an example: [the scenario language](../guide/scenario_language.md).",
        {"smarts.sstudio.types": TYPES},
    ),
    "algorithms": (
        "Algorithms",
        "`algorithms`: the library. Each algorithm: [algorithms](../guide/algorithms.md).",
        {"algorithms": ""},
    ),
    "benchmark": (
        "Benchmark",
        "`benchmark`: experiments and trained policies. [Keys of a file](../guide/experiments.md).",
        {"benchmark": ""},
    ),
    "metrics": (
        "Metrics",
        "`benchmark.metrics`: from recorded episodes to numbers. [Definitions](../guide/metrics.md).",
        {"benchmark.metrics": ""},
    ),
    "state": (
        "State",
        "The arrays that parts read and write, one row per vehicle or agent "
        "([the step](../develop/a_step.md) says which stage writes which). Letters: B simulations, V vehicle "
        "slots, A agents, L lanes of all maps, P points of their centrelines. `VehicleStates.lane` counts "
        "within a map: its row of `Roads` is `lane_base[map of the simulation] + lane`.",
        STATE,
    ),
}
"""Page -> title, first paragraph, and names by module (none: its `__all__`)."""


def texts() -> Iterator[tuple[Path, str]]:
    """Yield the pages and what they should be."""
    for name, (title, about, modules) in REFERENCE.items():
        parts = [f"# {title}", MADE, about]
        for module, names in modules.items():
            for section, members in (names if isinstance(names, dict) else {"": names}).items():
                parts += [f"## {section}"] * bool(section)
                for member in members.split() or map(str, _load(module).exports):
                    has_methods = bool(section) or not members
                    parts.append(_entry(_load(f"{module}.{member}"), member, 2 + bool(section), has_methods))
        yield ROOT / "docs" / "api" / f"{name}.md", "\n\n".join(parts) + "\n"
    for name, title, parts in (
        ("sensors", "Sensors", schema_pages.sensors()),
        ("episodes", "Tables of recorded episodes", schema_pages.episodes()),
    ):
        yield ROOT / "docs" / "api" / f"{name}.md", "\n\n".join([f"# {title}", MADE, *parts]) + "\n"
    for page in PAGES:
        text = page.read_text()
        if page.parent.name != "api":
            yield page, EXAMPLE.sub(lambda match: f"{match[1]}{_source(match[2])}{match[3]}", text)
    yield NOTEBOOK, _notebook()


def _notebook() -> str:
    """Return the tour as a notebook: its prose and code, and what its commands draw, without outputs."""
    page = re.sub(r"<!--.*?-->\n", "", TOUR.read_text())
    page = LINK.sub(lambda match: f"]({os.path.relpath(TOUR.parent / match[1], NOTEBOOK.parent)})", page)
    cells = [_cell("markdown", MADE.replace("from the code", "from docs/guide/tour.md"))]
    end = 0
    for block in FENCE.finditer(page):
        language, code = block.groups()
        cells.append(_cell("markdown", page[end : block.start()]))
        if language == "python":
            cells.append(_cell("code", code))
        elif language == "console":
            cells.append(_cell("code", "%%bash\n" + code.replace("$ ", "")))
            cells += [_cell("markdown", f"![{name}]({name})") for name in PICTURE.findall(code)]
        end = block.end()
    cells.append(_cell("markdown", page[end:]))
    kernel = {"kernelspec": {"display_name": "Python 3", "language": "python", "name": "python3"}}
    whole = {"cells": [cell for cell in cells if cell["source"]], "metadata": kernel}
    return json.dumps({**whole, "nbformat": 4, "nbformat_minor": 4}, indent=1, ensure_ascii=False) + "\n"


def _cell(kind: str, text: str) -> dict:
    code = {"execution_count": None, "outputs": []} if kind == "code" else {}
    return {"cell_type": kind, "metadata": {}, **code, "source": text.strip().splitlines(keepends=True)}


def _source(example: str) -> str:
    return (ROOT / example).read_text()


@functools.cache
def _loader() -> griffe.GriffeLoader:
    loader = griffe.GriffeLoader(search_paths=[ROOT], docstring_parser=griffe.Parser.google)
    for package in ("smarts_agent_kit", "smarts", "algorithms", "benchmark"):
        loader.load(package)
    loader.resolve_aliases(external=False)
    return loader


def _load(path: str) -> griffe.Object:
    return _loader().modules_collection[path]


def _entry(thing: griffe.Object, name: str, level: int, has_methods: bool) -> str:
    thing = thing.final_target if isinstance(thing, griffe.Alias) else thing
    text, arguments = _docstring(thing)
    fields = [*_fields(thing)] if thing.is_class and not arguments else []
    signature = "" if fields or not (thing.is_class or thing.is_function) else _signature(name, thing)
    parts = [f"{'#' * level} {name}", signature, text, "\n".join(arguments or fields)]
    if thing.is_class and has_methods:
        parts += [part for method in _methods(thing) for part in _method(method)]
    return "\n\n".join(part for part in parts if part)


def _docstring(thing: griffe.Object) -> tuple[str, list[str]]:
    """Return the first paragraph and one line per argument."""
    text, arguments = "", []
    for section in thing.docstring.parsed if thing.docstring else ():
        if section.kind is griffe.DocstringSectionKind.text and not text:
            text = _line(section.value.split("\n\n")[0])
        elif section.kind is griffe.DocstringSectionKind.parameters:
            arguments = [f"- `{each.name}`: {_line(each.description)}" for each in section.value]
    return text, arguments


def _line(text: str) -> str:
    return " ".join(text.split())


def _methods(thing: griffe.Class) -> list[griffe.Function]:
    return [
        each
        for each in thing.members.values()
        if each.is_function and each.docstring and not each.name.startswith("_")
    ]


def _method(method: griffe.Function) -> list[str]:
    text, arguments = _docstring(method)
    shown = str(method.signature()).replace("(self, ", "(").replace("(self)", "()").replace("(cls, ", "(")
    return [f"**`{shown.replace('(cls)', '()')}`**: {text}", "\n".join(arguments)]


def _fields(thing: griffe.Class) -> Iterator[str]:
    """Yield a line for each field or property of a class."""
    for each in _attributes(thing):
        is_field = "property" not in each.labels and each.annotation is not None
        shown = f"{each.name}: {each.annotation}{_default(each)}" if is_field else each.name
        text = _docstring(each)[0]
        if text or is_field:
            yield f"- `{shown}`" + (f": {text}" if text else "")


def _attributes(thing: griffe.Class) -> list[griffe.Attribute]:
    found = {each.name: each for base in reversed(thing.mro()) for each in _own_attributes(base)}
    return [*(found | {each.name: each for each in _own_attributes(thing)}).values()]


def _own_attributes(thing: griffe.Class) -> Iterator[griffe.Attribute]:
    for each in thing.members.values():
        if each.is_attribute and not each.name.startswith("_") and (each.annotation or each.docstring):
            yield each


def _default(attribute: griffe.Attribute) -> str:
    value = "" if attribute.value is None else str(attribute.value)
    return "" if not value or value.lower().startswith("field(") else f" = {value}"


def _signature(name: str, thing: griffe.Object) -> str:
    if thing.is_class:
        if "__init__" not in thing.members:
            return ""
        made = str(thing.members["__init__"].signature()).removeprefix("__init__")
        made = name + made.replace("(self, ", "(").replace("(self)", "()").removesuffix(" -> None")
    else:
        made = str(thing.signature())
    if len(made) > 88 and "(" in made:
        head, _, rest = made.partition("(")
        inside, _, end = rest.rpartition(")")
        made = f"{head}(\n    " + ",\n    ".join(_split(inside)) + f",\n){end}"
    return f"```text\n{made}\n```"


def _split(arguments: str) -> list[str]:
    """Split at the commas outside of brackets."""
    parts, depth = [""], 0
    for letter in arguments:
        depth += (letter in "([{") - (letter in ")]}")
        if letter == "," and not depth:
            parts.append("")
        else:
            parts[-1] += letter
    return [part.strip() for part in parts]


if __name__ == "__main__":
    for page, text in texts():
        if not page.exists() or page.read_text() != text:
            page.write_text(text)
            print(page.relative_to(ROOT))
