"""Entries: at once, at a time, into a vehicle of traffic; and the room that is made for them."""

from pathlib import Path

import numpy as np
import pytest

from smarts.roads.agent_routes import AgentRoutes
from smarts.roads.atlas import RoadAtlas
from smarts.roads.scene import Scene
from smarts.sim.agent_pool import AgentPool
from smarts.sim.clearing import needed_gap
from smarts.sim.entries import Entries
from smarts.sim.map_matching import MapMatcher
from smarts.sim.ownership import Ownership
from smarts.sim.transfer_rules import HandoverRules
from smarts.sstudio import types as t
from smarts.types.agent_states import AgentStatus
from smarts.types.episode import AgentStart, EpisodeStart, TakeOver
from smarts.types.events import Events, Outcome
from smarts.types.mission import AgentMission, GoalKind
from smarts.types.traffic import TrafficFiles
from smarts.types.transfers import Refusal
from smarts.types.vehicles import Owner, VehicleKind
from smarts.types.world import World
from tests.maps import Road, crossing, graph_of, straight
from tests.worlds import Willing

MISSION = AgentMission(route=("road",), goal=GoalKind.POSITION, goal_lane=0, goal_s=190.0)
ZONE = np.array([[40.0, -2.0], [60.0, -2.0], [60.0, 2.0], [40.0, 2.0]])
EVERYBODY = np.ones(1, np.bool_)


class Stage:
    """A simulation without drivers: vehicles are where the test puts them."""

    def __init__(self, graph, *starts, refused=()):
        atlas = RoadAtlas([graph])
        self.world = World(
            worlds=1, capacity=16, agents=max(1, len(starts)), lanes=len(graph.lane_ids), vias=1
        )
        self.scene = Scene(self.world, atlas, AgentRoutes(atlas, 1, max(1, len(starts))))
        willing = Willing()
        self.pool = AgentPool(self.world, self.scene.routes)
        self.ownership = Ownership(self.world, {Owner.TRAFFIC: willing, Owner.AGENT: willing}, self.pool)
        self.entries = Entries(self.world, self.ownership, self.scene.routes, self.pool)
        self.rules = HandoverRules(
            self.world, self.entries, self.pool, lambda rows, slots: np.isin(slots, [*refused])
        )
        self.matcher = MapMatcher(self.scene)
        self.events = Events.allocate(1, max(1, len(starts)))
        self.starts = starts
        self.reset()

    def reset(self, *cars, episode=0):
        self.world.clear(0)
        self.ownership.clear(0)
        self.rules.clear(0)
        files = TrafficFiles(Path("map.net.xml"))
        self.world.episode[0] = episode
        self.entries.reset(0, EpisodeStart(1, 0, episode, "test", 0, files, None, 1, 16, self.starts))
        for car in cars:
            self.add(*car)
        self.matcher.match(EVERYBODY)
        self.entries.clear_way(0)
        self._propose()

    def add(self, name, x, y=0.0, speed=0.0, heading=0.0):
        slot = self.world.registry.admit(0, name, Owner.TRAFFIC, VehicleKind.PASSENGER, 5.0, 1.8)
        vehicles = self.world.vehicles
        vehicles.position[0, slot], vehicles.speed[0, slot], vehicles.heading[0, slot] = (
            (x, y),
            speed,
            heading,
        )
        self.matcher.match(EVERYBODY)
        return slot

    def step(self, count=1):
        for _ in range(count):
            self.world.advance(EVERYBODY)
            self.ownership.apply(EVERYBODY)
            self.entries.enter(EVERYBODY)
            self.matcher.match(EVERYBODY)
            self.events.just_done[:] = False
            self._propose()

    def finish(self, agent_id, outcome):
        """End an agent's episode in the step that has just been made."""
        agents = self.world.agents
        agents.state[0, agent_id], agents.outcome[0, agent_id] = AgentStatus.DONE, outcome
        self.events.just_done[0, agent_id] = True
        self._propose()

    def names(self):
        registry = self.world.registry
        return {registry.name(0, slot) for slot in np.flatnonzero(self.world.vehicles.alive[0]).tolist()}

    def driven(self, agent_id=0):
        """Return the name of the vehicle in an agent, "" for none."""
        slot = int(self.world.agents.slot[0, agent_id])
        return self.world.registry.name(0, slot) if slot >= 0 else ""

    def _propose(self):
        self.ownership.submit(self.rules.propose(self.events, EVERYBODY))


def ego(name="ego", x=50.0, speed=0.0, **more):
    return AgentStart(name, (x, 0.0, 0.0), speed, MISSION, **more)


def test_an_agent_waits_for_another_to_leave_its_start():
    stage = Stage(straight(), ego(), ego("late", x=52.0, entry_time=0.5))
    stage.step(20)
    assert stage.world.agents.state[0, 1] == AgentStatus.WAITING
    assert stage.entries.kept_out(0) == ["late"]
    stage.world.vehicles.position[0, 0] = 120.0, 0.0
    stage.step()
    assert stage.driven(1) == "late"
    assert stage.entries.kept_out(0) == []


