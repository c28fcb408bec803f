"""Environments with agents by name: results, errors, and settings."""

import numpy as np
from ray.rllib.env.env_context import EnvContext

from smarts.agents import ActionSpaceType, AgentInterface, AgentSpec, AgentType
from smarts.env import HiWayEnv, RLlibHiWayEnv, VectorHiWayEnv, hiway_parallel_env
from smarts.errors import SmartsError
from smarts.sim.assembly import Options
from smarts.sim.episode_files import RecordedEpisode, episodes_in
from tests.raising import raises

LANER = AgentInterface.from_type(AgentType.Laner, max_episode_steps=400)


def specs(*names, interface=LANER, **adapters):
    return {name: AgentSpec(interface=interface, **adapters) for name in names}


def test_a_loop_that_acts_for_all_it_has_observations_of(closing):
    """As in the paper's multi-agent example: the last observations still get an action."""
    env = closing(HiWayEnv(["intersection"], specs("a", "b", "c", "d")))
    observations, _ = env.reset(seed=3)
    ended, steps = {}, 0
    terminated = {"__all__": False}
    while not terminated["__all__"]:
        observations, _, terminated, truncated, infos = env.step(dict.fromkeys(observations, "keep_lane"))
        steps += 1
        for name in observations:
            assert name not in ended, "an agent is in the results after its end"
            if terminated[name] or truncated[name]:
                ended[name] = infos[name]["outcome"]
    assert set(ended) == {"a", "b", "c", "d"}
    assert steps < 450
    assert env.step({"a": "keep_lane"})[0] == {}


def test_only_the_traffic_that_was_asked_for(tmp_path):
    options = {"traffic": ["random_social_vehicles"], "simulation": Options(record=tmp_path)}
    env = hiway_parallel_env(["loop"], 1, **options)
    for _ in range(3):
        env.reset()
    env.close()
    played = [RecordedEpisode(folder).facts["traffic"] for folder in episodes_in(tmp_path)]
    assert played == ["random_social_vehicles"] * 3
    with raises(SmartsError, values=["no_such"]):
        hiway_parallel_env(["loop"], 1, traffic=["no_such"])


def test_seeds_and_episodes(closing):
    env = closing(HiWayEnv(["intersection", "double_merge"], specs("a", "b"), seed=5))

    def start(**options):
        observations, _ = env.reset(**options)
        return tuple(observations["a"].ego_vehicle_state.position[:2])

    first, second = start(), start()
    assert first != second
    assert [start(seed=5), start(), start(seed=6) != first] == [first, second, True]


def test_agents_with_different_interfaces_side_by_side(closing):
    mixed = {
        "lane": LANER,
        "pedals": LANER.replace(action=ActionSpaceType.Continuous, neighborhood_vehicle_states=True),
        "lane again": LANER,
    }
    env = closing(hiway_parallel_env(["two_way"], mixed, observation="raw"))
    assert env.possible_agents == list(mixed)
    observations, _ = env.reset(seed=1)
    assert "neighborhood_vehicle_states" in observations["pedals"]
    assert "neighborhood_vehicle_states" not in observations["lane again"]
    before = {name: seen["ego_vehicle_state"]["speed"] for name, seen in observations.items()}
    for _ in range(6):
        observations, *_ = env.step({"lane": 1, "pedals": np.array([1.0, 0.0, 0.0]), "lane again": 1})
    after = {name: seen["ego_vehicle_state"]["speed"] for name, seen in observations.items()}
    assert after["pedals"] > before["pedals"] + 1.0
    assert after["lane"] < max(before["lane"], 0.2)
    assert after["lane again"] < max(before["lane again"], 0.2)


def test_each_environment_runner_of_rllib_plays_episodes_of_its_own(closing):
    """Those of its world; a seed begins with the same ones in all of them."""
    together = closing(VectorHiWayEnv(3, ["intersection"], 2)).reset().observations[0][""]
    seeded = []
    for index in range(3):
        config = EnvContext({"scenarios": ["intersection"], "agents": 2}, worker_index=index)
        env = closing(RLlibHiWayEnv(config))
        np.testing.assert_array_equal([*env.reset()[0].values()], together[index])
        seeded.append([*env.reset(seed=7)[0].values()])
    assert not np.array_equal(together[0], together[1])
    np.testing.assert_array_equal(seeded[0], seeded[1])
