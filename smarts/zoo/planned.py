"""What the zoo's planning drivers share: they keep lanes by IDM, and change them by a motion planner.

Between manoeuvres a driver follows its lane as other drivers of the zoo do. A manoeuvre is a pose in a lane
and the time at which to be there. While it lasts, the planner is asked every 0.2 s, in the frame of that
lane, for a path past the nearest vehicles, which are predicted to keep speed and lane; the controller tracks
it.

Where planning fails, the rest of the last path is driven; once that is over the agent's action is NaN, so it
fails, and the fallback controller drives from the same step on. A manoeuvre that cannot be planned at its
beginning does not begin.

Axis letters: N vehicles, P points of a way, R rows of a path.
"""

from __future__ import annotations

from functools import cache
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from smarts.agents.interface import AgentInterface
from smarts.agents.policy import ActionBatch
from smarts.arrays import Bools, Floats, Ints
from smarts.controllers.action_formats import PATH_POINTS
from smarts.controllers.lane_path import limit_speeds
from smarts.controllers.tracking import SPEED_GAIN
from smarts.dynamics import vehicle, vehicle_names
from smarts.dynamics.performance import Abilities
from smarts.observations.lane_ways import BEHIND, LANE_WAYS
from smarts.observations.nearby import NEARBY
from smarts.observations.surroundings import OWN, Lane, Own
from smarts.observations.way_ahead import SPACING
from smarts.planners import PLANNERS, Limits, Neighbours, Planner, PlanStatus, as_actions, resample
from smarts.planners.protocol import keep_last
from smarts.types.actions import ActionSpaceType
from smarts.types.vehicles import VehicleKind
from smarts.zoo.driving import DRIVER, STEP, Driver, Memory, Seen, beside, target_speed
from smarts.zoo.lane_frames import stretches, to_lane, to_map

ROWS = 21
"""Rows of a kept path."""
PERIOD = 2
"""Steps between two calls of the planner."""
CHANGE_TIME = 4.0
"""Time from the beginning of a lane change to its pose [s]."""
LEAST_TIME = 1.5
"""Later, and after its time, a pose moves on ahead of the vehicle by this time [s]."""
LATE = 40
"""Steps after the time of its pose at which a manoeuvre is given up."""
SHORTEST = 12.0
"""A lane change on less than this way does not begin [m]."""
SETTLED_OFFSET, SETTLED_TURN = 0.3, 0.05
"""A manoeuvre is over within this distance of the lane's centreline [m], and angle to it [rad]."""

SWERVE = 1.0
"""How far a path may lead beside what is between the vehicle and its lane's centreline [m]: planners know of
vehicles, not of edges of roads."""

LIMITS = Limits(speed=40.0)
"""Limits of the planners' vehicle, a car; drivers obey speed limits by their desired speeds."""

_BUSY, _ARRIVAL, _X, _Y, _SPEED, _PLANNED = range(6)
"""Columns of what is kept: whether a manoeuvre lasts, the step and the place of its pose, the speed there,
the step of the last plan; then the plan's path on the map, row by row."""
_PATH = slice(6, 6 + ROWS * 5)


class Goal(NamedTuple):
    """The poses of lane changes in the frames of the lanes that they lead to, shape (N,) each."""

    time: Floats
    """Time from now [s]."""
    station: Floats
    """Distance ahead of the vehicle [m]; with less than `SHORTEST` a lane change does not begin."""
    speed: Floats
    """Speed there [m/s]."""


