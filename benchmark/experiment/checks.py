"""Checks beyond the pydantic models: own code, settings, actions, searches; then the environment's."""

from __future__ import annotations

from collections.abc import Generator, Iterator, Mapping, Sequence
from itertools import chain
from math import inf
from typing import Any

from algorithms.registry import ALGORITHMS, ActionKind
from benchmark.experiment.algorithm_settings import (
    CONFIGS,
    entry_of,
    remedy_for_one,
    setting_faults,
    setting_names,
)
from benchmark.experiment.cells import check_cells
from benchmark.experiment.environment_checks import (
    Values,
    agents_of,
    check_environment,
    message_and_remedy,
    names_of_agents,
    section,
    strings,
)
from benchmark.scripted import SCRIPTED_POLICIES
from smarts.config import Fault, shown
from smarts.errors import OwnCodeError, nearest_names
from smarts.registry import Registry, import_own, is_own_name

DISTRIBUTIONS = ("uniform", "loguniform", "randint")
"""What a search may draw from, with [low, high]; `randint` excludes high."""


def check_experiment(values: Values) -> Iterator[Fault]:
    """Yield what is wrong with an experiment's values, in addition to the model's errors.

    Own code is imported: what is named as `module:Class` is there then, and is what it should be.
    """
    try:
        import_own(strings(values.get("imports")))
    except OwnCodeError as error:
        yield Fault(("imports",), *message_and_remedy(error))
        return
    if values.get("algorithms") == [] and not values.get("scripted"):
        yield Fault(("algorithms",), "there is nothing to run", "name an algorithm or a scripted policy")
    broken = yield from _own_names(values)
    sound = {**values, "algorithms": [n for n in strings(values.get("algorithms")) if n not in broken]}
    yield from _settings(sound)
    yield from check_cells(sound, _settings)
    yield from _check_tune(sound)
    yield from _actions(sound)
    yield from check_environment(values)


def _own_names(values: Values) -> Generator[Fault, None, set[str]]:
    """Resolve the names of own code; yield a fault for each that cannot be, and return those."""
    broken: set[str] = set()
    for key in ("algorithms", "metrics", "scripted"):
        given = values.get(key)
        for number, name in enumerate(given if isinstance(given, list) else ()):
            if not isinstance(name, str) or not is_own_name(name):
                continue
            try:
                _registry_of(key)[name]
            except OwnCodeError as error:
                broken.add(name)
                yield Fault((key, number), *message_and_remedy(error))
    return broken


def _registry_of(key: str) -> Registry:
    if key != "metrics":
        return {"algorithms": CONFIGS, "scripted": SCRIPTED_POLICIES}[key]
    from benchmark.metrics.registry import METRICS  # here: loading pandas takes longer than most checks

    return METRICS


def _settings(values: Values) -> Iterator[Fault]:
    """Yield settings that no algorithm takes, and each value that one of the algorithms cannot take."""
    common, own = section(values, "training"), section(values, "settings")
    algorithms = _known_algorithms(values)
    yield from _unused(common, algorithms)
    yield from _overridden(common, own, algorithms)
    reported: set[tuple[Any, ...]] = set()
    for algorithm in dict.fromkeys([*algorithms, *own]):
        try:
            given = common if algorithm in algorithms else {}
            faults = _setting_faults(algorithm, given, section(own, algorithm), values)
        except OwnCodeError as error:
            yield Fault(("settings", algorithm), *message_and_remedy(error))
            continue
        for fault in faults:
            if (fault.key, fault.text) not in reported:
                reported.add((fault.key, fault.text))
                yield fault


def _setting_faults(algorithm: str, common: Values, own: Values, values: Values) -> list[Fault]:
    """Return what is wrong with the settings that a file gives an algorithm, at their places in the file.

    Raises:
        OwnCodeError: A `module:Class` cannot be imported, or is no algorithm.
    """
    if algorithm not in ALGORITHMS and not is_own_name(algorithm):
        text = f"there is no algorithm {algorithm!r}"
        return [Fault(("settings", algorithm), text, nearest_names(algorithm, ALGORITHMS))]
    given = {name: common[name] for name in common.keys() & setting_names(algorithm)} | {**own}

    def place(name: str | int) -> tuple[str, ...]:
        return ("settings", algorithm) if name in own or name not in common else ("training",)

    found = []
    for fault, text, remedy in setting_faults(algorithm, given):
        key = (*place(fault.key[0]), *fault.key) if fault.key else ("settings", algorithm)
        if key[0] == "training" and (own_value := remedy_for_one(algorithm, fault)):
            text, remedy = f"{algorithm!r} cannot have {text}", own_value
        found.append(Fault(key, text, remedy))
    sharing = _sharing_fault(given.get("sharing"), section(values, "environment"))
    return [*found, Fault((*place("sharing"), "sharing"), sharing)] if sharing else found


