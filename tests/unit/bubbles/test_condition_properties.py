"""Random conditions of bubbles on random facts, against what the scenario language's documentation says.

A condition is a tree of tuples here, from which `condition_of` makes the real one. `Reference` evaluates the
tree itself. Its times are whole numbers of half steps, so that nothing is rounded.
"""

from collections import Counter
from fractions import Fraction
from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from smarts.bubbles.conditions import ConditionRunner
from smarts.roads.agent_routes import AgentRoutes
from smarts.roads.atlas import RoadAtlas
from smarts.roads.scene import Scene
from smarts.sim.map_matching import MapMatcher
from smarts.sstudio import sstypes as t
from smarts.types.vehicles import Owner, VehicleKind
from smarts.types.world import World
from tests import maps
from tests.unit.bubbles.shapes import NUMBERS

FALSE, BEFORE, EXPIRED, TRUE = STATES = tuple(map(t.ConditionState, (0, 1, 2, 4)))
ROADS = maps.straight(lanes=3)
ATLAS = RoadAtlas([ROADS])
BESIDE, ON_ROAD = (-9.0, -1.7, 8.1, 12.0), (-1.5, 0.0, 1.5, 3.2, 4.9, 7.9)
"""Places across the road [m], which is from y = -1.6 to 8 m."""
STEP_LENGTHS = st.sampled_from(["0.1", "0.05", "0.3"])
"""[s]; no multiple of them is exact in binary."""
PLAIN = settings(deadline=None, derandomize=True)

TIMES = st.integers(0, 16)
"""[half steps]"""
STATE = st.sampled_from(STATES)
DELAYS = st.integers(0, 8)
"""[half steps]"""


def named(name, *rest):
    return st.tuples(st.just(name), *rest)


LEAVES = {
    "literal": named("literal", STATE),
    "window": st.builds(
        lambda start, length: ("window", start, None if length is None else start + length),
        TIMES,
        st.none() | st.integers(0, 12),
    ),
    "there": named("there", st.sampled_from(["a", "b", "a~2", "ghost"])),
    "beside": named("beside"),
    "kind": named("kind", st.sampled_from(["passenger", "bus"])),
    "speed": st.builds(lambda low, more: ("speed", low, low + more), st.integers(0, 3), st.integers(0, 2)),
}
GENERAL = st.one_of(LEAVES["literal"], LEAVES["window"], LEAVES["there"])
LEAF = st.one_of(*LEAVES.values())


def made_of(tree):
    """Return strategies of what is made of trees and needs no clock, by name."""
    return {
        "not": named("not", tree),
        "and": named("and", tree, tree),
        "or": named("or", tree, tree),
        "if": named("if", tree, tree),
        "expire": named("expire", tree, TIMES, STATE, st.just(False)),
    }


def clocked(tree):
    """Return strategies of what has a clock, by name; those that persist switch to TRUE."""
    switches = named("trigger", tree, DELAYS, STATE, STATE, st.just(False))
    persists = named("trigger", tree, DELAYS, STATE, st.just(TRUE), st.just(True))
    return {
        "trigger": switches,
        "persistent trigger": persists,
        "relative expire": named("expire", tree, TIMES, STATE, st.just(True)),
    }


def with_clocks(tree):
    return st.one_of(*made_of(tree).values(), *clocked(tree).values())


SHARED = st.builds(
    lambda outer, left, right, one, other, shared: (outer, (left, one, shared), (right, other, shared)),
    *[st.sampled_from(["and", "or", "if"])] * 3,
    *[GENERAL] * 2,
    named("trigger", GENERAL, DELAYS, STATE, st.just(TRUE), st.booleans()),
)
"""Two conditions with equal triggers, one of which may have to stay idle."""
WAITING = ("trigger", ("literal", TRUE), 8, BEFORE, TRUE, False)
EACH = LEAVES | made_of(LEAF) | clocked(LEAF)
"""The smallest trees of each kind."""
ACTIVE = st.recursive(GENERAL, with_clocks, max_leaves=6)
AIRLOCK = st.recursive(LEAF, with_clocks, max_leaves=6)


CONDITIONS = {
    "literal": t.LiteralCondition,
    "window": t.TimeWindowCondition,
    "there": t.DependeeActorCondition,
    "beside": t.OffRoadCondition,
    "kind": t.VehicleTypeCondition,
    "speed": t.VehicleSpeedCondition,
    "not": t.Condition.__neg__,
    "and": t.Condition.__and__,
    "or": t.Condition.__or__,
    "if": t.Condition.implication,
    "trigger": t.ConditionTrigger,
    "expire": t.Condition.expire,
}
TIMES_AT = {"window": (0, 1), "trigger": (1,), "expire": (1,)}
"""Which arguments are times."""


