"""Checks beyond the pydantic models: ranges of settings, adapter options, scenario names."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from itertools import chain
from math import inf
from typing import Any

from algorithms.registry import ALGORITHMS, ActionKind
from benchmark.experiment.algorithm_settings import CONFIGS, entry_of, setting_faults, setting_names
from benchmark.scripted import SCRIPTED_POLICIES
from smarts.config import Fault, shown
from smarts.errors import OwnCodeError, SmartsError, UnknownNameError, nearest_names
from smarts.registry import Registry, import_own, is_own_name
from smarts.types.agent_states import agent_names
from smarts.types.traffic import DEFAULT_ENGINE, TRAFFIC_ENGINES

Values = Mapping[str, Any]
MOST_AGENTS = 64
DISTRIBUTIONS = ("uniform", "loguniform", "randint")
"""What a search may draw from, with [low, high]; `randint` excludes high."""


def check_experiment(values: Values) -> Iterator[Fault]:
    """Yield what is wrong with an experiment's values, in addition to the model's errors.

    Own code is imported: what is named as `module:Class` is there then, and is what it should be.
    """
    try:
        import_own(_strings(values.get("imports")))
    except OwnCodeError as error:
        yield Fault(("imports",), *_message_and_remedy(error))
        return
    if values.get("algorithms") == [] and not values.get("scripted"):
        yield Fault(("algorithms",), "there is nothing to run", "name an algorithm or a scripted policy")
    broken = yield from _own_names(values)
    sound = {**values, "algorithms": [n for n in _strings(values.get("algorithms")) if n not in broken]}
    yield from _settings(sound)
    yield from _check_tune(sound)
    yield from _actions(sound)
    yield from _tyres(_section(values, "environment"))
    yield from _observed(_section(values, "environment"))
    yield from _social(_section(values, "environment"))
    yield from _absent_agents(values)
    yield from _traffic_step(_section(values, "environment"))
    yield from _scenarios(values)


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
                yield Fault((key, number), *_message_and_remedy(error))
    return broken


def _registry_of(key: str) -> Registry:
    if key != "metrics":
        return {"algorithms": CONFIGS, "scripted": SCRIPTED_POLICIES}[key]
    from benchmark.metrics.registry import METRICS  # here: loading pandas takes longer than most checks

    return METRICS


def _message_and_remedy(error: SmartsError) -> tuple[str, str]:
    """Return problem and remedy of an error, as of a fault."""
    return (f"{error.place}: {error.problem}" if error.place else error.problem), error.remedy


def _settings(values: Values) -> Iterator[Fault]:
    """Yield settings that no algorithm takes, and each value that one of the algorithms cannot take."""
    common, own = _section(values, "training"), _section(values, "settings")
    algorithms = _known_algorithms(values)
    yield from _unused(common, algorithms)
    reported: set[tuple[str | int, ...]] = set()
    for algorithm in dict.fromkeys([*algorithms, *own]):
        try:
            given = common if algorithm in algorithms else {}
            faults = _setting_faults(algorithm, given, _section(own, algorithm), values)
        except OwnCodeError as error:
            yield Fault(("settings", algorithm), *_message_and_remedy(error))
            continue
        for fault in faults:
            if fault.key not in reported:
                reported.add(fault.key)
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

    found = [
        Fault((*place(fault.key[0]), *fault.key) if fault.key else ("settings", algorithm), text, remedy)
        for fault, text, remedy in setting_faults(algorithm, given)
    ]
    sharing = _sharing_fault(given.get("sharing"), _section(values, "environment"))
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


def _known_algorithms(values: Values) -> list[str]:
    return [name for name in _strings(values.get("algorithms")) if name in ALGORITHMS or is_own_name(name)]


def _actions(values: Values) -> Iterator[Fault]:
    """Yield algorithms and scripted policies that cannot act as the environment's agents do."""
    environment = _section(values, "environment")
    actions = {
        str(agent.get("action", "Lane")): shown((*key, "action")) for key, agent in _agents(environment)
    }
    if environment.get("adapter") is None:  # actions of an own adapter are known when it is made
        yield from _unfit_algorithms(_known_algorithms(values), actions)
    yield from _unfit_groups(_known_algorithms(values), environment.get("agents", 4), actions)
    other = next((action for action in actions if action != "Lane"), None)
    for number, name in enumerate(_strings(values.get("scripted"))):
        if name in SCRIPTED_POLICIES and not is_own_name(name) and other:
            text = f"{name!r} acts by lane actions, and {actions[other]} is {other!r}"
            yield Fault(("scripted", number), text, "remove it, or give a scripted policy of your own")


def _agents(environment: Values) -> list[tuple[tuple[str, ...], Values]]:
    """Return the key of each agent's values, and the values: its own laid over the environment's."""
    agents = environment.get("agents")
    if not isinstance(agents, dict) or not agents:
        return [(("environment",), environment)]
    return [(("environment", "agents", name), {**environment, **_section(agents, name)}) for name in agents]


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


