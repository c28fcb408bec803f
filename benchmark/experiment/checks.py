"""Checks of experiments where several keys meet, or own code is imported; the models check single keys."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator, Mapping
from functools import cache
from itertools import chain, product
from typing import Any

from algorithms.registry import ALGORITHMS, ActionKind
from benchmark.experiment.algorithm_settings import (
    CONFIGS,
    entry_of,
    remedy_for_one,
    setting_faults,
    setting_names,
    settings_of,
)
from benchmark.experiment.environment import Driving, Environment, Host
from benchmark.experiment.loggers import LOGGERS
from benchmark.experiment.models import Budget, Experiment, TaskOverrides
from benchmark.experiment.values import ends
from benchmark.scripted import SCRIPTED_POLICIES
from smarts.config import Fault, shown
from smarts.errors import OwnCodeError, SmartsError, nearest_names
from smarts.registry import Registry, import_own, is_own_name
from smarts.sstudio.locating import suite
from smarts.types.traffic import DEFAULT_ENGINE, TRAFFIC_ENGINES

STANDARD = ("no_social_vehicles", "random_social_vehicles")
"""Traffic variations of every scenario of the suite."""
PROCESSES = {
    "num_env_runners": "resources.env_runners",
    "num_envs_per_env_runner": "resources.num_envs_per_env_runner",
    "num_learners": "resources.learners",
    "num_gpus_per_learner": "resources.learner_gpus",
}
"""RLlib's settings of processes, which the section `resources` has."""

Layer = tuple[tuple[str, ...], Experiment | TaskOverrides]
"""Key and content of a part of the file with `training` and `settings`."""
Algorithms = Mapping[str, int]
"""Algorithms of the experiment that exist, with their numbers in its list."""


def check_experiment(experiment: Experiment) -> Iterator[Fault]:
    """Yield what does not fit together in an experiment; its own code is imported."""
    if faults := [*errors_of(("imports",), import_own, experiment.imports)]:
        yield from faults
        return
    if not experiment.algorithms and not experiment.scripted:
        yield Fault(("algorithms",), "there is nothing to run", "name an algorithm or a scripted policy")
    if not experiment.tasks:
        yield Fault(("tasks",), "there is none", "name a scenario, as in [intersection]")
    broken = yield from _own_names(experiment)
    algorithms = {name: number for number, name in enumerate(experiment.algorithms) if name not in broken}
    yield from _by_task(experiment)
    yield from _budgets(experiment)
    yield from _starts(experiment)
    yield from _demonstrations(experiment)
    yield from _loggers(experiment)
    yield from _settings(experiment, algorithms)
    yield from _search(experiment, algorithms)
    yield from _contrasts(experiment)
    yield from _actions(experiment, algorithms)
    yield from check_environment(experiment)


def _own_names(experiment: Experiment) -> Generator[Fault, None, set[str]]:
    """Import own code by its names; yield a fault for each that cannot be, and return those."""
    broken: set[str] = set()
    for key in ("algorithms", "scripted", "metrics"):
        for number, name in enumerate(getattr(experiment, key) or ()):
            for fault in errors_of((key, number), _import, key, name) if is_own_name(name) else ():
                broken.add(name)
                yield fault
    return broken


def _import(key: str, name: str) -> None:
    from benchmark.metrics.registry import METRICS  # here: loads pandas

    registries: dict[str, Registry] = {"algorithms": CONFIGS, "scripted": SCRIPTED_POLICIES}
    registries.get(key, METRICS)[name]


def _by_task(experiment: Experiment) -> Iterator[Fault]:
    """Yield names of tasks that neither experiment nor suite has: `--set tasks` may leave some out."""
    tasks = dict.fromkeys([*(task.name for task in experiment.tasks), *suite()])
    traffic = dict.fromkeys([*STANDARD, *experiment.traffic])
    known = [*tasks, *(f"{task}/{each}" for task in tasks for each in traffic)]
    for name in experiment.by_task if experiment.tasks else ():
        if name not in known:
            yield Fault(("by_task", name), "there is no such task", nearest_names(name, known))


