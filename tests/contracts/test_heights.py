"""Roads above each other: what is on one does not meet what is on the other."""

from contextlib import closing

import numpy as np
import pytest

from smarts.agents import ActionSpaceType, AgentInterface, NeighborhoodVehicles, Waypoints
from smarts.env import HiWayEnv
from smarts.observations import FEATURES
from smarts.observations.arrays import ArrayObservation
from smarts.roads.scene import Scene
from smarts.sensors import SENSORS
from smarts.types.mission import AgentMission
from smarts.types.vehicles import Owner
from tests.contracts.test_sensors import observe
from tests.maps import bridge
from tests.unit.observations.test_features import context_of
from tests.worlds import Car, world_of

BRIDGE = (
    """<nodes>
    <node id="w" x="-150" y="0"/> <node id="e" x="150" y="0"/>
    <node id="s" x="0" y="-150" z="8"/> <node id="n" x="0" y="150" z="8"/>
</nodes>""",
    """<edges>
    <edge id="we" from="w" to="e" speed="14"/>
    <edge id="sn" from="s" to="n" speed="14"/>
</edges>""",
)
"""A road from the west to the east, and one from the south to the north 8 m above it."""
ARC = " ".join(
    f"{100 + 40 * np.cos(a):.2f},{40 + 40 * np.sin(a):.2f},{12 * (100 + 40 * (a + np.pi / 2)) / 428.5:.3f}"
    for a in np.linspace(-np.pi / 2, np.pi, 60)
)
RAMP = (
    """<nodes> <node id="a" x="0" y="0"/> <node id="b" x="60" y="-100" z="12"/> </nodes>""",
    f"""<edges>
    <edge id="ramp" from="a" to="b" speed="14" spreadType="center" shape="0,0,0 {ARC} 60,-100,12"/>
</edges>""",
)
"""A road that climbs 12 m in 428.5 m and crosses itself, after 60 m and after 328.5 m."""
SCRIPT = """
from pathlib import Path
from smarts.sstudio import gen_scenario, types as t

flows = [t.Flow(t.Route((edge, 0, 0), (edge, 0, "max")), rate=3000, actors={{t.TrafficActor("car"): 1.0}})
         for edge in {flows}]
missions = [t.Mission(t.Route((edge, lane, begin), (edge, lane, end)))
            for edge, lane, begin, end in {missions}]
gen_scenario(
    t.Scenario(traffic={{"basic": t.Traffic(flows=flows, warm_up=20)}}, ego_missions=missions),
    output_dir=Path(__file__).parent,
)
"""
LANER = AgentInterface(
    action=ActionSpaceType.Lane,
    waypoint_paths=Waypoints(),
    neighborhood_vehicle_states=NeighborhoodVehicles(),
    max_episode_steps=600,
)


def write(folder, net, flows, *missions):
    folder.mkdir(exist_ok=True)
    for suffix, text in zip(("nod", "edg"), net, strict=True):
        (folder / f"map.{suffix}.xml").write_text(text)
    (folder / "scenario.py").write_text(SCRIPT.format(flows=flows, missions=missions))
    return folder


def play(env, seed, actions):
    """Return the observations of one episode by agent, and the outcomes."""
    now, _ = env.reset(seed=seed)
    seen, outcomes, done = [now], {}, False
    while not done:
        now, _, terminated, truncated, infos = env.step({name: actions[name] for name in now})
        seen.append(now)
        outcomes |= {name: infos[name]["outcome"] for name in now if terminated[name] or truncated[name]}
        done = terminated["__all__"] or truncated["__all__"]
    return seen, outcomes


def test_agents_pass_below_a_bridge_full_of_traffic(tmp_path):
    folder = write(tmp_path / "below", BRIDGE, ["sn"], ("we", 0, 60, 290))
    with closing(HiWayEnv([folder], {"a": LANER})) as env:
        for seed in range(2):
            seen, outcomes = play(env, seed, {"a": "keep_lane"})
            assert outcomes == {"a": "goal"}
            assert not any(now["a"].neighborhood_vehicle_states for now in seen)
            assert {now["a"].ego_vehicle_state.position[2] for now in seen} == {0.0}


