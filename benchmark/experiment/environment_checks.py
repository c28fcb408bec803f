"""Checks of an experiment's environment: its agents, observation and reward, social agents and scenarios."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from typing import Any

from smarts.config import Fault
from smarts.errors import SmartsError, UnknownNameError, nearest_names
from smarts.registry import is_own_name
from smarts.types.agent_states import agent_names
from smarts.types.traffic import DEFAULT_ENGINE, TRAFFIC_ENGINES

Values = Mapping[str, Any]
MOST_AGENTS = 64


def check_environment(values: Values) -> Iterator[Fault]:
    """Yield what is wrong with the environment of an experiment's values, and with its scenarios."""
    environment = section(values, "environment")
    yield from _tyres(environment)
    yield from _observed(environment)
    yield from _social(environment)
    yield from _absent_agents(values)
    yield from _traffic_step(environment)
    yield from _scenarios(values)


def agents_of(environment: Values) -> list[tuple[tuple[str, ...], Values]]:
    """Return the key of each agent's values, and the values: its own laid over the environment's."""
    agents = environment.get("agents")
    if not isinstance(agents, dict) or not agents:
        return [(("environment",), environment)]
    return [(("environment", "agents", name), {**environment, **section(agents, name)}) for name in agents]


def names_of_agents(environment: Values) -> tuple[str, ...]:
    """Return the agents' names; none where the value is not one."""
    agents = environment.get("agents", 4)
    if isinstance(agents, dict):
        return tuple(agents)
    return agent_names(min(agents, MOST_AGENTS)) if isinstance(agents, int) else ()


def _tyres(environment: Values) -> Iterator[Fault]:
    """Yield a model of tyres that the model of the vehicle has no use for."""
    for key, agent in agents_of(environment):
        tyres = agent.get("tyre_model", "pacejka")
        if agent.get("vehicle_model") == "kinematic" and tyres != "pacejka":
            text = f"the kinematic vehicle has no tyres that slip, so no {tyres!r} ones"
            yield Fault((*key, "tyre_model"), text, "remove it, or use vehicle_model 'dynamic'")


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
            yield Fault(("environment", "adapter"), *message_and_remedy(error))
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
            check_agent(entry["agent"], section(entry, "options"), hosts)
        except SmartsError as error:
            yield Fault(("environment", "social_agents", number), *message_and_remedy(error))
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
            yield Fault(("environment", "hosts", str(locator)), *message_and_remedy(error))
    return found


def _absent_agents(values: Values) -> Iterator[Fault]:
    """Yield hosts of agents that are in no scenario, and that the environment does not add."""
    environment = section(values, "environment")
    named = [each for each in section(environment, "hosts") if each != "*"]
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
        problem, remedy = message_and_remedy(error)
        yield Fault(("environment", key), problem.removeprefix(f"{key}: "), remedy)


def _scenarios(values: Values) -> Iterator[Fault]:
    from smarts.sstudio.build import read_scenario, suite  # here: reports need no builder
    from smarts.sstudio.episodes import check_egos, check_without_handovers

    environment = section(values, "environment")
    traffic, agents = values.get("traffic"), names_of_agents(environment)
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
            yield Fault(key, *message_and_remedy(error))
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
        for number, each in enumerate(strings(traffic)):
            if each not in known:
                text = f"{name} has no traffic {each!r}"
                yield Fault(("traffic", number), text, nearest_names(each, known))


def _places(tasks: Any) -> Iterator[tuple[tuple[str | int, ...], str]]:
    """Yield key and name of each scenario."""
    for number, task in enumerate(tasks if isinstance(tasks, list) else ()):
        if isinstance(task, str):
            yield ("tasks", number), task
        elif isinstance(task, dict):
            for place, name in enumerate(strings(task.get("scenarios"))):
                yield ("tasks", number, "scenarios", place), name


def section(values: Values, name: str) -> Values:
    """Return a section of some values, empty where there is none."""
    found = values.get(name)
    return found if isinstance(found, dict) else {}


def strings(given: Any) -> Sequence[str]:
    """Return the texts of a list, none of what is no list."""
    return [each for each in given if isinstance(each, str)] if isinstance(given, list) else []


def message_and_remedy(error: SmartsError) -> tuple[str, str]:
    """Return problem and remedy of an error, as of a fault."""
    return (f"{error.place}: {error.problem}" if error.place else error.problem), error.remedy