def _budgets(experiment: Experiment) -> Iterator[Fault]:
    """Yield a budget of a task without a limit."""
    places = product((task.name for task in experiment.tasks), experiment.traffic)
    if any(experiment.budget_of(*place) == Budget(agent_steps=None) for place in places):
        yield Fault(("budget",), "has neither agent_steps nor minutes", "give one of them, or both")


def _starts(experiment: Experiment) -> Iterator[Fault]:
    """Yield runs to start from, which a version of the benchmark does not allow."""
    for number, task in enumerate(experiment.tasks):
        key = "tasks", number, "start_from"
        if task.start_from and experiment.benchmark_version is not None:
            yield Fault(key, "trainings of a benchmark version begin without weights", "leave it out")


def _demonstrations(experiment: Experiment) -> Iterator[Fault]:
    """Yield the missing demonstrations of behavioural cloning."""
    parts = [part.settings.get("bc") or {} for layers in _layers(experiment) for _, part in layers]
    if "bc" in experiment.algorithms and not any(part.get("data") for part in parts):
        remedy = "give the file that `smarts-bench demonstrations` wrote"
        yield Fault(("settings", "bc", "data"), "is missing", remedy)


def _loggers(experiment: Experiment) -> Iterator[Fault]:
    """Yield loggers that are not installed, or own ones that are none; the default is always there."""
    for number, name in enumerate(experiment.log if "log" in experiment.model_fields_set else ()):
        try:
            yield from errors_of(("log", number), LOGGERS.__getitem__, name)
        except ModuleNotFoundError as error:
            yield Fault(("log", number), f"{name} is not installed", f"pip install {error.name}")


def _settings(experiment: Experiment, algorithms: Algorithms) -> Iterator[Fault]:
    """Yield settings that no algorithm takes, and each value that one of the algorithms cannot take."""
    # A mistake that all tasks share is reported once.
    found: dict[Fault, None] = {}
    for layers in _layers(experiment):
        found |= dict.fromkeys(_unused(layers, algorithms))
        named = [name for _, part in layers for name in part.settings]
        for algorithm in dict.fromkeys([*algorithms, *named]):
            found |= dict.fromkeys(_settings_of(algorithm, layers, algorithms, experiment.environment))
    yield from found


def _layers(experiment: Experiment) -> Iterator[list[Layer]]:
    """Yield the parts of the file for all tasks, then for each that has its own; later ones override."""
    base: Layer = ((), experiment)
    yield [base]
    given = experiment.by_task
    for name, own in given.items():
        task = name.partition("/")[0]
        around = [(("by_task", task), given[task])] if task in given and task != name else []
        yield [base, *around, (("by_task", name), own)]


def _unused(layers: list[Layer], algorithms: Algorithms) -> Iterator[Fault]:
    """Yield settings of all algorithms that none of them has."""
    used = {name for algorithm in algorithms for name in setting_names(algorithm)}
    every = used | {name for algorithm in ALGORITHMS for name in setting_names(algorithm)}
    for key, part in layers:
        for name in part.training:
            place = (*key, "training", name)
            if name not in every:
                remedy = f"use {PROCESSES[name]}" if name in PROCESSES else nearest_names(name, every)
                yield Fault(place, "no algorithm has such a setting", remedy)
            elif algorithms and name not in used:
                yield Fault(place, f"none of the algorithms has {name}", "remove it")


def _settings_of(
    algorithm: str, layers: list[Layer], algorithms: Algorithms, environment: Environment
) -> Iterator[Fault]:
    """Yield what is wrong with an algorithm's settings in a task, at their places in the file."""
    own_keys = [(*key, "settings", algorithm) for key, part in layers if algorithm in part.settings]
    place = own_keys[-1] if own_keys else ("settings", algorithm)
    if algorithm not in ALGORITHMS and not is_own_name(algorithm):
        yield Fault(place, f"there is no algorithm {algorithm!r}", nearest_names(algorithm, ALGORITHMS))
        return
    try:
        known = setting_names(algorithm)
    except OwnCodeError as error:
        yield from faults_of(place, error)
        return
    given: dict[str, Any] = {}
    sections: dict[str, tuple[str, ...]] = {}
    for key, part in layers if algorithm in algorithms else ():
        common = {name: part.training[name] for name in part.training.keys() & {*known}}
        given |= common
        sections |= dict.fromkeys(common, (*key, "training"))
    for key, part in layers:
        own = part.settings.get(algorithm) or {}
        given |= own
        sections |= dict.fromkeys(own, (*key, "settings", algorithm))
    is_sound = True
    for fault, text, remedy in setting_faults(algorithm, given):
        is_sound = False
        section = sections[str(fault.key[0])] if fault.key else place
        if section[-1] == "training" and (own_value := remedy_for_one(algorithm, fault)):
            text, remedy = f"{algorithm!r} cannot have {text}", own_value
        yield Fault((*section, *fault.key), text, remedy)
    sharing = settings_of(algorithm).model_validate(given).sharing if is_sound else None
    if text := _sharing_fault(sharing, environment):
        yield Fault((*sections["sharing"], "sharing"), text)