def condition_of(tree, dt):
    """Return the condition of the scenario language for a tree, with times as a user writes them."""

    def argument(place, value):
        if isinstance(value, tuple):
            return condition_of(value, dt)
        if place in TIMES_AT.get(tree[0], ()):
            return t.MAX if value is None else float(value * Fraction(dt) / 2)
        return value

    return CONDITIONS[tree[0]](*(argument(*item) for item in enumerate(tree[1:])))


class Vehicle(NamedTuple):
    """A vehicle at one moment."""

    given: str
    """The name that it asks for."""
    name: str
    kind: VehicleKind
    speed: float
    y: float


class Moment(NamedTuple):
    """The facts of one simulation at one step."""

    step: int
    begins: bool
    """Whether an episode begins."""
    vehicles: dict[int, Vehicle]
    """By a number that is another for each vehicle."""
    in_margin: list[int]


def random_facts(random, moments=14):
    """Return the moments of one simulation: vehicles come, change and leave, and episodes begin again."""
    made, step, issued, vehicles, names = [], 0, 0, {}, Counter()
    for _ in range(moments):
        begins = not made or random.random() < 0.08
        if begins:
            step, vehicles, names = 0, {}, Counter()
        else:
            step += int(random.integers(1, 3))
        vehicles = {number: vehicle for number, vehicle in vehicles.items() if random.random() < 0.85}
        while len(vehicles) < 3 and random.random() < 0.5:
            given = str(random.choice(["a", "b", "c"]))
            names[given] += 1
            name = given if names[given] == 1 else f"{given}~{names[given]}"
            kind = random.choice([VehicleKind.PASSENGER, VehicleKind.BUS, VehicleKind.TRUCK])
            issued += 1
            vehicles[issued] = Vehicle(given, name, VehicleKind(kind), 0.0, 0.0)
        for number, vehicle in vehicles.items():
            speed, y = float(random.integers(0, 6)), float(random.choice(BESIDE + ON_ROAD))
            vehicles[number] = vehicle._replace(speed=speed, y=y)
        in_margin = [number for number in vehicles if random.random() < 0.8]
        made.append(Moment(step, begins, dict(vehicles), in_margin))
    return made


class Reference:
    """Evaluates trees at one moment.

    Args:
        moment: The facts.
        vehicle: The one that the tree is about.
        clocks: Start of each clock [half steps]; equal trees share one.
    """

    def __init__(self, moment, vehicle, clocks):
        self.time, self.vehicle, self.clocks = 2 * moment.step, vehicle, clocks
        self.names = {vehicle.name for vehicle in moment.vehicles.values()}

    def state(self, tree):
        name, *rest = tree
        return getattr(self, f"_{name}")(tree, *rest)

    def _literal(self, _, state):
        return state

    def _window(self, _, start, end):
        if end is None:
            return TRUE
        return BEFORE if self.time < start else TRUE if self.time < end else EXPIRED

    def _there(self, _, name):
        return TRUE if name in self.names else FALSE

    def _beside(self, _):
        return TRUE if self.vehicle.y in BESIDE else FALSE

    def _kind(self, _, kind):
        return TRUE if self.vehicle.kind.name.lower() == kind else FALSE

    def _speed(self, _, low, high):
        return TRUE if low <= self.vehicle.speed <= high else FALSE

    def _not(self, _, inner):
        return FALSE if self.state(inner) == TRUE else TRUE

    def _and(self, _, *inner):
        return self._both(
            lambda *two: next(state for state in (EXPIRED, BEFORE, FALSE, TRUE) if state in two), *inner
        )

    def _or(self, _, *inner):
        def best(*two):
            return next((s for s in (TRUE, BEFORE) if s in two), EXPIRED if two == (EXPIRED,) * 2 else FALSE)

        return self._both(best, *inner)

    def _if(self, _, *inner):
        return self._both(lambda one, other: TRUE if one != TRUE or other == TRUE else FALSE, *inner)

    def _both(self, operator, first, second):
        """Apply an operator; the second tree is not looked at if its state makes no difference."""
        one = self.state(first)
        possible = {operator(one, other) for other in STATES}
        return possible.pop() if len(possible) == 1 else operator(one, self.state(second))

    def _trigger(self, tree, inner, delay, untriggered, triggered, persistent):
        if tree not in self.clocks:
            state = self.state(inner)
            if state != TRUE:
                return EXPIRED if state == EXPIRED else untriggered
            self.clocks[tree] = self.time
        if self.time < self.clocks[tree] + delay:
            return untriggered
        if persistent and self.state(inner) != TRUE:
            return FALSE
        return triggered

    def _expire(self, tree, inner, time, expired, relative):
        begin = self.clocks.setdefault(tree, self.time) if relative else 0
        return expired if self.time >= begin + time else self.state(inner)


