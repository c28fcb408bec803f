"""RLlib's callbacks per episode: when they are called, with what, and that they can log."""

from ray.rllib.callbacks.callbacks import RLlibCallback

import algorithms
from algorithms.joint.runner import JointEnvRunner
from tests.games.games import Broken, Constant


class Diary(RLlibCallback):
    """Writes down what it is told, and logs."""

    def on_episode_start(self, *, episode, **given):  # pyright: ignore[reportIncompatibleMethodOverride]
        episode.custom_data["told"] = []
        assert episode.length == 0
        assert given["env"].num_envs == 2
        assert "agent_0" in given["rl_module"]
        given["metrics_logger"].log_value("started", 1, reduce="sum")

    def on_episode_step(self, *, episode, **given):  # pyright: ignore[reportIncompatibleMethodOverride]
        episode.custom_data["told"].append((given["env_index"], episode.rewards, episode.is_done))

    def on_episode_end(self, *, episode, **given):  # pyright: ignore[reportIncompatibleMethodOverride]
        told = episode.custom_data["told"]
        assert {copy for copy, _, _ in told} == {given["env_index"]} == {episode.env_index}
        assert [done for _, _, done in told] == [False] * 9 + [True]
        assert all(rewards == {"agent_0": 1.0, "agent_1": 1.0} for _, rewards, _ in told)
        assert episode.returns == {"agent_0": 10.0, "agent_1": 10.0}
        assert (episode.env_steps(), episode.agent_steps(), episode.get_return()) == (10, 20, 20.0)
        given["metrics_logger"].log_value("told", len(told), reduce="sum")
        given["metrics_logger"].log_value("ended", 1, reduce="sum")


def runner_of(env, envs=2, env_config=None, **callbacks):
    """Return an environment runner with callbacks."""
    config = algorithms.config("ppo").environment(env, env_config=env_config or {}).training(hidden=(8,))
    config.env_runners(num_env_runners=0, num_envs_per_env_runner=envs, rollout_fragment_length=16)
    config.callbacks(**callbacks).debugging(seed=0).validate()
    return JointEnvRunner(config=config, worker_index=0, num_workers=0)


def sampled(runner):
    """Return the results of a fragment by name."""
    runner.sample()
    return {name: stats.peek() for name, stats in runner.get_metrics().items() if hasattr(stats, "peek")}


def test_every_episode_starts_steps_and_ends():
    runner = runner_of(Constant, callbacks_class=Diary)
    first, second = sampled(runner), sampled(runner)
    # Two environments: 16 steps end an episode of ten each, 32 steps two more; every end starts another.
    assert [r["ended"] for r in (first, second)] == [2, 4]
    assert [r["told"] for r in (first, second)] == [20, 40]
    assert [r["started"] for r in (first, second)] == [4, 4]
    assert first["num_episodes"] == 2


def test_functions_are_called_too_and_broken_episodes_do_not_end():
    calls = []
    runner = runner_of(
        Broken,
        env_config={"raise_at": 3, "chance": 0.5},
        on_episode_start=lambda episode, **kwargs: calls.append(("start", episode.id_)),
        on_episode_end=lambda episode, **kwargs: calls.append(("end", episode.id_)),
    )
    result = sampled(runner)
    started = [identity for kind, identity in calls if kind == "start"]
    ended = [identity for kind, identity in calls if kind == "end"]
    failed = result["num_failed_envs_lifetime"]
    assert failed > 0
    assert len(ended) == result["num_episodes"]
    assert len(started) == len(set(started)) == 2 + len(ended) + failed
    assert set(ended) < set(started)