def test_an_agent_drives_up_a_ramp_that_crosses_itself(tmp_path):
    folder = write(tmp_path / "ramp", RAMP, [], ("ramp", 0, 10, 420))
    with closing(HiWayEnv([folder], {"a": LANER})) as env:
        seen, outcomes = play(env, 1, {"a": "keep_lane"})
    assert outcomes == {"a": "goal"}
    egos = [now["a"].ego_vehicle_state for now in seen]
    s = np.array([ego.lane_position.s for ego in egos])
    assert np.abs(np.diff(s)).max() < 2.0
    assert max(abs(ego.lane_position.t) for ego in egos) < 1.0
    heights = [ego.position[2] for ego in egos]
    np.testing.assert_allclose(heights, 12.0 * s / 428.5, atol=0.1)
    # The waypoints are those ahead of it, not those of the road above or below.
    for now in seen:
        path = now["a"].waypoint_paths[0]
        assert path[0].dist_to(now["a"].ego_vehicle_state.position) < 1.5


@pytest.mark.parametrize(("edge", "axis"), [("we", 0), ("sn", 1)])
def test_traffic_stops_behind_an_agent_on_its_own_road_only(tmp_path, edge, axis):
    """The agent stands where the other road is above or below it."""
    folder = write(tmp_path / "standing", BRIDGE, ["we", "sn"], (edge, 0, 155, 290))
    with closing(HiWayEnv([folder], {"a": LANER})) as env:
        env.reset(seed=1)
        for _ in range(250):
            env.step({"a": "slow_down"})
        vehicles = env._env.runner.world.vehicles.of(0)
        agent = int(np.flatnonzero(vehicles.owner == Owner.AGENT)[0])
        is_here = np.abs(vehicles.height - vehicles.height[agent]) < 1.0
        here, there = (
            np.flatnonzero((vehicles.owner == Owner.TRAFFIC) & side) for side in (is_here, ~is_here)
        )
        assert vehicles.height[agent] == (8.0 if edge == "sn" else 0.0)
        assert vehicles.position[here, axis].max() < vehicles.position[agent, axis] < 10.0
        assert vehicles.speed[here].min() < 0.1
        there = there[vehicles.position[there, 1 - axis] > -100.0]
        assert vehicles.position[there, 1 - axis].max() > 100.0
        assert vehicles.speed[there].min() > 8.0


ROUTE = AgentMission(route=("below",))
OWN = Car(-8.0, 0.0, speed=5.0, mission=ROUTE, height=0.0)


def scene_with(*cars):
    made = world_of([OWN, *cars], maps=[bridge()], agents=2)
    return made, Scene(made.world, made.atlas, made.routes)


def above(height):
    """Return a car across the agent's lane 8 m before it; with height 8, it is on the bridge."""
    return Car(0.0, 0.5, np.pi / 2, 5.0, height=height)


@pytest.mark.parametrize("name", SENSORS)
def test_no_sensor_sees_a_vehicle_above(name):
    sensor = SENSORS[name]()
    alone, with_other = (
        observe(sensor, scene_with(*cars)[1], [[True, False]]) for cars in ([], [above(8.0)])
    )
    for field in alone:
        np.testing.assert_array_equal(alone[field], with_other[field])


@pytest.mark.parametrize(
    "name",
    [
        "neighborhood_vehicle_states",
        "lidar_point_cloud",
        "occupancy_grid_map",
        "top_down_rgb",
        "occlusion_map",
    ],
)
def test_sensors_see_a_vehicle_of_the_same_level(name):
    sensor = SENSORS[name]()
    alone, with_other = (
        observe(sensor, scene_with(*cars)[1], [[True, False]]) for cars in ([], [above(0.0)])
    )
    assert any((alone[field] != with_other[field]).any() for field in alone)


@pytest.mark.parametrize("name", FEATURES)
def test_no_feature_sees_a_vehicle_above(name):
    seen = []
    for cars in ([], [above(8.0)]):
        observation = ArrayObservation(context_of(scene_with(*cars)[0]), {"frames": 1, "features": [name]})
        observation.observe(np.ones((1, 1), np.bool_))
        seen.append({field.name: observation.arrays[field.name].copy() for field in observation.fields})
    for field in seen[0]:
        np.testing.assert_array_equal(seen[0][field], seen[1][field])