def test_room_is_made_by_the_difference_in_speed():
    stage = Stage(straight(), ego(x=100.0, speed=2.0))
    # 10 m/s behind 2 m/s: 10 + (100 - 4) / 6 = 26 m between the bumpers.
    assert needed_gap(10.0, 2.0) == pytest.approx(26.0)
    stage.reset(("near", 100 - 5 - 25.9, 0.0, 10.0), ("far", 100 - 5 - 26.1 - 10, 0.0, 10.0))
    assert stage.names() == {"ego", "far"}
    stage.reset(("beside", 80.0, 3.2, 10.0), ("slow", 85.5, 0.0, 1.0), ("standing", 109.0))
    assert stage.names() == {"ego", "beside"}  # within 10 m, whatever the speeds
    stage.reset(("slow", 79.0, 0.0, 1.0), ("standing", 116.0))
    assert stage.names() == {"ego", "slow", "standing"}


def test_room_is_made_across_a_junction_for_those_who_come_here():
    graph = crossing(length=80.0, gap=10.0)
    mission = AgentMission(route=("east_out",))
    start = AgentStart("ego", (14.0, -1.6, 0.0), 0.0, mission)
    stage = Stage(graph, start)
    stage.add("straight_on", -30.0, -1.6, 14.0)
    stage.add("turning", 1.6, -30.0, 14.0, np.pi / 2)
    vehicles, routes = stage.world.vehicles, stage.world.routes
    number_of = stage.scene.atlas.graphs[0].edge_number
    vehicles.route[0, 1] = routes.number(0, map(number_of, ("west_in", "east_out")))
    vehicles.route[0, 2] = routes.number(0, map(number_of, ("south_in", "north_out")))
    stage.entries.clear_way(0)
    assert stage.names() == {"ego", "turning"}


def test_a_trap_takes_the_first_vehicle_that_comes():
    stage = Stage(straight(), ego(take_over=TakeOver(areas=(ZONE,), patience=10.0)))
    slot = stage.add("comer", 20.0, 0.0, 10.0)
    stage.step(3)
    assert stage.driven() == ""
    stage.world.vehicles.position[0, slot] = 37.4, 0.0  # the front bumper at 39.9 m
    stage.step(2)
    assert stage.driven() == ""
    stage.world.vehicles.position[0, slot] = 38.0, 0.0
    stage.step()
    assert stage.driven() == ""  # seen in this step, taken over in the next
    pose = stage.world.vehicles.position[0, slot].copy()
    stage.step()
    assert stage.driven() == "comer"
    assert stage.world.vehicles.owner[0, slot] == Owner.AGENT
    assert (stage.world.vehicles.position[0, slot] == pose).all()
    assert stage.world.agents.state[0, 0] == AgentStatus.ACTIVE
    assert stage.world.vehicles.route[0, slot] == stage.world.missions.route[0, 0]
    assert stage.world.missions.route_length[0, 0] == pytest.approx(190.0 - pose[0])


def test_an_impatient_trap_puts_a_vehicle_in():
    stage = Stage(straight(), ego(take_over=TakeOver(areas=(ZONE,), patience=2.0), entry_time=1.0))
    stage.step(30)
    assert stage.driven() == ""
    stage.step()
    assert stage.driven() == "ego"


def test_a_trap_spares_names_and_vehicles_that_nobody_can_drive():
    spare = ego(take_over=TakeOver(areas=(ZONE,), spared=("truck", "bus"), patience=100.0))
    stage = Stage(straight(), spare, refused=(1,))
    stage.reset(("truck_1", 45.0), ("trailer", 46.0, 3.2), ("bus_7", 50.0, 6.4))
    stage.step(5)
    assert stage.driven() == ""
    stage.add("car", 55.0)
    stage.step(2)
    assert stage.driven() == "car"


def test_a_condition_is_waited_for_and_forgotten_at_the_next_episode():
    condition = t.TimeWindowCondition(1.0, 100.0).trigger(0.5)
    stage = Stage(straight(), ego(take_over=TakeOver(areas=(ZONE,), patience=50.0, condition=condition)))
    for episode in range(2):
        stage.reset(("here", 45.0), episode=episode)
        stage.step(15)
        assert stage.driven() == ""
        stage.step(2)
        assert stage.driven() == "here"


