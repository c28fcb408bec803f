"""Demonstrations of recorded vehicles by hand, and the inverses of controllers."""

import math

import gymnasium as gym
import numpy as np
import pyarrow.parquet as pq
import pytest
import ray
from ray.rllib.algorithms.bc import BCConfig

from smarts.controllers.inverse import INVERSES, Motion, inverse_of
from smarts.env.demonstrations import about, demonstrate
from smarts.env.traffic_agents import TrafficAgents
from smarts.errors import ActionError, SmartsError
from smarts.recordings.tracks import write_tracks
from smarts.sstudio.build import build_scenario
from smarts.types.actions import ActionSpaceType, LaneAction
from tests.tracks import straight, track_of, tracks_of
from tests.unit.sstudio.sources import scenario, write_cross

Y = -4.8
BRAKING = 2.0


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A scenario in which a vehicle follows a slower one 30 m ahead, and brakes from 1.5 s on.

    Another one comes the other way, and changes lanes to the left at 1.25 s and back at 2.25 s.
    """
    place = tmp_path_factory.mktemp("scenarios") / "two"
    write_cross(place)
    t = np.arange(0, 3.05, 0.1)
    braked = np.maximum(t - 1.5, 0.0)
    x, zero = -80 + 10 * t - 0.5 * BRAKING * braked**2, np.zeros_like(t)
    rear = track_of("rear", np.column_stack([t, x, Y + zero, zero, 10 - BRAKING * braked]))
    y = np.interp(t, [1.0, 1.5, 2.0, 2.5], [4.8, 1.6, 1.6, 4.8])
    changing = track_of("changing", np.column_stack([t, 80 - 10 * t, y, math.pi + zero, 10 + zero]))
    front = straight("front", 0.0, 3.0, -45.0, Y, 8.0)
    write_tracks(tracks_of([rear, front, changing]), place / "recording")
    recorded = 't.Traffic([], engine="Recorded", recording=t.Recording("recording", mode="log"))'
    place.joinpath("scenario.py").write_text(scenario(f'traffic={{"recorded": {recorded}}}'))
    return place


@pytest.fixture(scope="module")
def data(folder):
    out = folder.parent / "data.parquet"
    demonstrate(folder, out, observation=["speed", "car_following"])
    return out


def test_a_recorded_vehicle_is_observed_and_its_motion_explained(data):
    rows = pq.read_table(data).to_pandas()
    rear = rows[rows.agent_id == "history-vehicle-rear"]
    # Observed from the second decision on; from 2.5 to 3.0 s is the last one.
    assert rear.t.tolist() == [1, 2, 3, 4, 5]
    assert rear.truncateds.tolist() == [False] * 4 + [True]
    acceleration, yaw_rate = np.array(rear.actions.tolist()).T
    np.testing.assert_allclose(acceleration, [0, 0, -BRAKING, -BRAKING, -BRAKING], atol=1e-6)
    np.testing.assert_allclose(yaw_rate, 0, atol=1e-6)
    speed, has_leader, gap, share = np.array(rear.obs.tolist())[:, :4].T
    np.testing.assert_allclose(speed * 30, [10, 10, 10, 9, 8], atol=1e-4)
    assert (has_leader == 1).all()
    # The gap between bumpers is 30 m at the beginning, and closes by 2 m/s.
    np.testing.assert_allclose(np.expm1(gap[:3] * np.log1p(150)), [29, 28, 27], atol=1e-3)
    np.testing.assert_allclose(share[:3], 10 / (10 + np.array([29, 28, 27]) + 0.1), atol=1e-5)
    np.testing.assert_array_equal(np.array(rear.obs.tolist())[1:], np.array(rear.new_obs.tolist())[:-1])
    said = about(data)
    assert (said["licence"], said["action"], said["decision_interval"]) == ("CC0", "Direct", 5)
    assert said["median_residual"] < 1e-3


def test_changes_of_lanes_are_actions(folder, tmp_path):
    demonstrate(folder, tmp_path / "data", action="Lane")
    rows = pq.read_table(tmp_path / "data").to_pandas()
    found = rows[rows.agent_id == "history-vehicle-changing"].set_index("t").actions
    assert [found[2], found[4]] == [LaneAction.change_lane_left, LaneAction.change_lane_right]
    assert set(found[[1, 3, 5]]) <= {LaneAction.keep_lane, LaneAction.slow_down}


def test_actions_that_are_carried_out_are_found_again(folder):
    given = {"Direct": ([[1.5, 0.2]], 1e-6), "AlongPath": ([[-1.5]], 1e-6)}
    given["LaneWithContinuousSpeed"] = [[11.0, 0.0]], 0.1  # its command changes by steps of 0.1 s
    for name, (action, allowed) in given.items():
        agents = TrafficAgents(
            build_scenario(folder), "recorded", ["speed"], ActionSpaceType[name], drives=True
        )
        agents.reset()
        agents.step()
        decision = agents.decide()
        (rear,) = [at for at, slot in enumerate(decision.slot) if agents.name(slot).endswith("rear")]
        slot, vehicles = decision.slot[rear : rear + 1], agents.vehicles
        before = [column[slot].copy() for column in (vehicles.position, vehicles.heading, vehicles.speed)]
        agents.step(decision, np.tile(np.array(action, float), (len(decision.slot), 1)))
        after = [column[slot] for column in (vehicles.position, vehicles.heading, vehicles.speed)]
        motion = (np.stack(each) for each in zip(before, after, strict=True))
        more = np.zeros(1, int), np.full(1, 14.0), np.ones((1, 4), bool), 0.5
        found, residual = inverse_of(name)(Motion(*motion, *more))
        np.testing.assert_allclose(found, action, atol=allowed)
        assert residual[0] < allowed
        agents.close()


def test_lane_actions_are_the_nearest_ones():
    def motion(before, after, side, allowed=True):
        speed = np.array([[before], [after]], float)
        position = np.zeros((2, 1, 2))
        position[1, 0, 0] = 0.25 * (before + after)
        mask = np.full((1, 4), allowed)
        return Motion(position, np.zeros((2, 1)), speed, np.array([side]), np.full(1, 14.0), mask, 0.5)

    lane = INVERSES["Lane"]
    assert [int(lane(motion(*each))[0][0]) for each in [(14, 14, 0), (10, 8.9, 0), (0, 0, 0)]] == [0, 1, 1]
    assert int(lane(motion(10, 10, 1))[0][0]) == 2
    assert int(lane(motion(10, 10, -1))[0][0]) == 3
    assert int(lane(motion(10, 10, 1, allowed=False))[0][0]) == 0
    target, change = INVERSES["LaneWithContinuousSpeed"](motion(10, 11 - math.exp(-0.75), 1))[0][0]
    assert (target, change) == (pytest.approx(11.0), 1)


def test_what_cannot_be_demonstrated_is_refused(folder, tmp_path):
    with pytest.raises(ActionError, match="use one of Direct"):
        demonstrate(folder, tmp_path / "data", action="MPC")
    with pytest.raises(SmartsError, match="agent_index"):
        demonstrate(folder, tmp_path / "data", observation="benchmark")


def test_rllibs_bc_learns_from_the_file(data):
    ray.init(num_cpus=4, include_dashboard=False)  # Ray Data holds two for its actors
    try:
        config = (
            BCConfig()
            .environment(
                observation_space=gym.spaces.Box(-1, 1, (9,)),
                action_space=gym.spaces.Box(-10, 10, (2,)),
            )
            .offline_data(input_=[str(data)], dataset_num_iters_per_learner=1)
            .training(train_batch_size_per_learner=8)
        )
        algo = config.build_algo()
        learned = algo.train()["learners"]["default_policy"]
        algo.stop()
        assert np.isfinite(learned["policy_loss"])
        assert learned["num_module_steps_trained"] > 0
    finally:
        ray.shutdown()