def _tyres(environment: Values) -> Iterator[Fault]:
    """Yield a model of tyres that the model of the vehicle has no use for."""
    for key, agent in _agents(environment):
        tyres = agent.get("tyre_model", "pacejka")
        if agent.get("vehicle_model") == "kinematic" and tyres != "pacejka":
            text = f"the kinematic vehicle has no tyres that slip, so no {tyres!r} ones"
            yield Fault((*key, "tyre_model"), text, "remove it, or use vehicle_model 'dynamic'")


def _sharing_fault(sharing: Any, environment: Values) -> str:
    """Return which agents are not in exactly one group; nothing where there are no groups."""
    known = _names_of_agents(environment)
    if not isinstance(sharing, dict) or not known:
        return ""
    groups = [members for members in sharing.values() if isinstance(members, list)]
    named = Counter(map(str, chain(*groups)))
    if wrong := [agent for agent in known if named[agent] != 1]:
        return f"{wrong[0]} is in {named[wrong[0]] or 'no'} groups, instead of in one"
    strange = sorted(named.keys() - {*known})
    return f"there is no agent {strange[0]!r}, but {', '.join(known)}" if strange else ""


def _names_of_agents(environment: Values) -> tuple[str, ...]:
    """Return the agents' names; none where the value is not one."""
    agents = environment.get("agents", 4)
    if isinstance(agents, dict):
        return tuple(agents)
    return agent_names(min(agents, MOST_AGENTS)) if isinstance(agents, int) else ()


def _check_tune(values: Values) -> Iterator[Fault]:
    """Yield what a search cannot set, or cannot choose from."""
    environment = _section(values, "environment")
    for algorithm in _known_algorithms(values)[:1]:
        for name, given in _section(_section(values, "tune"), "parameters").items():
            key = ("tune", "parameters", name)
            known = setting_names(algorithm)
            if name not in known:
                yield Fault(key, f"{algorithm!r} has no such setting", nearest_names(name, known))
                continue
            if fault := _draw_fault(given):
                yield Fault((*key, *fault.key), fault.text, fault.remedy)
                continue
            for inner, value in _ends(given):
                for fault, text, remedy in setting_faults(algorithm, {name: value}):
                    if fault.key:  # how settings fit each other depends on what is drawn
                        yield Fault((*key, *inner, *fault.key[1:]), text, remedy)
                if name == "sharing" and (text := _sharing_fault(value, environment)):
                    yield Fault((*key, *inner), text)


def _draw_fault(given: Any) -> Fault | None:
    """Return what is wrong with what a search is to choose from: values, or a draw with its bounds."""
    if isinstance(given, list) and given:
        return None
    (kind, bounds), *more = given.items() if isinstance(given, dict) and given else [("", None)]
    if kind not in DISTRIBUTIONS or more or not isinstance(bounds, list) or len(bounds) != 2:
        draws = ", ".join(f"{{{draw}: [low, high]}}" for draw in DISTRIBUTIONS)
        return Fault((), f"{given!r} is not a search space", f"give a list of values, or one of {draws}")
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
    """Return place and value of all that a search may choose from, of a draw its two ends."""
    if isinstance(given, list):
        return [((number,), value) for number, value in enumerate(given)]
    ((kind, (low, high)),) = given.items()
    if kind == "randint":
        return [((kind, 0), low), ((kind, 1), high - 1)]
    return [((kind, 0), float(low)), ((kind, 1), float(high))]


def _observed(environment: Values) -> Iterator[Fault]:
    """Yield what is wrong with observation, reward and own adapter; loads the simulation if one is given."""
    if "options" in environment:
        remedy = (
            "write observation: and reward: themselves; a picture is a feature of the observation: "
            "{base: benchmark, stacked: [image]}"
        )
        yield Fault(("environment", "options"), "there are no options of an observation", remedy)
    if environment.keys() & {"adapter", "adapter_options"}:
        from smarts.env.adapters import adapter_class  # here: reports need no environments

        try:
            adapter_class(environment.get("adapter"), environment.get("adapter_options"))
        except SmartsError as error:
            yield Fault(("environment", "adapter"), *_message_and_remedy(error))
    if environment.get("observation", "benchmark") != "benchmark":
        from smarts.observations.lists import feature_list

        yield from _refused("observation", feature_list, environment)
    if is_own_name(str(environment.get("traffic_engine"))):
        yield from _refused("traffic_engine", TRAFFIC_ENGINES.__getitem__, environment)
    if environment.get("reward") is not None:
        from smarts.rewards.own import check_reward

        yield from _refused("reward", check_reward, environment)


def _social(environment: Values) -> Iterator[Fault]:
    """Yield what is wrong with agents of the zoo, and with learning in bubbles."""
    given, hosts = environment.get("social_agents"), {}
    if isinstance(environment.get("hosts"), dict):
        hosts = yield from _hosts(environment["hosts"])
    for number, entry in enumerate(given if isinstance(given, list) else ()):
        if not isinstance(entry, dict) or not isinstance(entry.get("agent"), str):
            continue  # the model says so
        from smarts.env.casting import check_agent

        try:
            check_agent(entry["agent"], _section(entry, "options"), hosts)
        except SmartsError as error:
            yield Fault(("environment", "social_agents", number), *_message_and_remedy(error))
    if environment.keys() & {"learn_in_bubbles", "episode_time"}:
        from smarts.agents.social import bubble_learning

        try:
            bubble_learning(environment.get("learn_in_bubbles", False), environment.get("episode_time"))
        except SmartsError as error:
            yield Fault(("environment", error.place), error.problem, error.remedy)


