"""What the models of experiment files cannot see: ranges of settings, adapters' options, scenarios' names.

The checks look at values as files give them. What does not fit the models is left to them.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from inspect import signature
from typing import Any

from algorithms.settings import settings
from algorithms.settings import values as setting_values
from smarts.config import Fault
from smarts.errors import SmartsError, UnknownNameError, nearest_names

Values = Mapping[str, Any]


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
        for name, limits in setting_values()[algorithm].items():
            section, key = (mine, ("settings", algorithm)) if name in mine else (common, ("training",))
            fault = limits.fault(section[name]) if name in section else None
            if fault is not None:
                found[(*key, name)] = f"{section[name]!r} is {fault}"
    for key, text in found.items():
        yield Fault(key, text)
    every = {name for defaults in known.values() for name in defaults}
    used = {name for algorithm in names for name in known[algorithm]}
    for name in sorted((common.keys() & every) - used) if names else ():
        yield Fault(("training", name), f"none of the algorithms has {name}", "remove it")


def _searched(values: Values) -> Iterator[Fault]:
    known = settings()
    for algorithm in _texts(values.get("algorithms"))[:1]:
        for name in _section(_section(values, "tune"), "parameters"):
            if algorithm in known and name not in known[algorithm]:
                key = ("tune", "parameters", name)
                yield Fault(key, f"{algorithm!r} has no such setting", nearest_names(name, known[algorithm]))


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
    from smarts.sstudio.build import traffic_of  # here: reports need no builder

    traffic = values.get("traffic")
    for key, name in _places(values.get("tasks")):
        try:
            known = traffic_of(name)
        except UnknownNameError:
            continue  # the model says so
        except SmartsError as error:
            yield Fault(key, error.problem, error.remedy)
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