class PlannedDriver(Driver):
    """A driver whose lane changes are drives of a motion planner to poses in the lanes beside it.

    Subclasses say when it changes lanes (`decide`), and where to (`goal`).

    Args:
        planner: Name of a planner (`smarts.planners.PLANNERS`), or a "module:Class".
        options: Those of `Driver`.

    Raises:
        SmartsError: There is no such planner, or an option is out of its range.
    """

    interface: ClassVar[AgentInterface] = DRIVER.replace(action=ActionSpaceType.Trajectory)
    observation: ClassVar[Any] = ["surroundings", LANE_WAYS, NEARBY]

    def __init__(self, planner: str = "receding_horizon", **options: float) -> None:
        super().__init__(**options)
        self._planner = planner_named(planner, LIMITS)
        self._kept = Memory(_PATH.stop)

    def act(self, obs: ActionBatch) -> NDArray:
        """Return paths of x, y, heading, speed, shape (N, 4, P); NaN where planning has failed for good."""
        kept = self._kept.of(obs)
        view = _View.of(obs, kept)
        settled = (np.abs(view.place[:, 1]) < SETTLED_OFFSET) & (np.abs(view.place[:, 2]) < SETTLED_TURN)
        settled &= obs.step > kept[:, _PLANNED]
        is_late = ~settled & (kept[:, _BUSY] > 0.0) & (obs.step > kept[:, _ARRIVAL] + LATE)
        kept[settled | is_late, _BUSY] = 0.0
        self.given_up(obs, is_late)
        seen = view.seen(kept)
        acceleration, change = self.decide(obs, seen)
        begins = self._begin(obs, view, self.goal(obs, seen, change), change, kept)
        view = _View.of(obs, kept)
        failed = self._plan(obs, view, kept, begins)
        kept[failed & begins, _BUSY] = 0.0
        self.begun(obs, seen, np.where(begins & ~failed, change, 0).astype(np.int32))
        speed = self.trimmed(obs, view.own[:, Own.SPEED], acceleration)
        agility = agilities(view.own[:, Own.LENGTH])
        paths = lane_paths(view.ways[:, OWN], speed, agility)
        plans = plan_paths(kept[:, _PATH].reshape(-1, ROWS, 5))
        cap = self.before_lines(view.seen(kept))
        plans[:, 3] = np.minimum(plans[:, 3], target_speed(view.own[:, Own.SPEED], cap)[:, None])
        busy = np.flatnonzero(kept[:, _BUSY] > 0.0)
        plans[busy] = slow_in_bends(plans[busy], view.ways[busy, view.lane[busy]], agility[busy])
        paths = np.where(kept[:, _BUSY, None, None] > 0.0, plans, paths)
        paths[failed & ~begins] = np.nan
        self._last.keep(obs, np.column_stack([view.own[:, Own.SPEED], paths[:, 3, 1]]))
        self._kept.keep(obs, kept)
        return paths

    def goal(self, batch: ActionBatch, seen: Seen, change: Ints) -> Goal:
        """Return where lane changes lead: as far as the driver gets behind the leaders of both lanes."""
        own, other, desired = seen.lanes[:, OWN], beside(seen, change), self.desired(seen)
        speed, way = seen.speed.copy(), np.zeros(len(seen.own))
        for step in range(round(CHANGE_TIME / STEP)):
            time = step * STEP
            gap = other[:, Lane.AHEAD] + other[:, Lane.AHEAD_SPEED] * time - way
            found = self.model.acceleration(speed, desired, gap, other[:, Lane.AHEAD_SPEED])
            if time < 0.5 * CHANGE_TIME:
                gap = own[:, Lane.AHEAD] + own[:, Lane.AHEAD_SPEED] * time - way
                found = np.minimum(
                    found, self.model.acceleration(speed, desired, gap, own[:, Lane.AHEAD_SPEED])
                )
            speed = np.maximum(speed + STEP * found, 0.0)
            way += STEP * speed
        return Goal(np.full(len(way), CHANGE_TIME), way, speed)

    def begun(self, batch: ActionBatch, seen: Seen, change: Ints) -> None:
        """Take note of the lane changes that have begun, shape (N,); does nothing unless overridden."""

    def given_up(self, batch: ActionBatch, is_late: Bools) -> None:
        """Take note of the lane changes that are given up, shape (N,); does nothing unless overridden."""

    def _begin(self, obs: ActionBatch, view: _View, goal: Goal, change: Ints, kept: Floats) -> Bools:
        """Write the poses of lane changes that are wanted and possible; return which those are."""
        begins = (change != 0) & (kept[:, _BUSY] == 0.0) & (goal.station >= SHORTEST) & obs.drives
        lane = np.where(change > 0, 1, 2)
        pose = np.zeros((len(lane), 1, 3))
        pose[:, 0, 0] = goal.station
        pose = to_map(view.ways[np.arange(len(lane)), lane], pose)[:, 0]
        now = np.column_stack([np.ones(len(lane)), obs.step + goal.time / STEP, pose[:, :2], goal.speed])
        kept[begins, :_PLANNED] = now[begins]
        kept[begins, _PATH] = np.nan
        return begins

    def _plan(self, obs: ActionBatch, view: _View, kept: Floats, begins: Bools) -> Bools:
        """Plan the paths of manoeuvres that are due; return of which there is none, shape (N,)."""
        is_due = (kept[:, _BUSY] > 0.0) & (begins | (obs.step >= kept[:, _PLANNED] + PERIOD))
        failed, rows = np.zeros(len(kept), np.bool_), np.flatnonzero(is_due)
        if not len(rows):
            return failed
        ways, place, speed = view.ways[rows, view.lane[rows]], view.place[rows], view.own[rows, Own.SPEED]
        target = np.zeros((len(rows), 1, 3))
        target[:, 0, :2] = kept[rows, _X : _Y + 1]
        left = (kept[rows, _ARRIVAL] - obs.step[rows]) * STEP
        ahead = place[:, 0] + 0.5 * LEAST_TIME * (speed + kept[rows, _SPEED])
        station = np.where(left < LEAST_TIME, ahead, to_lane(ways, target)[:, 0, 0])
        # Kept, so that the pose is never so far behind that another lane seems nearer.
        moved, target[:, 0] = left < LEAST_TIME, np.column_stack([station, np.zeros((len(rows), 2))])
        kept[rows[moved], _X : _Y + 1] = to_map(ways[moved], target[moved])[:, 0, :2]
        targets = np.zeros((len(rows), 5))
        targets[:, 0], targets[:, 1] = np.maximum(left, LEAST_TIME), station
        targets[:, 4] = kept[rows, _SPEED]
        last = kept[rows, _PATH].reshape(-1, ROWS, 5)
        last[..., 1:4] = to_lane(ways, last[..., 1:4])
        elapsed = (obs.step[rows] - kept[rows, _PLANNED]) * STEP
        elapsed[begins[rows]] = 0.0
        states = np.column_stack([place, speed, curvatures(last, elapsed)])
        around = neighbours_of(ways, obs.observations[NEARBY][rows], view.own[rows])
        plans = self._planner.plan(states, targets, around, last, elapsed)
        strays = (plans.status == PlanStatus.PLANNED) & leaves_lanes(plans.path, place[:, 1])
        if strays.any():
            plans = keep_last(plans.path, strays | (plans.status != PlanStatus.PLANNED), last, elapsed)
        path = plans.path if plans.path.shape[1] == ROWS else _of_rows(plans.path)
        path[..., 1:4] = to_map(ways, path[..., 1:4])
        kept[rows, _PATH], kept[rows, _PLANNED] = path.reshape(len(rows), -1), obs.step[rows]
        failed[rows] = plans.status == PlanStatus.FAILED
        return failed


