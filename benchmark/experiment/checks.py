"""What the models of experiment files cannot see: ranges of settings, adapters' options, scenarios' names.

The checks look at values as files give them. What does not fit the models is left to them.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from inspect import signature
from math import isfinite
from typing import Any

from algorithms.joint.ranges import COUNT
from algorithms.settings import OF_RUNNERS, settings
from algorithms.settings import values as setting_values
from benchmark.experiment.algorithm_settings import type_fault
from smarts.config import Fault
from smarts.errors import SmartsError, UnknownNameError, nearest_names
from smarts.types.seats import agent_names

Values = Mapping[str, Any]
DRAWS = ("uniform", "loguniform", "randint")
"""What a search may draw from: all with a lower and an upper bound, whole ones without the upper one."""


def check_experiment(values: Values) -> Iterator[Fault]:
    """Yield what is wrong with an experiment's values, beside what its model says."""
    yield from _settings(values)
    yield from _searched(values)
    yield from _adapter(_section(values, "environment"))
    yield from _scenarios(values)


def _settings(values: Values) -> Iterator[Fault]:
    known = settings()
    names = [name for name in _texts(values.get("algorithms")) if name in known]
    common, own = _section(values, "training"), _section(values, "settings")
    found: dict[tuple[str, ...], str] = {}
    for algorithm in names:
        mine = _section(own, algorithm)
        for name in known[algorithm]:
            section, key = (mine, ("settings", algorithm)) if name in mine else (common, ("training",))
            fault = _fault(algorithm, name, section[name], values) if name in section else None
            if fault:
                found[(*key, name)] = fault
    for key, text in found.items():
        yield Fault(key, text)
    every = {name for defaults in known.values() for name in defaults}
    used = {name for algorithm in names for name in known[algorithm]}
    for name in sorted((common.keys() & every) - used) if names else ():
        yield Fault(("training", name), f"none of the algorithms has {name}", "remove it")


def _fault(algorithm: str, name: str, value: Any, values: Values) -> str:
    """Return why an algorithm's setting cannot have a value, whose type is right; nothing if it can."""
    if name == "sharing":
        return _sharing_fault(value, _section(values, "environment").get("agents", 4))
    limits = COUNT if name in OF_RUNNERS else setting_values()[algorithm].get(name)
    fault = limits.fault(value) if limits else None
    return f"{value!r} is {fault}" if fault else ""


def _sharing_fault(sharing: Any, agents: Any) -> str:
    if isinstance(sharing, str):
        kinds = ("none", "all")
        return "" if sharing in kinds else f"{sharing!r} is neither 'none' nor 'all', nor groups of agents"
    if not isinstance(sharing, dict) or not isinstance(agents, int):
        return ""  # the model says so
    named = [agent for members in sharing.values() if isinstance(members, list) for agent in members]
    known = agent_names(agents)
    for agent in known:
        if named.count(agent) != 1:
            return f"{agent} is in {named.count(agent) or 'no'} groups, instead of in one"
    strange = [agent for agent in named if agent not in known]
    return f"there is no agent {strange[0]!r}, but {known[0]} to {known[-1]}" if strange else ""


def _searched(values: Values) -> Iterator[Fault]:
    known = settings()
    for algorithm in _texts(values.get("algorithms"))[:1]:
        for name, given in _section(_section(values, "tune"), "parameters").items():
            key = ("tune", "parameters", name)
            if algorithm not in known:
                continue
            if name not in known[algorithm]:
                yield Fault(key, f"{algorithm!r} has no such setting", nearest_names(name, known[algorithm]))
                continue
            for inner, value in _ends(given):
                if isinstance(value, Fault):
                    yield Fault((*key, *value.key), value.text, value.remedy)
                elif fault := type_fault(algorithm, name, value) or _fault(algorithm, name, value, values):
                    yield Fault((*key, *inner), fault)