def test_who_takes_over_elsewhere_gets_a_way_to_the_goal():
    graph = crossing()
    goal = graph.lane_number("east_out", 0)
    mission = AgentMission(
        route=("west_in", "east_out"), goal=GoalKind.POSITION, goal_lane=goal, goal_s=50.0, route_length=99.0
    )
    stage = Stage(
        graph, AgentStart("ego", (-50.0, -1.6, 0.0), 0.0, mission, take_over=TakeOver(vehicle="car"))
    )
    slot = stage.add("car", 1.6, -40.0, heading=np.pi / 2)
    stage.step(2)
    assert stage.driven() == "car"
    assert stage.scene.routes.route(0, 0) == ("south_in", "east_out")
    edges = stage.world.routes.edges(0, stage.world.vehicles.route[0, slot]).tolist()
    assert [stage.scene.atlas.graphs[0].edge_ids[edge] for edge in edges] == ["south_in", "east_out"]
    assert stage.world.agents.on_route[0, 0]
    assert stage.world.agents.remaining[0, 0] == pytest.approx(stage.world.missions.route_length[0, 0])
    assert 80 < stage.world.agents.remaining[0, 0] < 100


LAP = ("side", "round")


@pytest.mark.parametrize(
    ("laps", "own", "x", "route"),
    [
        # On another road, on the route before the line at 50 m, and behind it.
        (2, (*LAP, "side"), -40.0, ("lead", *LAP, "side")),
        (2, (*LAP, "side"), 70.0, (*LAP, *LAP, "side")),
        (2, (*LAP, *LAP, "side"), 70.0, (*LAP, *LAP, "side")),
        (1, ("side",), 30.0, ("side",)),
        (1, ("side",), 70.0, (*LAP, "side")),
        # The line may be crossed before the first step ends.
        (2, (*LAP, "side"), 49.0, (*LAP, *LAP, "side")),
    ],
)
def test_who_takes_over_drives_all_laps(laps, own, x, route):
    graph = graph_of(
        {
            "side": Road([(0, 0), (100, 0)]),
            "round": Road([(110, 10), (110, 60), (-10, 60), (-10, 10)]),
            "lead": Road([(-60, 0), (-10, 0)]),
        },
        [(("side", 0), ("round", 0)), (("round", 0), ("side", 0)), (("lead", 0), ("side", 0))],
    )
    mission = AgentMission(route=own, goal=GoalKind.LAPS, goal_lane=0, goal_s=50.0, laps=laps)
    stage = Stage(graph, AgentStart("ego", (10.0, 0.0, 0.0), 0.0, mission, take_over=TakeOver(vehicle="car")))
    slot = stage.add("car", x)
    stage.step(2)
    assert stage.driven() == "car"
    assert stage.scene.routes.route(0, 0) == route
    agents, vehicles = stage.world.agents, stage.world.vehicles
    assert agents.remaining[0, 0] == pytest.approx(stage.world.missions.route_length[0, 0])
    corners = [(place, 0.0, 0.0) for place in np.arange(x, 100.0, 5.0)]
    around = [(110.0, 40.0, np.pi / 2), (50.0, 60.0, np.pi), (-10.0, 20.0, -np.pi / 2)]
    side = [(place, 0.0, 0.0) for place in np.arange(0.0, 100.0, 5.0)]
    for *position, heading in [*corners, *(around + side) * laps]:
        vehicles.position[0, slot], vehicles.heading[0, slot] = position, heading
        stage.step()
        if agents.lap[0, 0] == laps:
            break
    assert agents.lap[0, 0] == laps
    assert agents.remaining[0, 0] == 0.0


@pytest.mark.parametrize(("outcome", "stays"), [(Outcome.GOAL, True), (Outcome.COLLISION, False)])
def test_a_vehicle_from_traffic_goes_back_to_it_unharmed(outcome, stays):
    stage = Stage(straight(), ego(take_over=TakeOver(vehicle="car")))
    slot = stage.add("car", 60.0, 0.0, 5.0)
    stage.step(2)
    stage.finish(0, outcome)
    stage.step()
    assert stage.world.vehicles.alive[0, slot] == stays
    if stays:
        assert stage.world.vehicles.owner[0, slot] == Owner.TRAFFIC
    assert stage.world.agents.slot[0, 0] == -1


def test_a_vehicle_that_traffic_does_not_want_stays_until_traffic_takes_it():
    stage = Stage(straight(), ego(take_over=TakeOver(vehicle="car")))
    stage.ownership._drivers = {Owner.AGENT: Willing(), Owner.TRAFFIC: Unwilling()}
    stage.add("car", 60.0)
    stage.step(2)
    stage.finish(0, Outcome.GOAL)
    for _ in range(3):
        stage.step()
        assert stage.names() == {"car"}
        assert stage.world.agents.state[0, 0] == AgentStatus.LEAVING
    assert stage.ownership.refused[0, Refusal.OFF_LANES] == 1
    stage.ownership._drivers = {Owner.AGENT: Willing(), Owner.TRAFFIC: Willing()}
    stage.step()
    assert stage.world.vehicles.owner[0, 0] == Owner.TRAFFIC
    assert stage.world.agents.state[0, 0] == AgentStatus.VACANT


class Unwilling:
    """A provider that wants no vehicle."""

    def can_accept(self, rows, slots):
        return np.full(len(rows), Refusal.OFF_LANES)