class _View(NamedTuple):
    """What drivers see, and where they are in the lanes that they drive to."""

    own: Floats
    lanes: Floats
    ways: Floats
    """Centrelines of the own lane, the left and the right one, shape (N, 3, P, 3)."""
    lane: Ints
    """Index of the lane that the manoeuvre leads to, the own one without a manoeuvre, shape (N,)."""
    place: Floats
    """Station, offset, heading in that lane, shape (N, 3)."""

    @classmethod
    def of(cls, obs: ActionBatch, kept: Floats) -> _View:
        """Return the view of a batch's vehicles with their manoeuvres."""
        seen, ways = Seen.of(obs), obs.observations[LANE_WAYS]
        apart = np.hypot(ways[..., 0] - kept[:, _X, None, None], ways[..., 1] - kept[:, _Y, None, None]).min(
            axis=2
        )
        apart[:, 1:][(ways[:, 1:] == 0.0).all(axis=(2, 3))] = np.inf
        lane = np.where(kept[:, _BUSY] > 0.0, np.argmin(apart, axis=1), 0).astype(np.int32)
        pose = seen.own[:, None, [Own.X, Own.Y, Own.HEADING]]
        place = to_lane(ways[np.arange(len(lane)), lane], pose)[:, 0]
        return cls(seen.own, seen.lanes, ways, lane, place)

    def seen(self, kept: Floats) -> Seen:
        """Return what the drivers see, with the lane of a manoeuvre as their own."""
        own, lanes = self.own.copy(), self.lanes.copy()
        own[:, Own.CHANGING] = kept[:, _BUSY]
        lanes[:, OWN] = self.lanes[np.arange(len(own)), self.lane]
        return Seen(own, lanes)


@cache
def planner_named(name: str, limits: Limits) -> Planner:
    """Return the planner of a name for vehicles of some limits; equal calls get one, which takes a second.

    Raises:
        SmartsError: There is no planner of this name.
    """
    return PLANNERS[name](limits)


@cache
def _kinds() -> tuple[Floats, Floats]:
    """Return lengths [m] and agilities [1/(m s)] of the vehicles with a model."""
    names = {kind: kind.name.lower() for kind in VehicleKind if kind.name.lower() in vehicle_names()}
    return np.array([vehicle(name).length for name in names.values()]), Abilities.of_all().agility[[*names]]


def agilities(lengths: Floats) -> Floats:
    """Return the largest rates of change of curvature [1/(m s)], of the kind with the nearest length [m]."""
    known, found = _kinds()
    return found[np.argmin(np.abs(lengths[:, None] - known), axis=1)]


