"""The environments of a run: for training, validation and test."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from benchmark.experiment.environment import Driving, Host
from benchmark.experiment.runs import TaskSetting
from smarts.agents.benchmark import MAX_STEPS, benchmark_interface
from smarts.agents.criteria import DoneCriteria
from smarts.agents.interface import AgentInterface
from smarts.env.adapters import Adapter
from smarts.env.vector import VectorHiWayEnv
from smarts.observations.lists import Observed, feature_list
from smarts.registry import import_own
from smarts.sim.assembly import Options
from smarts.types.actions import ActionSpaceType

NAME = "smarts-bench"
"""Name of the training environment among RLlib's."""
DT = 0.1
"""Length of a step [s]."""


def environment(
    task_setting: TaskSetting,
    *,
    num_envs: int | None = None,
    scenarios: Mapping[str, float] | None = None,
    record: Path | None = None,
    discount: float | None = None,
    max_episode_steps: int | None = None,
    criteria: DoneCriteria | None = None,
    is_training: bool = False,
    observation: Observed | None = None,
    adapter: Adapter | None = None,
    adapter_options: Mapping[str, Any] | None = None,
    policy: str = "",
) -> Any:
    """Return a task setting's environment, a `VectorHiWayEnv`.

    Args:
        task_setting: What is played.
        num_envs: Simulations side by side, by default the task setting's.
        scenarios: Others than those of the task setting's training, and the weight of each.
        record: Folder that episodes are written to.
        discount: Discount of the learner, with which shaped rewards agree; by default that of the weights.
        max_episode_steps: Time limit of each agent, instead of the task setting's.
        criteria: What ends an agent's episode, instead of the benchmark's criteria.
        is_training: Whether agents learn in it, so that `traffic_step` and `training_traffic` hold.
        observation: Observation instead of the task setting's, with the same rewards.
        adapter: Adapter instead of the task setting's, with its options.
        adapter_options: Options of `adapter`.
        policy: Name of what drives the agents, for viewers.

    Raises:
        SmartsError: A scenario cannot be built, or the agents' observation or reward.
    """
    given, shares = task_setting.environment, scenarios or task_setting.task.trained_on
    import_own(task_setting.imports)
    reward = given.reward
    if reward is None and observation is not None:
        reward = feature_list(given.observation).reward
    if max_episode_steps is None:
        max_episode_steps = MAX_STEPS if given.time_limit is None else max(1, round(given.time_limit / DT))
    traffic = (is_training and task_setting.task.train_traffic) or (task_setting.traffic,)
    driving, engine = given.driving(), given.traffic_engine
    if is_training and given.training_traffic == "native":
        driving, engine = {name: _without_bullet(each) for name, each in driving.items()}, "Native"
    changes: dict[str, Any] = {"max_episode_steps": max_episode_steps}
    if criteria is not None:
        changes["done_criteria"] = criteria
    return VectorHiWayEnv(
        num_envs or task_setting.num_envs,
        [*shares],
        agents={name: interface_of(each).replace(**changes) for name, each in driving.items()},
        decision_interval=given.decision_interval,
        observation=given.observation if observation is None else observation,
        reward=reward,
        discount=discount,
        adapter=given.adapter if adapter is None else adapter,
        adapter_options=given.adapter_options if adapter is None else adapter_options,
        simulation=Options(
            record=record,
            policy=policy,
            friction=given.friction,
            action_latency=given.action_latency,
            traffic_engine=engine,
            traffic_step=given.traffic_step if is_training else None,
            weights=tuple(shares.values()) if len(shares) > 1 else (),
        ),
        traffic=traffic,
        social_agents=[each.model_dump() for each in given.social_agents],
        hosts=given_hosts(given.hosts),
        learn_in_bubbles=given.learn_in_bubbles,
        episode_time=given.episode_time,
    )


def given_hosts(given: Mapping[str, str | Host]) -> dict[str, Any]:
    """Return the hosts of an experiment as environments take them."""
    return {locator: each if isinstance(each, str) else each.model_dump() for locator, each in given.items()}


def _without_bullet(given: Driving) -> Driving:
    """Return how an agent drives, in a kinematic vehicle where it would be Bullet's."""
    is_bullet = given.vehicle_model == "bullet"
    return given.model_copy(update={"vehicle_model": "kinematic"}) if is_bullet else given


def interface_of(given: Driving) -> AgentInterface:
    """Return the interface of an experiment's agent; what `given` does not say is as in the benchmark."""
    return benchmark_interface(
        action=ActionSpaceType[given.action],
        vehicle_class=given.vehicle,
        vehicle_model=given.vehicle_model,
        tyre_model=given.tyre_model,
        flat_tyres=given.flat_tyres,
    )


def create(config: Any) -> Any:
    """Return the training environment for RLlib, made from the task setting and discount in `config`."""
    return environment(
        config["task_setting"],
        num_envs=config["num_envs"],
        discount=config["discount"],
        is_training=True,
        policy=config.get("policy", ""),
    )
