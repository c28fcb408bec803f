"""A short optimal drive towards the target and past the neighbours, planned again in every call."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from smarts.arrays import Bools, Floats
from smarts.planners.bezier import bezier_paths
from smarts.planners.optimal_control import STEP_COLUMNS, Program, Solution, Weights
from smarts.planners.paths import resample
from smarts.planners.protocol import Limits, Neighbours, Plans, keep_last

_SHORTEST, _LONGEST = 0.1, 0.3
"""Length of a step [s]."""
_FAR = 1e3
"""Distance behind the vehicle at which a missing neighbour is put [m]."""
_DEVIATION = 1.0
"""Up to which the iteration's positions may differ from the driven ones [m]."""
_TIGHT = 0.25
"""Smallest gap for which no other guess is tried [m]."""
_SLOW = 0.5
"""Multiple of the speed in a guess that waits."""
_BESIDE = 3.5
"""How far guesses that pass a neighbour bulge to a side [m]."""


class Problem(NamedTuple):
    """What is solved for one vehicle."""

    state: Floats
    """x, y, heading, speed, curvature, shape (5,)."""
    wanted: Floats
    """The curve to the target, then straight on: rows of time, x, y, heading, speed, shape (H, 5)."""
    counts: Bools
    """Whether the vehicle is to be there at the end of each step, shape (H,)."""
    step: float
    """Length of a step [s]."""
    poses: Floats
    """Poses of the neighbours at the end of each step, shape (H, K, 3)."""
    sizes: Floats
    """Sizes of the neighbours, shape (K, 2)."""