def states_of(facts, active, airlock):
    """Return what the trees of bubbles say in one simulation, at each moment of each bubble and vehicle."""
    seen, clocks = [], {}
    for moment in facts:
        if moment.begins:
            clocks = {}
        for bubble, tree in enumerate(active):
            seen.append(Reference(moment, None, clocks.setdefault(bubble, {})).state(tree) == TRUE)
        for number in moment.in_margin:
            for bubble, tree in enumerate(airlock):
                own = clocks.setdefault((bubble, number), {})
                seen.append(Reference(moment, moment.vehicles[number], own).state(tree))
    return seen


class Stage:
    """Simulations in which vehicles come and go by given facts.

    Args:
        rows: The moments of each simulation.
        dt: [s], a decimal.
    """

    def __init__(self, rows, dt):
        self.rows, self.slots = rows, [{} for _ in rows]
        self.world = World(worlds=len(rows), capacity=4, agents=1, lanes=3, egos=0, dt=float(dt))
        self.matcher = MapMatcher(Scene(self.world, ATLAS, AgentRoutes(ATLAS, len(rows), 1)))
        self.runner = ConditionRunner(self.world)

    def run(self, active, airlock, looks=1):
        """Return what the conditions say, a list as that of `states_of` for each simulation.

        Args:
            active: Conditions of bubbles.
            airlock: Conditions on vehicles.
            looks: How often each is evaluated at each moment; the last time counts.
        """
        seen = [[] for _ in self.rows]
        for moments in zip(*self.rows, strict=True):
            for row, moment in enumerate(moments):
                self._put(row, moment)
            self.matcher.match(np.ones(len(self.rows), np.bool_))
            for row, moment in enumerate(moments):
                for _ in range(looks):
                    states = list(self._states(row, moment, active, airlock))
                seen[row] += states
        return seen

    def _put(self, row, moment):
        world, slots = self.world, self.slots[row]
        if moment.begins:
            world.clear(row)
            self.runner.clear(row)
            slots.clear()
        world.step[row] = moment.step
        for number in slots.keys() - moment.vehicles.keys():
            world.registry.dismiss(row, slots.pop(number))
        for number, vehicle in moment.vehicles.items():
            if number not in slots:
                slots[number] = world.registry.admit(
                    row, vehicle.given, Owner.TRAFFIC, vehicle.kind, 5.0, 1.8
                )
            slot = slots[number]
            world.vehicles.position[row, slot] = 100.0 + 5 * slot, vehicle.y
            world.vehicles.speed[row, slot] = vehicle.speed

    def _states(self, row, moment, active, airlock):
        for bubble, condition in enumerate(active):
            yield self.runner.is_active(row, bubble, condition)
        for number in moment.in_margin:
            for bubble, condition in enumerate(airlock):
                yield self.runner.admits(row, bubble, self.slots[row][number], condition, ROADS)


def rows_of(number, count):
    random = np.random.default_rng(number)
    return [random_facts(random) for _ in range(count)]


@given(
    st.lists(ACTIVE, min_size=2, max_size=2), st.lists(AIRLOCK, min_size=2, max_size=2), NUMBERS, STEP_LENGTHS
)
@settings(PLAIN, max_examples=80)
def test_random_conditions_in_random_simulations(active, airlock, number, dt):
    rows = rows_of(number, 2)
    conditions = [[condition_of(tree, dt) for tree in trees] for trees in (active, airlock)]
    assert Stage(rows, dt).run(*conditions) == [states_of(facts, active, airlock) for facts in rows]


@pytest.mark.parametrize("kind", EACH)
def test_each_kind_alone(kind):
    @given(EACH[kind], NUMBERS, STEP_LENGTHS)
    @settings(PLAIN, max_examples=8)
    def check(tree, number, dt):
        (facts,) = rows = rows_of(number, 1)
        assert Stage(rows, dt).run([], [condition_of(tree, dt)]) == [states_of(facts, [], [tree])]

    check()


@example(("or", ("and", ("literal", EXPIRED), WAITING), ("or", ("window", 0, 4), WAITING)), 0, "0.1")
@given(SHARED, NUMBERS, STEP_LENGTHS)
@settings(PLAIN, max_examples=40)
def test_equal_triggers_share_a_clock_in_one_bubble_alone(tree, number, dt):
    rows, trees = rows_of(number, 1), [tree, *tree[1:]]
    conditions = [condition_of(tree, dt) for tree in trees]
    assert Stage(rows, dt).run(conditions, conditions) == [states_of(facts, trees, trees) for facts in rows]


@given(ACTIVE, AIRLOCK, NUMBERS, STEP_LENGTHS)
@settings(PLAIN, max_examples=20)
def test_a_second_look_in_the_same_step_changes_nothing(active, airlock, number, dt):
    rows, conditions = rows_of(number, 1), ([condition_of(active, dt)], [condition_of(airlock, dt)])
    assert Stage(rows, dt).run(*conditions, looks=2) == Stage(rows, dt).run(*conditions)