def _sharing_fault(sharing: Any, environment: Environment) -> str:
    """Return which agents are in no group, or do not exist; "" where there are no groups."""
    if not isinstance(sharing, dict):
        return ""
    known, named = environment.driving(), [*chain(*sharing.values())]
    if missing := [agent for agent in known if agent not in named]:
        return f"{missing[0]} is in no groups, instead of in one"
    strange = sorted({*named} - {*known})
    return f"there is no agent {strange[0]!r}, but {', '.join(known)}" if strange else ""


def _search(experiment: Experiment, algorithms: Algorithms) -> Iterator[Fault]:
    """Yield what a search cannot set, or cannot choose from."""
    if experiment.tune is None:
        return
    having = {name: setting_names(name) for name in algorithms}
    parameters = experiment.tune.parameters
    for name, given in parameters.items():
        key = ("tune", "parameters", name)
        searched = [algorithm for algorithm in having if name in having[algorithm]]
        if having and not searched:
            text = "none of the algorithms has such a setting"
            yield Fault(key, text, nearest_names(name, {*chain(*having.values())}))
        found = chain(*(_unfit_choices(each, name, given, experiment.environment) for each in searched))
        for fault in dict.fromkeys(found):
            yield Fault((*key, *fault.key), fault.text, fault.remedy)
    for algorithm, known in having.items():
        if not parameters.keys() & {*known}:
            text = f"{algorithm!r} has none of the settings"
            yield Fault(("tune", "parameters"), text, "give one that it has, or leave it out")


def _contrasts(experiment: Experiment) -> Iterator[Fault]:
    """Yield pairs, metrics and conditions that no report could compare."""
    given = experiment.contrasts
    if given is None:
        return
    if given.metric == "generalization":
        text = "generalization is of held-out variations, and contrasts are of conditions"
        yield Fault(("contrasts", "metric"), text, "choose another metric")
    tests = [{each.name for each in task.test} for task in experiment.tasks]
    known = {*chain(*tests)}
    for number, name in enumerate(given.conditions):
        if name not in known:
            remedy = (
                nearest_names(name, known) if known else "give a task a list `test`, or leave contrasts out"
            )
            yield Fault(("contrasts", "conditions", number), f"no test has the condition {name!r}", remedy)
    if {*given.conditions} <= known and not any({*given.conditions} <= each for each in tests):
        yield Fault(("contrasts", "conditions"), "no task has all of them", "name those of one task")


def _unfit_choices(algorithm: str, name: str, given: Any, environment: Environment) -> Iterator[Fault]:
    """Yield what an algorithm cannot take of all that a search may choose from for a setting."""
    for place, value in ends(given):
        for fault, text, remedy in setting_faults(algorithm, {name: value}):
            if fault.key:  # how settings fit each other depends on what is drawn
                yield Fault((*place, *fault.key[1:]), text, remedy)
        if name == "sharing" and (text := _sharing_fault(value, environment)):
            yield Fault(place, text)


def _actions(experiment: Experiment, algorithms: Algorithms) -> Iterator[Fault]:
    """Yield algorithms and scripted policies that do not suit the number of agents and their actions."""
    environment = experiment.environment
    driving = driving_by_key(environment)
    actions = {each.action: shown((*key, "action")) for key, each in driving.items()}
    for name, number in algorithms.items():
        for text, remedy in _unsuited(name, environment, actions):
            yield Fault(("algorithms", number), text, remedy)
    other = next((action for action in actions if action != "Lane"), None)
    for number, name in enumerate(experiment.scripted):
        if other and not is_own_name(name):
            text = f"{name!r} acts by lane actions, and {actions[other]} is {other!r}"
            yield Fault(("scripted", number), text, "remove it, or give a scripted policy of your own")


