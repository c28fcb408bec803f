"""Vehicles, roads and traffic of experiments: what the keys of `environment` change."""

import numpy as np
import pytest

from benchmark.experiment.config import Evaluation, TrainingTask
from benchmark.experiment.environment import Environment
from benchmark.experiment.runs import TaskSetting
from benchmark.running.environments import environment
from benchmark.running.played import held_out_of
from smarts.env.vector import VectorHiWayEnv
from smarts.types.traffic import TRAFFIC_ENGINES
from smarts.types.vehicles import Owner

TASK = TrainingTask(name="loop", scenarios=["loop"])
BRAKE = np.array([[[0.0, 1.0, 0.0]]], np.float32)


def cell(**given):
    return TaskSetting(TASK, "no_social_vehicles", Environment(agents=1, **given), Evaluation(), num_envs=1)


def speeds(env, actions, decisions):
    """Return the speed of the only agent's vehicle at each decision [m/s], and its length [m]."""
    found = []
    try:
        env.reset(3)
        world = env._runner.world
        for _ in range(decisions):
            slot = world.agents.slot[0, 0]
            found.append(float(world.vehicles.speed[0, slot]))
            length = float(world.vehicles.length[0, slot])
            env.step([actions])
    finally:
        env.close()
    return np.array(found), length


@pytest.mark.parametrize("model", ["bullet", "dynamic"])
def test_a_slippery_road_brakes_by_its_friction(model):
    dry, _ = speeds(environment(cell(action="Continuous", vehicle_model=model)), BRAKE, 3)
    icy, _ = speeds(environment(cell(action="Continuous", vehicle_model=model, friction=0.2)), BRAKE, 3)
    assert dry[0] == icy[0] > 5.0
    slowed = icy[0] - icy[2]  # within 1 s
    assert 0.7 * 0.2 * 9.81 < slowed < 1.05 * 0.2 * 9.81
    assert dry[0] - dry[2] > 2 * slowed


def test_a_bus_is_longer_and_the_default_is_the_benchmarks():
    keep = np.zeros((1, 1), np.int64)
    _, bus = speeds(environment(cell(vehicle="bus")), keep, 1)
    default, car = speeds(environment(cell()), keep, 8)
    plain, same = speeds(VectorHiWayEnv(1, ["loop"], 1, traffic=["no_social_vehicles"]), keep, 8)
    assert bus > car + 2.0
    assert car == same
    np.testing.assert_array_equal(default, plain)


ENGINE = """
from smarts.providers.constant_speed import ConstantSpeed

class Steady(ConstantSpeed):
    pass
"""


@pytest.mark.parametrize("engine", [None, "ConstantSpeed", "own_steady:Steady"])
def test_the_traffic_engine_drives_training_tests_and_held_out_variations(engine, tmp_path, monkeypatch):
    monkeypatch.setattr(TRAFFIC_ENGINES, "_own", {})
    own = tmp_path / "own_steady.py"
    own.write_text(ENGINE)
    is_own = engine == "own_steady:Steady"
    task = TrainingTask(name="intersection", scenarios=["intersection"])
    given = Environment(agents=1, traffic_engine=engine)
    played = TaskSetting(
        task,
        "random_social_vehicles",
        given,
        Evaluation(held_out_episodes=1),
        num_envs=1,
        imports=(str(own),) if is_own else (),
    )
    named = played.content().get("own_code", {})
    assert [*named] == ([engine] if is_own else [])
    for scenario in (None, next(held_out_of(played))):
        env = environment(played, scenarios=scenario and [scenario])
        try:
            env.reset(3)
            assert [start.engine for start in env.episodes] == [engine or "SUMO"]
            world = env._runner.world
            social = np.flatnonzero(world.vehicles.owner[0] == Owner.TRAFFIC)
            before = world.vehicles.speed[0, social].copy()
            assert len(social) > 0
            env.step([np.zeros((1, 1), np.int64)])
            is_constant = np.array_equal(world.vehicles.speed[0, social], before)
            assert is_constant == (engine is not None)
        finally:
            env.close()
