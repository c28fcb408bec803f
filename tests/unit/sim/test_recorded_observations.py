"""What chosen agents observe, in recordings: the same that the environment gives them."""

import numpy as np
import pytest

from smarts.agents.benchmark import benchmark_interface
from smarts.agents.options import InterfaceError
from smarts.env import HiWayEnv, VectorHiWayEnv
from smarts.errors import SmartsError
from smarts.sim import observation_notes
from smarts.sim.assembly import Options
from smarts.sim.episode_files import RecordedEpisode, episodes_in
from smarts.stream.road_map import origin_of

DECISIONS = 6


def rows_of(table):
    return [dict(zip(table, row, strict=True)) for row in zip(*table.values(), strict=True)]


@pytest.fixture(scope="module")
def seen(tmp_path_factory):
    """Return the recorded episode, and the observations of its agents by decision."""
    folder = tmp_path_factory.mktemp("episodes")
    interface = benchmark_interface(waypoints=True, neighborhood_vehicles=True, drivable_area_grid_map=True)
    options = Options(record=folder, record_observations=["b"])
    env = HiWayEnv(
        ["intersection"], {"a": interface, "b": interface}, decision_interval=5, seed=1, simulation=options
    )
    observed = [env.reset(seed=1)[0]]
    for _ in range(DECISIONS):
        observed.append(env.step(dict.fromkeys(observed[-1], "keep_lane"))[0])
    env.close()
    (path,) = episodes_in(folder)
    return RecordedEpisode(path), [each["b"] for each in observed]


def test_observations_are_those_of_the_chosen_agent(seen):
    episode, observed = seen
    rows = rows_of(episode.table("observations"))
    assert {row["agent_id"] for row in rows} == {1}
    x, y = origin_of(episode.roads())
    for name in ("waypoints", "neighbors", "grid:drivable"):
        own = [row for row in rows if row["name"] == name]
        assert [row["step"] for row in own] == [5 * n for n in range(DECISIONS + 1)]
        for row, observation in zip(own, observed, strict=True):
            values = np.asarray(row["values"])
            if name == "waypoints":
                points = [tuple(p.pos[:2]) for path in observation.waypoint_paths for p in path]
                found = values.reshape(-1, 2)
                found = found[~np.isnan(found).any(axis=1)] + (x, y)
                np.testing.assert_allclose(found, np.array(points).reshape(-1, 2), atol=1e-3)
                assert np.isnan(values[::2]).sum() == len(observation.waypoint_paths) - 1
            elif name == "neighbors":
                others = observation.neighborhood_vehicle_states
                assert len(values) == 6 * len(others)
                speeds = values.reshape(-1, 6)[:, 5]
                np.testing.assert_allclose(speeds, [each.speed for each in others], atol=1e-4)
            else:
                area = observation.drivable_area_grid_map
                # 256 x 256 cells, 4 x 4 of them averaged.
                assert area.data.shape == (256, 256, 1)
                blocks = [
                    [area.data[4 * i : 4 * i + 4, 4 * j : 4 * j + 4].mean() for j in range(64)]
                    for i in range(64)
                ]
                assert values[:3].tolist() == [64, 64, pytest.approx(4 * area.metadata.resolution)]
                np.testing.assert_allclose(values[3:].reshape(64, 64), blocks, atol=1e-6)


def grid_of(picture, resolution=0.5):
    """Return the recorded height, width, side and cells of a picture."""
    values = observation_notes._grid({"data": picture, "resolution": np.float32(resolution)}, np.zeros(2))
    height, width = map(int, values[:2])
    return height, width, values[2], values[3:].reshape(height, width, picture.shape[2])


def test_pictures_of_any_shape_are_recorded_whole():
    # 65 cells become 33 of two with the vehicle in the middle: half a cell is too much at either end.
    picture = np.arange(65.0)[:, None, None] + 100 * np.arange(65.0)[None, :, None]
    height, width, side, cells = grid_of(picture)
    assert (height, width, side) == (33, 33, 1.0)
    means = [(0 + 1 / 2 * 1) / 1.5, *[2.0 * i for i in range(1, 32)], (64 + 1 / 2 * 63) / 1.5]
    np.testing.assert_allclose(cells[:, 5, 0], np.array(means) + 100 * means[5])
    np.testing.assert_allclose(cells[7, :, 0], means[7] + 100 * np.array(means))
    # Four by 300 cells: one by 60.
    height, width, side, cells = grid_of(np.broadcast_to(np.arange(300.0)[None, :, None], (4, 300, 1)))
    assert (height, width, side) == (1, 60, 2.5)
    np.testing.assert_allclose(cells[0, :, 0], 5 * np.arange(60) + 2)


def test_terms_of_the_reward_add_up_and_features_are_recorded(tmp_path):
    # An agent that is named twice is recorded once.
    options = Options(record=tmp_path, record_observations=["agent-1", "agent-1"])
    env = VectorHiWayEnv(2, ["intersection"], 3, seed=1, simulation=options)
    step, arrays = env.reset(), []
    for _ in range(DECISIONS):
        arrays.append(step.observations[0][""][:, 1].copy())
        step = env.step([np.ones((2, 3), np.int64)])
    env.close()
    for path in episodes_in(tmp_path):
        episode = RecordedEpisode(path)
        world = int(episode.facts["world"])
        extras = rows_of(episode.table("extras"))
        terms = [row for row in extras if row["name"].startswith("reward/")]
        # Terms are recorded for all egos, observations for the chosen ones.
        assert {row["agent_id"] for row in terms} == {0, 1, 2}
        assert len({row["name"] for row in terms}) > 2
        rewards = {
            (row["step"], row["agent_id"]): row["values"][0] for row in extras if row["name"] == "reward"
        }
        sums = dict.fromkeys(rewards, 0.0)
        for row in terms:
            sums[row["step"], row["agent_id"]] += row["values"][0]
        assert len(rewards) == 3 * DECISIONS
        np.testing.assert_allclose([*sums.values()], [*rewards.values()], atol=1e-6)
        assert any(rewards.values())
        observed = rows_of(episode.table("observations"))
        assert {row["name"] for row in observed} >= {"observation"}
        own = [row["values"] for row in observed if row["name"] == "observation"]
        np.testing.assert_array_equal(own, [each[world] for each in arrays])


def test_wrong_choices_are_refused(tmp_path):
    with pytest.raises(SmartsError, match="record"):
        Options(record_observations=["agent-0"])
    with pytest.raises(SmartsError, match="list"):
        Options(record=tmp_path, record_observations="agent-0")
    with pytest.raises(InterfaceError, match="agent-7"):
        VectorHiWayEnv(1, ["loop"], 1, simulation=Options(record=tmp_path, record_observations=["agent-7"]))
