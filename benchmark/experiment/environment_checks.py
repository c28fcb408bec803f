"""Checks of an experiment's environment: its agents, observation and reward, social agents and scenarios."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

from benchmark.experiment.environment import Driving, Environment, Host
from benchmark.experiment.models import Experiment
from smarts.config import Fault
from smarts.errors import SmartsError, nearest_names
from smarts.registry import is_own_name
from smarts.types.traffic import DEFAULT_ENGINE, TRAFFIC_ENGINES


def check_environment(experiment: Experiment) -> Iterator[Fault]:
    """Yield what does not fit together in an experiment's environment, and with its scenarios."""
    environment = experiment.environment
    yield from _tyres(environment)
    yield from _observed(environment)
    yield from _social(environment)
    yield from _absent_agents(experiment)
    yield from _traffic_step(environment)
    yield from _scenarios(experiment)


def errors_of(key: tuple[str | int, ...], check: Callable[..., object], *given: Any) -> Iterator[Fault]:
    """Yield the error that a check of a value raises, as a fault at a key."""
    try:
        check(*given)
    except SmartsError as error:
        yield from faults_of(key, error)


def faults_of(key: tuple[str | int, ...], error: SmartsError) -> Iterator[Fault]:
    """Yield an error as a fault at a key."""
    problem = f"{error.place}: {error.problem}" if error.place else error.problem
    yield Fault(key, problem.removeprefix(f"{key[-1]}: "), error.remedy)


def driving_by_key(environment: Environment) -> dict[tuple[str, ...], Driving]:
    """Return how agents act and drive, by the key in the file."""
    if isinstance(environment.agents, int):
        return {("environment",): environment}
    return {("environment", "agents", name): each for name, each in environment.driving().items()}


def _tyres(environment: Environment) -> Iterator[Fault]:
    """Yield a model of tyres that the model of the vehicle has no use for."""
    for key, driving in driving_by_key(environment).items():
        if driving.vehicle_model == "kinematic" and driving.tyre_model != "pacejka":
            text = f"the kinematic vehicle has no tyres that slip, so no {driving.tyre_model!r} ones"
            yield Fault((*key, "tyre_model"), text, "remove it, or use vehicle_model 'dynamic'")


def _observed(environment: Environment) -> Iterator[Fault]:
    """Yield what is wrong with observation, reward and own code; loads the simulation if one is given."""
    if environment.adapter is not None or environment.adapter_options:
        from smarts.env.adapters import adapter_class  # here: reports need no environments

        options = environment.adapter_options
        yield from errors_of(("environment", "adapter"), adapter_class, environment.adapter, options)
    if environment.observation != "benchmark":
        from smarts.observations.lists import feature_list

        yield from errors_of(("environment", "observation"), feature_list, environment.observation)
    if environment.traffic_engine and is_own_name(environment.traffic_engine):
        engine = environment.traffic_engine
        yield from errors_of(("environment", "traffic_engine"), TRAFFIC_ENGINES.__getitem__, engine)
    if environment.reward is not None:
        from smarts.rewards.own import check_reward

        yield from errors_of(("environment", "reward"), check_reward, environment.reward)


def _social(environment: Environment) -> Iterator[Fault]:
    """Yield what is wrong with agents of the zoo, and with learning in bubbles."""
    for number, social in enumerate(environment.social_agents):
        from smarts.agents.hosting.options import HostOptions
        from smarts.env.casting import check_agent

        hosts = {
            locator: HostOptions(**dict(host)) if isinstance(host, Host) else HostOptions(host)
            for locator, host in environment.hosts.items()
        }
        key = ("environment", "social_agents", number)
        yield from errors_of(key, check_agent, social.agent, social.options, hosts)
    if environment.learn_in_bubbles or environment.episode_time is not None:
        from smarts.agents.social import bubble_learning

        key, bubbles = ("environment", "episode_time"), environment.learn_in_bubbles
        yield from errors_of(key, bubble_learning, bubbles, environment.episode_time)


def _absent_agents(experiment: Experiment) -> Iterator[Fault]:
    """Yield hosts of agents that are in no scenario, and that the environment does not add."""
    environment = experiment.environment
    named = [locator for locator in environment.hosts if locator != "*"]
    if not named:
        return
    from smarts.env.casting import locators_of
    from smarts.sstudio.build import read_scenario

    known = [each.agent for each in environment.social_agents]
    try:
        for _, name in _places(experiment):
            known += locators_of(read_scenario(name))
    except SmartsError:
        return  # `_scenarios` tells it
    for locator in named:
        if locator not in known:
            text = f"no agent of the experiment is {locator!r}"
            yield Fault(("environment", "hosts", locator), text, nearest_names(locator, known))


def _traffic_step(environment: Environment) -> Iterator[Fault]:
    """Yield what a longer step of the traffic does not go with; `_scenarios` looks at the scenarios."""
    if environment.traffic_step is None:
        return
    key = ("environment", "traffic_step")
    for other in ("social_agents", "learn_in_bubbles"):
        if getattr(environment, other):
            text, remedy = f"traffic_step is set, and so is {other}", f"leave out traffic_step or {other}"
            yield Fault(key, text, f"{remedy}: hand-overs need exact traffic")
    engine = environment.traffic_engine or DEFAULT_ENGINE
    if engine != DEFAULT_ENGINE:
        text = f"traffic_step is set, and the traffic engine is {engine}"
        yield Fault(key, text, f"leave out traffic_step, or use the traffic engine {DEFAULT_ENGINE}")


def _scenarios(experiment: Experiment) -> Iterator[Fault]:
    """Yield scenarios that cannot be read, and agents and traffic that they do not have."""
    from smarts.sstudio.build import read_scenario, suite  # here: reports need no builder
    from smarts.sstudio.episodes import check_egos, check_without_handovers

    environment = experiment.environment
    for key, name in _places(experiment):
        try:
            scenario = read_scenario(name)
            if environment.traffic_step is not None:
                check_without_handovers(scenario, name)
        except SmartsError as error:
            yield from faults_of(key, error)
            continue
        missions, known = scenario.ego_missions or (), scenario.traffic or {}
        yield from errors_of(("environment", "agents"), check_egos, missions, environment.mission_count, name)
        if not known:
            text = f"{name} is no scenario with traffic to choose from"
            yield Fault(key, text, nearest_names(name, suite()))
        for number, each in enumerate(experiment.traffic if known else ()):
            if each not in known:
                text = f"{name} has no traffic {each!r}"
                yield Fault(("traffic", number), text, nearest_names(each, known))


def _places(experiment: Experiment) -> Iterator[tuple[tuple[str | int, ...], str]]:
    """Yield key and name of each scenario."""
    for number, task in enumerate(experiment.tasks):
        for name in task.scenarios:
            yield ("tasks", number), name