class RecedingHorizonPlanner:
    """Plans by optimal control of a kinematic bicycle over a fixed number of steps.

    The horizon ends at the target's time, within 2 and 6 s for 20 steps: its goal is the target, for a
    farther target the pose on the Bezier curve to it, and after the target's time straight on. Where the
    target's time is too early, the earliest possible one counts. Limits of the vehicle hold; gaps to the
    neighbours and the limit of the lateral acceleration are soft. The iteration begins with the last path, or
    else with the curve. Of more neighbours than the planner has room for, those nearest to that path count.
    Planning fails where the quadratic program has no solution or the iteration is far from a drive.

    Args:
        limits: The vehicle.
        weights: What is traded off.
        steps: Steps of the horizon; paths have one row more.
        neighbours: Room for neighbours; the time of a call grows with it.
        iterations: Quadratic programs that are solved in each call.
    """

    def __init__(
        self,
        limits: Limits | None = None,
        weights: Weights | None = None,
        *,
        steps: int = 20,
        neighbours: int = 3,
        iterations: int = 3,
    ) -> None:
        self._limits = limits or Limits()
        self._program = Program(self._limits, weights or Weights(), steps, neighbours, iterations)

    def plan(
        self,
        states: Floats,
        targets: Floats,
        neighbours: Neighbours | None = None,
        last: Floats | None = None,
        elapsed: float | Floats = 0.0,
    ) -> Plans:
        """Plan a path for each vehicle; see `Planner`."""
        rows, steps = len(states), self._program.steps
        around = neighbours or Neighbours.none(rows)
        since = np.broadcast_to(np.asarray(elapsed, float), rows)
        # Rows with an infinite number become NaN, with which arithmetic is silent; their planning fails.
        states, targets = (
            np.where(np.isfinite(values).all(axis=1, keepdims=True), values, np.nan)
            for values in (states, targets)
        )
        curves = self._curves(states, targets)
        lengths = np.clip(curves[:, -1, 0] / steps, _SHORTEST, _LONGEST)
        times = lengths[:, None] * np.arange(1, steps + 1)
        wanted = resample(curves, times)
        guess = wanted if last is None else resample(last, times + since[:, None])
        is_warm = np.isfinite(guess).all(axis=(1, 2)) & (last is not None)
        guess = np.where(is_warm[:, None, None], guess, wanted)
        poses, sizes = self._nearest(guess, around, times)
        path = np.full((rows, steps + 1, 5), np.nan)
        for n in np.flatnonzero(np.isfinite(states[:, 0]) & np.isfinite(guess[:, 0, 0])):
            counts = times[n] >= min(curves[n, -1, 0], times[n, -1]) - 0.5 * lengths[n]
            problem = Problem(states[n], wanted[n], counts, lengths[n], poses[n], sizes[n])
            slow = resample(curves[n : n + 1], _SLOW * times[n : n + 1])[0] * [1, 1, 1, 1, _SLOW]
            path[n] = self._path(problem, guess[n], slow, is_warm[n])
        return keep_last(path, np.isnan(path[:, 0, 0]), last, since)

    def _curves(self, states: Floats, targets: Floats) -> Floats:
        """Return the Bezier paths to the targets, shape (N, 32, 5).

        Where a target is passed, the path is straight on beside the vehicle.
        """
        limits = self._limits
        bounds = np.array([limits.speed, limits.acceleration, limits.braking, np.inf])
        curves, _ = bezier_paths(states, targets, bounds, limits.sharpest, 32)
        dx, dy = targets[:, 1] - states[:, 0], targets[:, 2] - states[:, 1]
        cosine, sine = np.cos(targets[:, 3]), np.sin(targets[:, 3])
        ahead, aside = dx * cosine + dy * sine, dy * cosine - dx * sine
        passed = (ahead <= 0.0) & (np.abs(aside) < 0.5 * limits.length)
        passed &= np.cos(states[:, 2] - targets[:, 3]) > 0.0
        beside = targets.copy()
        beside[:, 0] = 0.0
        beside[:, 1:3] -= ahead[:, None] * np.column_stack([cosine, sine])
        curves[passed] = beside[passed, None]
        return curves

    def _nearest(self, guess: Floats, around: Neighbours, times: Floats) -> tuple[Floats, Floats]:
        """Return poses of the nearest neighbours, shape (N, H, K, 3), and their sizes, (N, K, 2)."""
        rows, count = around.path.shape[:2]
        steps, room = self._program.steps, self._program.neighbours
        poses = np.zeros((rows, steps, max(count, room), 3))
        poses[..., 0] = guess[:, :1, None, 1] - _FAR
        poses[..., 1] = guess[:, :1, None, 2]
        sizes = np.ones((rows, max(count, room), 2))
        if not room:
            return poses[:, :, :0], sizes[:, :0]
        there = np.isfinite(around.path).all(axis=(2, 3)) & np.isfinite(around.size).all(axis=2)
        n, k = np.nonzero(there)
        poses[n, :, k] = resample(around.path[n, k], times[n])[:, :, 1:4]
        sizes[n, k] = around.size[n, k]
        apart = np.hypot(poses[..., 0] - guess[:, :, None, 1], poses[..., 1] - guess[:, :, None, 2])
        order = np.argsort(apart.min(axis=1), axis=1, kind="stable")[:, :room]
        return np.take_along_axis(poses, order[:, None, :, None], 2), np.take_along_axis(
            sizes, order[:, :, None], 1
        )

    def _path(self, problem: Problem, guess: Floats, slow: Floats, is_warm: bool) -> Floats:
        """Return one vehicle's path, or NaN.

        Args:
            problem: What is to be solved.
            guess: Where the iteration begins, shape (H, 5).
            slow: The same curve, driven slowly, shape (H, 5).
            is_warm: Whether the guess is the last path.
        """
        best, wanted = self._solve(problem, guess), problem.wanted
        if not is_warm or not best.deviation <= _DEVIATION or best.gap < _TIGHT:
            for other in (slow, _beside(wanted, 1.0), _beside(wanted, -1.0)):
                best = _better(self._solve(problem, other), best)
        path = np.full((len(guess) + 1, 5), np.nan)
        if best.deviation <= _DEVIATION:
            path[:, 0] = problem.step * np.arange(len(path))
            path[0, 1:] = *problem.state[:3], max(problem.state[3], 0.0)
            path[1:, 1:] = best.states[:, :4] + [*problem.state[:2], 0.0, 0.0]
            path[:, 3] = math.pi - (math.pi - path[:, 3]) % (2.0 * math.pi)
        return path

    def _solve(self, problem: Problem, guess: Floats) -> Solution:
        """Return the solution from a guess, with the vehicle's position as origin."""
        state, wanted = problem.state, problem.wanted
        begin = np.array([0.0, 0.0, state[2], max(state[3], 0.0), self._steering(state[4])])
        headings = np.unwrap(np.append(state[2], guess[:, 3]))
        start = self._controls(begin, guess[:, 1:3] - state[:2], headings, guess[:, 4], problem.step)
        goals = np.column_stack([wanted[:, 1:] - [*state[:2], 0.0, 0.0], problem.counts.astype(float)])
        goals[:, 2] = np.unwrap(wanted[:, 3])
        goals[:, 2] += 2.0 * math.pi * np.round((headings[-1] - goals[-1, 2]) / (2.0 * math.pi))
        poses = problem.poses - [state[0], state[1], 0.0]
        return self._program.solve(start, begin, problem.step, goals, poses, problem.sizes)

    def _controls(self, begin: Floats, xy: Floats, headings: Floats, speeds: Floats, step: float) -> Floats:
        """Return a guess with the controls and steering angles that lead through poses."""
        limits = self._limits
        ways = np.maximum(np.hypot(*np.diff(xy, axis=0, prepend=[begin[:2]]).T), 0.1)
        steering = np.clip(self._steering(np.diff(headings) / ways), -limits.steering, limits.steering)
        start = np.zeros((len(xy), STEP_COLUMNS))
        start[:, 0] = np.diff(speeds, prepend=begin[3]) / step
        start[:, 1] = np.diff(steering, prepend=begin[4]) / step
        start[:, 2:4], start[:, 4], start[:, 5], start[:, 6] = xy, headings[1:], speeds, steering
        return start

    def _steering(self, curvature: Floats | float) -> Floats:
        """Return the steering angle that bends the centre's path so, within the limit [rad]."""
        slip = np.arcsin(np.clip(0.5 * self._limits.wheelbase * np.asarray(curvature), -0.7, 0.7))
        return np.clip(np.arctan(2.0 * np.tan(slip)), -self._limits.steering, self._limits.steering)


def _beside(wanted: Floats, side: float) -> Floats:
    """Return a path that bulges to a side: 1 left, -1 right."""
    bulge = side * _BESIDE * np.sin(np.pi * np.arange(1, len(wanted) + 1) / len(wanted))
    moved = wanted.copy()
    moved[:, 1] -= bulge * np.sin(wanted[:, 3])
    moved[:, 2] += bulge * np.cos(wanted[:, 3])
    return moved


def _better(one: Solution, other: Solution) -> Solution:
    """Return the cheaper one of the solutions whose drive is near the iteration's, else the second."""
    if not one.deviation <= _DEVIATION:
        return other
    return one if not other.deviation <= _DEVIATION or one.cost < other.cost else other