def lane_paths(ways: Floats, speeds: Floats, agility: Floats) -> Floats:
    """Return paths along lanes at target speeds, slower in bends, as actions, shape (N, 4, PATH_POINTS).

    Args:
        ways: Ways of the lanes, as `lane_ways` has them, shape (N, P, 3).
        speeds: [m/s], shape (N,).
        agility: Largest rates of change of the vehicles' curvatures [1/(m s)], shape (N,).
    """
    references = np.empty((len(ways), PATH_POINTS, 4))
    references[..., :3] = ways[:, BEHIND - 1 : BEHIND - 1 + PATH_POINTS]
    references[..., 3] = speeds[:, None]
    for reference, rate in zip(references, agility.tolist(), strict=True):
        limit_speeds(reference, PATH_POINTS, rate)
    return references.transpose(0, 2, 1)


def slow_in_bends(plans: Floats, ways: Floats, agility: Floats) -> Floats:
    """Return planned paths, as slow as bends of their lanes demand, as actions, shape (N, 4, PATH_POINTS).

    Args:
        plans: As actions, shape (N, 4, PATH_POINTS).
        ways: Ways of the lanes that they lead to, as `lane_ways` has them, shape (N, P, 3).
        agility: As `lane_paths` takes it, shape (N,).
    """
    limits = lane_paths(ways, np.full(len(ways), np.inf), agility)[:, 3]
    stations = to_lane(ways, plans[:, :3].transpose(0, 2, 1))[..., 0]
    at = SPACING * (np.arange(PATH_POINTS) - 1)
    slow = plans.copy()
    for path, station, limit in zip(slow, stations, limits, strict=True):
        path[3] = np.minimum(path[3], np.interp(station, at, limit))
    return slow


def plan_paths(paths: Floats) -> Floats:
    """Return planned paths as actions, shape (N, 4, PATH_POINTS).

    The controller accelerates by the speed that is lacking, so a path on which the vehicle accelerates asks
    for speeds above its own.

    Args:
        paths: Rows of time, x, y, heading, speed, shape (N, R, 5).
    """
    asked = paths.copy()
    rates = np.diff(paths[..., 4], axis=1) / np.maximum(np.diff(paths[..., 0], axis=1), 1e-3)
    asked[:, :-1, 4] += np.maximum(rates, 0.0) / SPEED_GAIN
    return as_actions(asked, PATH_POINTS, with_time=False)


def curvatures(last: Floats, elapsed: Floats) -> Floats:
    """Return the curvatures of last paths after a time [1/m], 0 where they stand, shape (N,)."""
    around = resample(last, elapsed[:, None] + np.array([-0.05, 0.05]))
    way = np.hypot(*(around[:, 1, 1:3] - around[:, 0, 1:3]).T)
    turned = around[:, 1, 3] - around[:, 0, 3]
    turned = np.arctan2(np.sin(turned), np.cos(turned))
    # Without a last path, NaN, which is not above.
    return np.where(way > 0.05, turned / np.maximum(way, 0.05), 0.0)


def leaves_lanes(paths: Floats, offsets: Floats) -> Bools:
    """Return whether paths in lanes' frames lead beside the lanes of their manoeuvres, shape (N,).

    Args:
        paths: Rows of time, station, offset, heading, speed, shape (N, R, 5).
        offsets: Offsets of the vehicles now [m], shape (N,).
    """
    right, left = np.minimum(offsets, 0.0) - SWERVE, np.maximum(offsets, 0.0) + SWERVE
    return (paths[..., 2].min(axis=1) < right) | (paths[..., 2].max(axis=1) > left)


def neighbours_of(ways: Floats, nearby: Floats, own: Floats) -> Neighbours:
    """Return vehicles around, predicted to keep their speeds and lanes.

    The planners' vehicle is a car; neighbours of a vehicle of another size are larger, or smaller, instead.

    Args:
        ways: Ways of the lanes in whose frames the neighbours are, shape (N, P, 3).
        nearby: As the feature has them, shape (N, K, 6).
        own: The vehicles, as `surroundings` has them, shape (N, len(Own)).
    """
    path = np.zeros((*nearby.shape[:2], 1, 5))
    path[:, :, 0, 1:4] = to_lane(ways, nearby[..., :3])
    path[:, :, 0, 4] = nearby[..., 3] * stretches(ways, path[:, :, 0, 1], path[:, :, 0, 2])
    path[nearby[..., 4] == 0.0] = np.nan
    larger = own[:, None, [Own.LENGTH, Own.WIDTH]] - [LIMITS.length, LIMITS.width]
    return Neighbours(path, np.maximum(nearby[..., 4:6] + larger, 0.1))


def _of_rows(paths: Floats) -> Floats:
    """Return paths with `ROWS` rows, evenly in time."""
    return resample(paths, paths[:, -1:, 0] * np.linspace(0.0, 1.0, ROWS))
