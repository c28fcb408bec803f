"""The paper's programmatic interface, in its own loop and in small."""

from contextlib import closing
from dataclasses import dataclass, field
from typing import Any

import gymnasium
import pytest

from benchmark.metrics import Episode, Metric
from smarts.agents.interface import AgentInterface
from smarts.agents.spec import AgentSpec
from smarts.errors import SmartsError
from smarts.types.actions import ActionSpaceType
from tests.raising import raises


def log(metric, *steps, episode: Any = 0):
    """Log decisions of agent "a": reward, and outcome "" while it goes on."""
    for action, reward, outcome in steps:
        infos = {"a": {"outcome": outcome} if outcome else {}}
        metric.log_step(
            {"a": None}, {"a": action}, {"a": reward}, {"a": bool(outcome)}, infos, episode=episode
        )


@dataclass
class Jolts(Episode):
    """Keeps the speeds as well."""

    speeds: list[float] = field(default_factory=list)

    def record_step(self, **step: Any) -> None:
        super().record_step(**step)
        self.speeds += [info["env_obs"].ego_vehicle_state.speed for info in step["infos"].values()]


class SpeedMetric(Metric):
    episode = Jolts

    def compute(self) -> dict[str, float]:
        speeds = [speed for episode in self.episodes.values() for speed in episode.speeds]
        return super().compute() | {"top_speed": max(speeds)}


def test_the_papers_loop():
    interface = AgentInterface(action=ActionSpaceType.Lane, max_episode_steps=30)
    env: Any = gymnasium.make(
        "smarts.env:hiway-v0",
        scenarios=["two_way"],
        agent_specs={"a": AgentSpec(interface=interface)},
        decision_interval=5,
        disable_env_checker=True,
    )
    metric = SpeedMetric(num_episodes=1)
    with closing(env):
        observations, _ = env.reset(seed=1)
        done = False
        while not done:
            actions = dict.fromkeys(observations, "keep_lane")
            observations, rewards, terminated, truncated, infos = env.step(actions)
            dones = {name: terminated[name] or truncated[name] for name in terminated}
            metric.log_step(observations, actions, rewards, dones, infos, episode=0)
            done = dones["__all__"]
    found = metric.compute()
    assert found["ended_time_out"] == 1.0
    assert found["decision_rate"] == pytest.approx(2.0)
    assert 2.0 < found["progress_speed"] <= found["top_speed"] < 20.0
    assert found["goal_distance"] > 0.0


def test_episodes_are_objects():
    """Two that are equal in content, as all are at first, are still two."""
    metric, episodes = Metric(num_episodes=2), [Episode(), Episode()]
    for outcome in ("", "goal"):
        for episode in episodes:
            log(metric, (0, 1.0, outcome), episode=episode)
    assert all(given is kept for given, kept in zip(episodes, metric.episodes.values(), strict=True))
    assert [episode.steps for episode in episodes] == [2, 2]
    assert metric.compute()["return"] == 2.0
    with raises(SmartsError, "Metric.log_step", values=[2]):
        log(metric, (0, 0.0, ""), episode=Episode())


def test_who_still_drives_has_timed_out_and_may_drive_on():
    metric = Metric(num_episodes=4)
    log(metric, (0, 1.0, ""), (0, 1.0, ""), episode="cut short")
    log(metric, (0, 1.0, ""), (0, 1.0, "goal"), episode="goal")
    log(metric, (0, 1.0, ""), (0, 1.0, "time_out"), episode="time-out")
    log(metric, (0, 1.0, ""), (0, 1.0, "collision"), episode="collision")
    found = metric.compute()
    assert found["return"] == 2.0
    assert (found["ended_time_out"], found["unfinished"]) == (0.5, 0.25)
    assert found["completion_rate"] == found["collision_rate"] == 0.25
    ends = (value for name, value in found.items() if name.startswith("ended_"))
    assert sum(ends) + found["completion_rate"] + found["collision_rate"] == 1.0
    log(metric, (0, 1.0, "goal"), episode="cut short")
    found = metric.compute()
    assert (found["completion_rate"], found["unfinished"]) == (0.5, 0.0)
