"""Turn signals: the edge after the present one on each vehicle's planned route."""

import numpy as np
import pytest

from smarts.roads.scene import Scene
from smarts.sim.turn_signals import TurnSignals
from tests.maps import Road, crossing, graph_of, straight
from tests.worlds import Car, world_of

ALL = np.ones(1, np.bool_)


class Signals:
    """A crossing with vehicles on planned routes, whose signals are shown step by step."""

    def __init__(self, *cars: tuple[Car, tuple[str, ...]], maps=None) -> None:
        self.graph = (maps or [crossing()])[-1]
        rows = [[Car(0.0, 0.0)], [car for car, _ in cars]] if maps else [[car for car, _ in cars]]
        self.made = world_of(*rows, maps=maps or [self.graph])
        self.row = len(rows) - 1
        self.vehicles = self.made.world.vehicles.of(self.row)
        for slot, (_, route) in enumerate(cars):
            self.plan(slot, route)
        self.stage = TurnSignals(Scene(self.made.world, self.made.atlas, self.made.routes))

    def plan(self, slot, route):
        number = self.made.world.routes.number(self.row, map(self.graph.edge_number, route))
        self.vehicles.route[slot] = number

    def show(self, *places):
        """Put vehicles at x, let a step pass, and return their signals by name."""
        for slot, x in enumerate(places):
            self.vehicles.position[slot, 0] = x
        self.made.world.step += 1
        self.made.match()
        self.stage.show(np.ones(self.made.world.worlds, np.bool_))
        edges = self.vehicles.next_edge[self.vehicles.alive].tolist()
        return [self.graph.edge_ids[edge] if edge >= 0 else "" for edge in edges]


def from_the_west(x=-40.0, **more):
    return Car(x, -1.6, 0.0, 5.0, **more)


def test_a_vehicle_signals_its_way_until_it_is_through():
    signals = Signals((from_the_west(), ("west_in", "east_out")))
    assert [signals.show(x) for x in (-40.0, -20.0, 0.0, 40.0)] == [
        ["east_out"],
        ["east_out"],
        ["east_out"],
        [""],
    ]


def test_vehicles_without_a_route_or_off_it_signal_nothing():
    signals = Signals((from_the_west(), ()), (from_the_west(-60.0), ("south_in", "north_out")))
    assert signals.show(-40.0, -60.0) == ["", ""]


def test_another_route_shows_in_the_same_step():
    signals = Signals((from_the_west(), ("west_in", "east_out")))
    assert signals.show(-40.0) == ["east_out"]
    signals.plan(0, ("west_in", "north_out"))
    assert signals.show(-39.0) == ["north_out"]
    signals.plan(0, ())
    assert signals.show(-38.0) == [""]


@pytest.mark.parametrize(
    ("route", "shown"),
    [
        (("west_in", "east_out"), "east_out"),
        (("east_out",), "east_out"),
        (("west_in",), ""),
        (("south_in", "north_out"), ""),
        # Round a block: the first of two visits.
        (("east_out", "west_in", "south_out"), "east_out"),
    ],
)
def test_inside_a_junction_the_way_out_shows(route, shown):
    """On the way from the west to the east: of a vehicle that begins there, and of one that gets a route."""
    begins = Signals((from_the_west(0.0), route))
    assert begins.show(0.0) == [shown]
    changes = Signals((from_the_west(), ("west_in", "east_out", "west_in")))
    assert [changes.show(-40.0), changes.show(0.0)] == [["east_out"], ["east_out"]]
    changes.plan(0, route)
    assert changes.show(0.5) == [shown]


def test_a_vehicle_that_enters_the_next_episode_later_shows_its_way():
    """Slots and generations begin again: it has those of a vehicle of the episode before."""
    signals = Signals((from_the_west(), ("west_in", "east_out")))
    assert signals.show(-40.0) == ["east_out"]
    signals.vehicles.alive[0], signals.vehicles.next_edge[0] = False, -1
    signals.made.world.step[:] = -1
    assert signals.show() == []
    signals.vehicles.alive[0] = True
    assert signals.show(-40.0) == ["east_out"]


def test_edges_are_numbered_within_the_simulation_s_map():
    signals = Signals((from_the_west(), ("west_in", "east_out")), maps=[straight(), crossing()])
    assert signals.show(-40.0) == ["east_out"]


def test_a_route_that_uses_an_edge_twice():
    """Round the block: the second time, the vehicle takes the other way."""
    roads = {name: Road([(100.0 * i, 0.0), (100.0 * i + 90.0, 0.0)]) for i, name in enumerate("abc")}
    graph = graph_of(roads, [(("a", 0), ("b", 0)), (("b", 0), ("c", 0))])
    made = world_of([Car(40.0, 0.0)], maps=[graph])
    vehicles = made.world.vehicles.of(0)
    vehicles.route[0] = made.world.routes.number(0, [0, 1, 0, 2])
    stage, seen = TurnSignals(Scene(made.world, made.atlas, made.routes)), []
    for x in (40.0, 140.0, 40.0, 240.0):
        vehicles.position[0, 0] = x
        made.world.step += 1
        made.match()
        stage.show(ALL)
        seen.append(int(vehicles.next_edge[0]))
    assert seen == [1, 0, 2, -1]