_PROCESSES = {
    "num_env_runners": "resources.env_runners",
    "num_envs_per_env_runner": "resources.num_envs_per_env_runner",
    "num_learners": "resources.learners",
    "num_gpus_per_learner": "resources.learner_gpus",
}
"""RLlib's settings of processes, which the section `resources` has."""


def _unused(common: Values, algorithms: Sequence[str]) -> Iterator[Fault]:
    """Yield settings of all algorithms that none of them has."""
    used = {name for algorithm in algorithms for name in setting_names(algorithm)}
    every = used | {name for algorithm in ALGORITHMS for name in setting_names(algorithm)}
    for name in sorted(common.keys() - every):
        place = _PROCESSES.get(name)
        remedy = f"use {place}" if place else nearest_names(name, every)
        yield Fault(("training", name), "no algorithm has such a setting", remedy)
    for name in sorted((common.keys() & every) - used) if algorithms else ():
        yield Fault(("training", name), f"none of the algorithms has {name}", "remove it")


def _overridden(common: Values, own: Values, algorithms: Sequence[str]) -> Iterator[Fault]:
    """Yield settings of all algorithms that each overrides, and that none could have."""
    for name, value in common.items():
        every = dict.fromkeys([*ALGORITHMS, *algorithms])
        having = [algorithm for algorithm in every if name in setting_names(algorithm)]
        taking = [algorithm for algorithm in algorithms if name in setting_names(algorithm)]
        if not taking or any(name not in section(own, algorithm) for algorithm in taking):
            continue
        faults = [
            next((fault for fault in setting_faults(algorithm, {name: value}) if fault[0].key), None)
            for algorithm in having
        ]
        found = [fault for fault in faults if fault]
        if found and len(found) == len(faults):
            fault, text, remedy = found[0]
            yield Fault(("training", *fault.key), text, remedy)


def _known_algorithms(values: Values) -> list[str]:
    return [name for name in strings(values.get("algorithms")) if name in ALGORITHMS or is_own_name(name)]


def _actions(values: Values) -> Iterator[Fault]:
    """Yield algorithms and scripted policies that cannot act as the environment's agents do."""
    environment = section(values, "environment")
    actions = {
        str(agent.get("action", "Lane")): shown((*key, "action")) for key, agent in agents_of(environment)
    }
    if environment.get("adapter") is None:  # actions of an own adapter are known when it is made
        yield from _unfit_algorithms(_known_algorithms(values), actions)
    yield from _unfit_groups(_known_algorithms(values), environment.get("agents", 4), actions)
    other = next((action for action in actions if action != "Lane"), None)
    for number, name in enumerate(strings(values.get("scripted"))):
        if name in SCRIPTED_POLICIES and not is_own_name(name) and other:
            text = f"{name!r} acts by lane actions, and {actions[other]} is {other!r}"
            yield Fault(("scripted", number), text, "remove it, or give a scripted policy of your own")


def _unfit_algorithms(algorithms: Sequence[str], actions: Mapping[Any, str]) -> Iterator[Fault]:
    """Yield algorithms that cannot act as the agents do, whose actions have a key each."""
    for number, name in enumerate(algorithms):
        entry = entry_of(name)
        for action, key in actions.items():
            kind = ActionKind.DISCRETE if action == "Lane" else ActionKind.CONTINUOUS
            if not entry.acts_in(kind):
                fitting = ", ".join(name for name, entry in ALGORITHMS.items() if entry.acts_in(kind))
                text = f"{name!r} needs {entry.actions} actions, and {key} is {action!r}"
                yield Fault(("algorithms", number), text, f"for {kind} actions use one of: {fitting}")


def _unfit_groups(algorithms: Sequence[str], agents: Any, actions: Mapping[Any, str]) -> Iterator[Fault]:
    """Yield algorithms that need more agents, or agents with equal actions."""
    count = len(agents) if isinstance(agents, dict) else agents
    for number, name in enumerate(algorithms):
        entry, place = entry_of(name), ("algorithms", number)
        if isinstance(count, int) and 0 < count < entry.least_agents:
            text = f"{name!r} needs {entry.least_agents} agents, and there are {count}"
            yield Fault(place, text, "use another algorithm, or more agents")
        if entry.equal_spaces and len(actions) > 1:
            text = f"{name!r} needs agents with equal actions, and they have {', '.join(actions)}"
            yield Fault(place, text, "use another algorithm, or one action for all agents")