def _unsuited(
    algorithm: str, environment: Environment, actions: Mapping[str, str]
) -> Iterator[tuple[str, str]]:
    """Yield why an algorithm does not suit agents, and remedies; `actions` have the key of an agent each."""
    entry = entry_of(algorithm)
    for action, key in actions.items():
        kind = ActionKind.DISCRETE if action == "Lane" else ActionKind.CONTINUOUS
        if environment.adapter is None and not entry.acts_in(kind):  # an adapter's actions are known later
            fitting = ", ".join(name for name, entry in ALGORITHMS.items() if entry.acts_in(kind))
            text = f"{algorithm!r} needs {entry.actions} actions, and {key} is {action!r}"
            yield text, f"for {kind} actions use one of: {fitting}"
    if environment.agent_count < entry.least_agents:
        text = f"{algorithm!r} needs {entry.least_agents} agents, and there are {environment.agent_count}"
        yield text, "use another algorithm, or more agents"
    if entry.equal_spaces and len(actions) > 1:
        text = f"{algorithm!r} needs agents with equal actions, and they have {', '.join(actions)}"
        yield text, "use another algorithm, or one action for all agents"


def check_environment(experiment: Experiment) -> Iterator[Fault]:
    """Yield what does not fit together in an experiment's environment, and with its scenarios."""
    environment = experiment.environment
    yield from _tyres(environment)
    yield from _observed(environment)
    yield from _social(environment)
    yield from _traffic_step(environment)
    yield from _training_traffic(environment)
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


def _training_traffic(environment: Environment) -> Iterator[Fault]:
    """Yield what training on Native with kinematic vehicles does not go with."""
    if environment.training_traffic is None:
        return
    place, remedy = ("environment", "training_traffic"), "leave out training_traffic or"
    if environment.traffic_step is not None:
        text = "training_traffic is native, and traffic_step is of SUMO"
        yield Fault(place, text, f"{remedy} traffic_step")
    for key, driving in driving_by_key(environment).items():
        tyres = {"friction": environment.friction, "flat_tyres": driving.flat_tyres}
        tyres["tyre_model"] = driving.tyre_model != "pacejka"
        for name in tyres if driving.vehicle_model == "bullet" else ():
            if tyres[name]:
                text = f"agents learn in kinematic vehicles (training_traffic), whose tyres have no {name}"
                yield Fault((*key, name), text, f"{remedy} {name}, or use vehicle_model 'dynamic'")


def _scenarios(experiment: Experiment) -> Iterator[Fault]:
    """Yield scenarios that cannot be read, and agents and traffic that they do not have."""
    from smarts.sstudio.build import read_scenario, suite  # here: reports need no builder
    from smarts.sstudio.episodes import check_egos, check_engine, check_without_handovers

    environment, read = experiment.environment, cache(read_scenario)
    for key, name, traffic in _places(experiment):
        try:
            scenario = read(name)
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
        for each in traffic if known else ():
            if each not in known:
                listed = [*experiment.traffic]
                place = ("traffic", listed.index(each)) if each in listed else key
                yield Fault(place, f"{name} has no traffic {each!r}", nearest_names(each, known))
            elif engine := environment.traffic_engine:
                place, is_recorded = ("environment", "traffic_engine"), known[each].recording is not None
                yield from errors_of(place, check_engine, engine, each, is_recorded, name)


def _places(experiment: Experiment) -> Iterator[tuple[tuple[str | int, ...], str, tuple[str, ...]]]:
    """Yield key and name of each scenario, and the names of its traffic."""
    for number, task in enumerate(experiment.tasks):
        for name in task.trained_on:
            yield ("tasks", number), name, (*experiment.traffic, *task.train_traffic)
        for name in task.validated_on if task.validation else ():
            yield ("tasks", number), name, experiment.traffic
        for each in task.test:
            for name in each.scenarios:
                yield ("tasks", number), name, (each.traffic,) if each.traffic else experiment.traffic