def _hosts(given: Values) -> Generator[Fault, None, dict[str, Any]]:
    """Return where agents act, without what the model refuses; yield logs that cannot be replayed."""
    from smarts.agents.hosting.log import recorded
    from smarts.agents.hosting.options import hosts_of

    found: dict[str, Any] = {}
    for locator, entry in given.items():
        try:
            host = hosts_of({locator: entry})[locator]
        except SmartsError:
            continue  # the model says so
        try:
            if host.replay:
                recorded(host.replay)
            found[locator] = host
        except SmartsError as error:
            yield Fault(("environment", "hosts", str(locator)), *_message_and_remedy(error))
    return found


def _absent_agents(values: Values) -> Iterator[Fault]:
    """Yield hosts of agents that are in no scenario, and that the environment does not add."""
    environment = _section(values, "environment")
    named = [each for each in _section(environment, "hosts") if each != "*"]
    if not named:
        return
    from smarts.env.casting import locators_of
    from smarts.sstudio.build import read_scenario

    added = environment.get("social_agents")
    known = [each.get("agent") for each in added if isinstance(each, dict)] if isinstance(added, list) else []
    try:
        for _, name in _places(values.get("tasks")):
            known += locators_of(read_scenario(name))
    except SmartsError:
        return  # said elsewhere
    for locator in named:
        if locator not in known:
            remedy = nearest_names(str(locator), [*map(str, known)])
            text = f"no agent of the experiment is {locator!r}"
            yield Fault(("environment", "hosts", str(locator)), text, remedy)


def _traffic_step(environment: Values) -> Iterator[Fault]:
    """Yield what a longer step of the traffic does not go with; `_scenarios` looks at the scenarios."""
    if environment.get("traffic_step") is None:
        return
    for key in ("social_agents", "learn_in_bubbles"):
        if environment.get(key):
            yield Fault(
                ("environment", "traffic_step"),
                f"traffic_step is set, and so is {key}",
                f"leave out traffic_step or {key}: hand-overs need exact traffic",
            )
    engine = environment.get("traffic_engine") or DEFAULT_ENGINE
    if engine != DEFAULT_ENGINE:
        yield Fault(
            ("environment", "traffic_step"),
            f"traffic_step is set, and the traffic engine is {engine}",
            f"leave out traffic_step, or use the traffic engine {DEFAULT_ENGINE}",
        )


def _refused(key: str, check: Callable[[Any], object], environment: Values) -> Iterator[Fault]:
    try:
        check(environment[key])
    except SmartsError as error:
        problem, remedy = _message_and_remedy(error)
        yield Fault(("environment", key), problem.removeprefix(f"{key}: "), remedy)


def _scenarios(values: Values) -> Iterator[Fault]:
    from smarts.sstudio.build import read_scenario, suite  # here: reports need no builder
    from smarts.sstudio.episodes import check_egos, check_without_handovers

    environment = _section(values, "environment")
    traffic, agents = values.get("traffic"), _names_of_agents(environment)
    if environment.get("learn_in_bubbles"):
        agents = ()
    for key, name in _places(values.get("tasks")):
        try:
            scenario = read_scenario(name)
            if environment.get("traffic_step") is not None:
                check_without_handovers(scenario, name)
        except UnknownNameError:
            continue  # the model says so
        except SmartsError as error:
            yield Fault(key, error.problem, error.remedy)
            continue
        try:
            check_egos(scenario.ego_missions or (), len(agents), name)
        except SmartsError as error:
            yield Fault(("environment", "agents"), f"{name}: {error.problem}", error.remedy)
            continue
        known = scenario.traffic or {}
        if not known:
            yield Fault(
                key, f"{name} is no scenario with traffic to choose from", nearest_names(name, suite())
            )
            continue
        for number, each in enumerate(_strings(traffic)):
            if each not in known:
                text = f"{name} has no traffic {each!r}"
                yield Fault(("traffic", number), text, nearest_names(each, known))


def _places(tasks: Any) -> Iterator[tuple[tuple[str | int, ...], str]]:
    """Yield key and name of each scenario."""
    for number, task in enumerate(tasks if isinstance(tasks, list) else ()):
        if isinstance(task, str):
            yield ("tasks", number), task
        elif isinstance(task, dict):
            for place, name in enumerate(_strings(task.get("scenarios"))):
                yield ("tasks", number, "scenarios", place), name


def _section(values: Values, name: str) -> Values:
    found = values.get(name)
    return found if isinstance(found, dict) else {}


def _strings(given: Any) -> Sequence[str]:
    return [each for each in given if isinstance(each, str)] if isinstance(given, list) else []