def _ends(given: Any) -> Iterator[tuple[tuple[str | int, ...], Any]]:
    """Yield place and value of all that a search may choose from, of draws its two ends; or what is wrong."""
    if isinstance(given, list) and given:
        yield from (((number,), value) for number, value in enumerate(given))
        return
    (kind, bounds), *more = given.items() if isinstance(given, dict) and given else [("", None)]
    if kind not in DRAWS or more or not isinstance(bounds, list) or len(bounds) != 2:
        draws = ", ".join(f"{{{draw}: [low, high]}}" for draw in DRAWS)
        text = f"{given!r} is nothing to search in"
        yield (), Fault((), text, f"give a list of values, or one of {draws}")
        return
    wanted = int if kind == "randint" else int | float
    if not all(isinstance(bound, wanted) and not isinstance(bound, bool) for bound in bounds):
        yield (), Fault((kind,), f"{bounds!r} are no {'whole ' if wanted is int else ''}numbers")
        return
    low, high = bounds
    if not (low < high and isfinite(low) and isfinite(high)) or (kind == "loguniform" and low <= 0):
        least = "0 < low < high" if kind == "loguniform" else "low < high"
        yield (), Fault((kind,), f"{bounds!r} are no bounds", f"give [low, high] with {least}, both finite")
        return
    ends = (low, high - 1) if kind == "randint" else (float(low), float(high))
    yield from (((kind, number), value) for number, value in enumerate(ends))


def _adapter(environment: Values) -> Iterator[Fault]:
    name, options = environment.get("adapter", "benchmark"), _section(environment, "options")
    if not isinstance(name, str) or not environment.keys() & {"adapter", "options"}:
        return  # loading Gymnasium for the names of adapters takes a quarter of the time of all checks
    from smarts.env.adapters import ADAPTERS  # here: reports need no environments

    if name not in ADAPTERS:
        yield Fault(
            ("environment", "adapter"), f"there is no adapter {name!r}", nearest_names(name, ADAPTERS)
        )
        return
    if not options:
        return  # loading an adapter takes half a second
    known = [*signature(ADAPTERS[name]).parameters][2:]
    for option in sorted(options.keys() - set(known)):
        remedy = nearest_names(option, known)
        yield Fault(("environment", "options", option), f"adapter {name!r} has no such option", remedy)
    if "reward" in options and "reward" in known:
        from smarts.env.adapters.reward import given_weights

        try:
            given_weights(options["reward"])
        except SmartsError as error:
            yield Fault(("environment", "options", "reward"), error.problem, error.remedy)


def _scenarios(values: Values) -> Iterator[Fault]:
    from smarts.sstudio.build import read_scenario, suite  # here: reports need no builder
    from smarts.sstudio.episodes import check_egos

    traffic, agents = values.get("traffic"), _section(values, "environment").get("agents", 4)
    for key, name in _places(values.get("tasks")):
        try:
            scenario = read_scenario(name)
            if isinstance(agents, int):
                check_egos(scenario.ego_missions or (), agents, name)
        except UnknownNameError:
            continue  # the model says so
        except SmartsError as error:
            yield Fault(key, error.problem, error.remedy)
            continue
        known = scenario.traffic or {}
        if not known:
            yield Fault(
                key, f"{name} is no scenario with traffic to choose from", nearest_names(name, suite())
            )
            continue
        for number, each in enumerate(_texts(traffic)):
            if each not in known:
                text = f"{name} has no traffic {each!r}"
                yield Fault(("traffic", number), text, nearest_names(each, known))


def _places(tasks: Any) -> Iterator[tuple[tuple[str | int, ...], str]]:
    """Yield key and name of each scenario."""
    for number, task in enumerate(tasks if isinstance(tasks, list) else ()):
        if isinstance(task, str):
            yield ("tasks", number), task
        elif isinstance(task, dict):
            for place, name in enumerate(_texts(task.get("scenarios"))):
                yield ("tasks", number, "scenarios", place), name


def _section(values: Values, name: str) -> Values:
    found = values.get(name)
    return found if isinstance(found, dict) else {}


def _texts(given: Any) -> Sequence[str]:
    return [each for each in given if isinstance(each, str)] if isinstance(given, list) else []
