"""Vehicles, roads, traffic and time of experiments: what the keys of `environment` change."""

from contextlib import closing

import numpy as np
import pytest

from benchmark.experiment.config import read_experiment
from benchmark.experiment.environment import Environment
from benchmark.experiment.models import Evaluation, TrainingTask
from benchmark.experiment.runs import TaskSetting, task_settings_of
from benchmark.running.environments import create, environment
from benchmark.running.experiment import check_task_settings
from benchmark.running.played import held_out_of
from smarts.config import ConfigError
from smarts.env.vector import VectorHiWayEnv
from smarts.errors import TrafficError
from smarts.types.actions import LaneAction
from smarts.types.traffic import TRAFFIC_ENGINES
from smarts.types.vehicles import Owner
from tests.unit.sstudio import sources

TASK = TrainingTask(name="loop", scenarios=["loop"])
BRAKE = np.array([[[0.0, 1.0, 0.0]]], np.float32)


def cell(**given):
    return TaskSetting(TASK, "no_social_vehicles", Environment(agents=1, **given), Evaluation(), num_envs=1)


def speeds(env, actions, decisions):
    """Return the speed of the only agent's vehicle at each decision [m/s], and its length [m]."""
    found = []
    with closing(env):
        env.reset(3)
        world = env._runner.world
        for _ in range(decisions):
            slot = world.agents.slot[0, 0]
            found.append(float(world.vehicles.speed[0, slot]))
            length = float(world.vehicles.length[0, slot])
            env.step([actions])
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
from smarts.providers.native.engine import Native

class Steady(Native):
    def step(self, env_mask):
        pass
"""


@pytest.mark.parametrize("engine", [None, "Native", "own_steady:Steady"])
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
        with closing(environment(played, scenarios=scenario and [scenario])) as env:
            env.reset(3)
            assert [start.engine for start in env.episodes] == [engine or "SUMO"]
            world = env._runner.world
            social = np.flatnonzero(world.vehicles.owner[0] == Owner.TRAFFIC)
            before = world.vehicles.speed[0, social].copy()
            assert len(social) > 0
            env.step([np.zeros((1, 1), np.int64)])
            is_constant = np.array_equal(world.vehicles.speed[0, social], before)
            assert is_constant == is_own


@pytest.fixture
def read(tmp_path):
    """Return a function that reads an experiment with some text in the place of its tasks and environment."""

    def read(environment, tasks="two_way", traffic="random_social_vehicles", scripted="parked"):
        file = tmp_path / "mine.yaml"
        file.write_text(
            f"algorithms: []\ntasks: [{tasks}]\ntraffic: [{traffic}]\nscripted: [{scripted}]\n"
            f"environment: {{agents: 1{environment}}}\n"
        )
        return read_experiment(file)

    return read


@pytest.mark.parametrize(("given", "ended"), [("", {}), (", time_limit: 1.5", {0: 15})])
def test_an_episode_ends_in_time(read, given, ended):
    # Three decisions of five steps.
    (setting,) = task_settings_of(read(given, "loop", "no_social_vehicles"))
    with closing(environment(setting, num_envs=1)) as env:
        env.reset(1)
        for _ in range(3):
            now = env.step([np.full((1, 1), LaneAction.keep_lane)])
    assert {row: metrics["steps"] for row, metrics in now.metrics.items()} == ended


def test_an_experiment_of_nothing_is_refused(read):
    with pytest.raises(ConfigError, match="there is nothing to run"):
        read("", scripted="")


def sumo_seconds(env):
    """Return how far SUMO is after the first of the world's steps, from the end of the warm-up [s]."""
    with closing(env):
        env.reset(1)
        (simulation,) = env._runner.simulation._stages.traffic._simulations
        time = simulation._library.simulation.getTime
        begin = time()
        simulation.step()
        return time() - begin


def test_training_has_the_longer_traffic_step_and_all_else_the_exact_one(read):
    (setting,) = task_settings_of(read(", traffic_step: 0.5"))
    training = {"task_setting": setting, "num_envs": 1, "discount": None}
    assert sumo_seconds(create(training)) == pytest.approx(0.5)
    assert sumo_seconds(environment(setting, num_envs=1)) == pytest.approx(0.1)


def driven_by(env):
    """Return the traffic engine, and how an agent's vehicle moves."""
    with closing(env):
        env.reset(1)
        return env.episodes[0].engine, env._runner.simulation._stages.vehicles._models[0]


@pytest.mark.parametrize(("model", "trained"), [("bullet", "kinematic"), ("dynamic", "dynamic")])
def test_training_alone_is_native(read, model, trained):
    (setting,) = task_settings_of(read(f", training_traffic: native, vehicle_model: {model}"))
    training = {"task_setting": setting, "num_envs": 1, "discount": None}
    assert driven_by(create(training)) == ("Native", trained)
    assert driven_by(environment(setting, num_envs=1)) == ("SUMO", model)
    assert "training_traffic" not in Environment().content()


@pytest.mark.parametrize(
    "given", ["learn_in_bubbles: true, episode_time: 60", "social_agents: [{agent: 'smarts.zoo:idm-v0'}]"]
)
def test_agents_learn_natively_beside_others(read, given):
    where = ("examples/left_turn_bubble", "crossing") if "bubbles" in given else ()
    (setting,) = task_settings_of(read(f", training_traffic: native, {given}", *where))
    with closing(create({"task_setting": setting, "num_envs": 1, "discount": None})) as env:
        now, seen = env.reset(1), 0
        for _ in range(40):
            seen += int(now.alive.sum())
            now = env.step([np.full((1, 1), LaneAction.keep_lane)])
            assert not now.failed
    assert seen


OWN_ROUTES = """<routes>
    <routeDistribution id="some"><route edges="from_west to_east"/></routeDistribution>
</routes>
"""


def test_a_scenario_with_what_native_lacks_is_an_error_before_training(read, tmp_path):
    folder = sources.write_cross(tmp_path / "own")
    (folder / "own.rou.xml").write_text(OWN_ROUTES)
    own = 't.Traffic(flows=[], route_files=["own.rou.xml"])'
    script = sources.scenario(f'traffic={{"own": {own}}}, ego_missions=[t.Mission(south_north)]')
    (folder / "scenario.py").write_text(script)
    check_task_settings(read("", folder, "own"))
    with pytest.raises(TrafficError, match="does not drive routeDistribution"):
        check_task_settings(read(", training_traffic: native", folder, "own"))


@pytest.mark.parametrize(
    ("given", "where", "place"),
    [
        ("training_traffic: native, traffic_step: 0.5", (), "environment.training_traffic"),
        ("training_traffic: native, friction: 0.5", (), "environment.friction"),
        ("training_traffic: native, flat_tyres: [0]", (), "environment.flat_tyres"),
        ("traffic_step: 0.05", (), "environment.traffic_step"),
        ("traffic_step: 0.5, traffic_engine: Native", (), "environment.traffic_step"),
        (
            "traffic_step: 0.5, social_agents: [{agent: 'smarts.zoo:idm-v0'}]",
            (),
            "environment.traffic_step",
        ),
        ("traffic_step: 0.5", ("examples/left_turn_bubble", "crossing"), "tasks[0]"),
    ],
)
def test_traffic_steps_that_cannot_be_are_found_in_the_file(read, given, where, place):
    with pytest.raises(ConfigError) as error:
        read(f", {given}", *where)
    assert any(place in str(problem) for problem in error.value.problems)