def _sharing_fault(sharing: Any, environment: Values) -> str:
    """Return which agents are in no group, or do not exist; nothing where there are no groups."""
    known = names_of_agents(environment)
    if not isinstance(sharing, dict) or not known:
        return ""
    groups = [members for members in sharing.values() if isinstance(members, list)]
    named = {*map(str, chain(*groups))}
    if missing := [agent for agent in known if agent not in named]:
        return f"{missing[0]} is in no groups, instead of in one"
    strange = sorted(named - {*known})
    return f"there is no agent {strange[0]!r}, but {', '.join(known)}" if strange else ""


def _check_tune(values: Values) -> Iterator[Fault]:
    """Yield what a search cannot set, or cannot choose from."""
    parameters = section(section(values, "tune"), "parameters")
    having = {name: setting_names(name) for name in _known_algorithms(values)} if parameters else {}
    for name, given in parameters.items():
        key = ("tune", "parameters", name)
        algorithms = [algorithm for algorithm, known in having.items() if name in known]
        if having and not algorithms:
            first, known = next(iter(having.items()))
            text = f"{first!r} has no such setting" if len(having) == 1 else "no algorithm has such a setting"
            yield Fault(key, text, nearest_names(name, known))
        elif fault := _draw_fault(given) if having else None:
            yield Fault((*key, *fault.key), fault.text, fault.remedy)
        else:
            faults = (fault for each in algorithms for fault in _chosen_faults(each, key, given, values))
            yield from {fault.key: fault for fault in faults}.values()
    for algorithm, known in having.items():
        if not parameters.keys() & set(known):
            text = f"{algorithm!r} has none of the settings"
            yield Fault(("tune", "parameters"), text, "give one that it has, or leave it out")


def _chosen_faults(algorithm: str, key: tuple[str, ...], given: Any, values: Values) -> Iterator[Fault]:
    """Yield what an algorithm cannot take of all that a search may choose from."""
    name = key[-1]
    for inner, value in _ends(given):
        for fault, text, remedy in setting_faults(algorithm, {name: value}):
            if fault.key:  # how settings fit each other depends on what is drawn
                yield Fault((*key, *inner, *fault.key[1:]), text, remedy)
        if name == "sharing" and (text := _sharing_fault(value, section(values, "environment"))):
            yield Fault((*key, *inner), text)


def _draw_fault(given: Any) -> Fault | None:
    """Return what is wrong with what a search is to choose from: values, or a draw with its bounds."""
    if isinstance(given, list) and given:
        return None
    (kind, bounds), *more = given.items() if isinstance(given, dict) and given else [("", None)]
    if kind == "choice" and not more and isinstance(bounds, list) and bounds:
        return None
    if kind not in DISTRIBUTIONS or more or not isinstance(bounds, list) or len(bounds) != 2:
        draws = ", ".join(f"{{{draw}: [low, high]}}" for draw in DISTRIBUTIONS)
        remedy = f"give a list of values, or one of {{choice: [value, ...]}}, {draws}"
        return Fault((), f"{given!r} is not a search space", remedy)
    return _bounds_fault(kind, bounds)


def _bounds_fault(kind: str, bounds: list[Any]) -> Fault | None:
    """Return what is wrong with the bounds of a draw."""
    kinds, numbers = ((int,), "whole numbers") if kind == "randint" else ((int, float), "numbers")
    if any(type(bound) not in kinds for bound in bounds):
        return Fault((kind,), f"{bounds!r} are not {numbers}")
    low, high = bounds
    least, order = (0, "0 < low < high") if kind == "loguniform" else (-inf, "low < high")
    if least < low < high < inf:
        return None
    return Fault((kind,), f"{bounds!r} are not bounds", f"give [low, high] with {order}, both finite")


def _ends(given: Any) -> list[tuple[tuple[str | int, ...], Any]]:
    """Return place and value of all that a search may choose from, of a draw within bounds its two ends."""
    if isinstance(given, list):
        return [((number,), value) for number, value in enumerate(given)]
    ((kind, values),) = given.items()
    if kind == "choice":
        return [((kind, number), value) for number, value in enumerate(values)]
    low, high = values
    if kind == "randint":
        return [((kind, 0), low), ((kind, 1), high - 1)]
    return [((kind, 0), float(low)), ((kind, 1), float(high))]
