"""The optimal-control problem of the receding-horizon planner, as one CasADi function.

Sequential quadratic programming with a fixed number of iterations: in each, the dynamics and the constraints
are linearised, the cost is taken as a sum of squares (Gauss-Newton), and CasADi's PIQP solves the quadratic
program. Nothing in it reads a clock: PIQP stops by its residuals and its number of iterations.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from smarts.arrays import Floats
from smarts.planners.protocol import Limits

STEP_COLUMNS = 9
"""Values of one step of an iteration: acceleration, steering rate, then x, y, heading, speed, steering angle
at its end, then by how much the gaps fall short and the lateral acceleration is too large."""
_SOLVER = {
    "error_on_fail": False,
    "piqp": {
        "eps_abs": 1e-5,
        "eps_rel": 1e-5,
        "eps_duality_gap_abs": 1e-3,
        "eps_duality_gap_rel": 1e-3,
        "max_iter": 40,
        "preconditioner_iter": 3,
    },
}


class Weights(NamedTuple):
    """What the planner trades off. A deviation of 1 in its unit costs the square of its weight."""

    along: float = 0.5
    """Position at and after the target's time and at the horizon's end, along the target's heading [1/m]."""
    across: float = 10.0
    """The same, across it [1/m]."""
    heading: float = 30.0
    """Heading there [1/rad]."""
    speed: float = 2.0
    """Speed there [s/m]."""
    acceleration: float = 0.3
    """Weight of the acceleration in each step [s^2/m]."""
    steering_rate: float = 1.5
    """Weight of the steering rate in each step [s/rad]."""
    change: float = 0.2
    """Change of the acceleration from step to step [s^2/m]."""
    gap: float = 2000.0
    """Cost, not squared, of each metre by which a gap is below `margin`."""
    lateral: float = 100.0
    """Cost, not squared, of each m/s^2 of lateral acceleration above the limit."""
    margin: float = 1.0
    """Gap to keep from neighbours at the end of each step, between which both move on [m]."""


class Solution(NamedTuple):
    """The end of an iteration: its controls, driven by the nonlinear model."""

    states: Floats
    """x, y, heading, speed, steering angle at the end of each step, shape (H, 5); NaN without a solution."""
    cost: float
    gap: float
    """The smallest one to a neighbour [m]; infinite without neighbours."""
    deviation: float
    """Distance between the positions of the iteration and of the drive [m]; NaN without a solution."""


class Program:
    """Solves the problem of one vehicle.

    Args:
        limits: The vehicle.
        weights: The trade-off.
        steps: H, the steps of the horizon.
        neighbours: K, the neighbours that are taken into account.
        iterations: Quadratic programs that are solved in a call.
    """

    def __init__(
        self, limits: Limits, weights: Weights, steps: int, neighbours: int, iterations: int
    ) -> None:
        self.steps = steps
        self.neighbours = neighbours
        self._limits = limits
        self._solve = _iterated(
            _linearised(limits, weights, steps, neighbours), steps, neighbours, iterations
        )
        self._follow = _rollout(limits, weights, steps, neighbours)

    def solve(
        self, guess: Floats, state: Floats, step: float, goals: Floats, poses: Floats, sizes: Floats
    ) -> Solution:
        """Return the drive to which the iteration leads.

        Args:
            guess: Where the iteration begins, shape (H, STEP_COLUMNS).
            state: x, y, heading, speed, steering angle at the begin.
            step: Length of a step [s].
            goals: x, y, heading, speed to be near to at the end of each step, and by how much that counts,
                shape (H, 5).
            poses: x, y, heading of the neighbours at the end of each step, shape (H, K, 3).
            sizes: Their length and width, shape (K, 2).
        """
        limits, infinite = self._limits, np.inf
        fastest = max(limits.speed, state[3])
        low = [-limits.braking, -limits.steering_rate, *3 * [-infinite], 0.0, -limits.steering, 0.0, 0.0]
        high = [
            limits.acceleration,
            limits.steering_rate,
            *3 * [infinite],
            fastest,
            limits.steering,
            infinite,
        ]
        numbers = state, step, goals.T, poses.reshape(-1, 3).T, sizes.T
        bounds = np.tile(low, self.steps), np.tile([*high, infinite], self.steps)
        found: Any = self._solve(guess.ravel(), *bounds, *numbers)
        point = np.array(found).reshape(self.steps, STEP_COLUMNS)
        controls = np.clip(point[:, :2], low[:2], high[:2])
        driven, cost, gap = (np.array(value) for value in self._follow(controls.T, *numbers))
        deviation = np.abs(point[:, 2:4] - driven.T[:, :2]).max()
        return Solution(driven.T, cost.item(), gap.item(), float(deviation))


def _symbols(steps: int, neighbours: int) -> list[Any]:
    """Return symbols of the numbers of a problem: state, step, goals, poses, sizes."""
    shapes = {"state": (5, 1), "step": (1, 1), "goals": (5, steps)}
    shapes |= {"poses": (3, steps * neighbours), "sizes": (2, neighbours)}
    return [ca.SX.sym(name, *shape) for name, shape in shapes.items()]


def _linearised(limits: Limits, weights: Weights, steps: int, neighbours: int) -> ca.Function:
    """Return a function of a point and the problem's numbers: Hessian, gradient, slopes, constraints.

    The slopes are those of the constraints, which are the equations of the dynamics, 5 a step, then the
    inequalities, which are to be >= 0.
    """
    state, step, goals, poses, sizes = numbers = _symbols(steps, neighbours)
    point = ca.SX.sym("point", steps * STEP_COLUMNS)
    rows = [point[k * STEP_COLUMNS : (k + 1) * STEP_COLUMNS] for k in range(steps)]
    equal, positive, before = [], [], state
    for k, row in enumerate(rows):
        control, after, excess = row[:2], row[2:7], row[7:]
        equal.append(after - _driven(before, control, step, limits.wheelbase))
        around = poses[:, k * neighbours : (k + 1) * neighbours]
        positive += [gap - weights.margin + excess[0] for gap in _gaps(after, limits, around, sizes)]
        lateral = _lateral(after, limits)
        positive += [limits.lateral - lateral + excess[1], limits.lateral + lateral + excess[1]]
        before = after
    squares, linear = _costs(rows, goals, weights)
    constraints = ca.vertcat(*equal, *positive)
    slopes = ca.jacobian(squares, point)
    hessian = 2 * slopes.T @ slopes + 1e-3 * ca.SX.eye(point.numel())
    gradient = 2 * slopes.T @ squares + ca.gradient(linear, point)
    return ca.Function(
        "linearised", [point, *numbers], [hessian, gradient, ca.jacobian(constraints, point), constraints]
    )


def _iterated(linearised: ca.Function, steps: int, neighbours: int, iterations: int) -> ca.Function:
    """Return a function that solves the quadratic programs, each from the result of the one before."""
    count, equations = steps * STEP_COLUMNS, steps * 5
    numbers: list[Any] = [ca.MX.sym(linearised.name_in(i), *linearised.size_in(i)) for i in range(1, 6)]
    point, low, high = ca.MX.sym("guess", count), ca.MX.sym("low", count), ca.MX.sym("high", count)
    begin = point
    sparsity = {"h": linearised.sparsity_out(0), "a": linearised.sparsity_out(2)}
    quadratic = ca.conic("quadratic", "piqp", sparsity, _SOLVER)
    for _ in range(iterations):
        hessian, gradient, slopes, constraints = linearised(point, *numbers)
        none = ca.DM.inf(constraints.numel() - equations)
        change = quadratic(
            h=hessian,
            g=gradient,
            a=slopes,
            lba=-constraints,
            uba=ca.vertcat(-constraints[:equations], none),
            lbx=low - point,
            ubx=high - point,
        )["x"]
        point = point + change
    return ca.Function("iterated", [begin, low, high, *numbers], [point])


def _rollout(limits: Limits, weights: Weights, steps: int, neighbours: int) -> ca.Function:
    """Return a function of controls and the problem's numbers: states, cost, smallest gap.

    The controls are of shape (2, H), the states (5, H).
    """
    state, step, goals, poses, sizes = numbers = _symbols(steps, neighbours)
    controls = ca.SX.sym("controls", 2, steps)
    rows, lowest, before = [], ca.SX(np.inf), state
    for k in range(steps):
        after = _driven(before, controls[:, k], step, limits.wheelbase)
        after[3] = ca.fmax(after[3], 0.0)
        gap = ca.SX(np.inf)
        for one in _gaps(after, limits, poses[:, k * neighbours : (k + 1) * neighbours], sizes):
            gap = ca.fmin(gap, one)
        missing, slip = weights.margin - gap, ca.fabs(_lateral(after, limits)) - limits.lateral
        rows.append(ca.vertcat(controls[:, k], after, ca.fmax(missing, 0.0), ca.fmax(slip, 0.0)))
        lowest, before = ca.fmin(lowest, gap), after
    squares, linear = _costs(rows, goals, weights)
    states = ca.horzcat(*(row[2:7] for row in rows))
    return ca.Function("rollout", [controls, *numbers], [states, ca.sumsqr(squares) + linear, lowest])


def _costs(rows: list[Any], goals: Any, weights: Weights) -> tuple[Any, Any]:
    """Return the terms of the cost that are squared, and the sum of the others."""
    squares, linear = [], ca.SX(0)
    for k, (row, before) in enumerate(zip(rows, [None, *rows[:-1]], strict=True)):
        squares += [weights.acceleration * row[0], weights.steering_rate * row[1], 10.0 * row[7:]]
        linear += weights.gap * row[7] + weights.lateral * row[8]
        if before is not None:
            squares.append(weights.change * (row[0] - before[0]))
        squares.append(goals[4, k] * _misses(row[2:7], goals[:, k], weights))
    return ca.vertcat(*squares), linear


def _lateral(state: Any, limits: Limits) -> Any:
    """Return the lateral acceleration [m/s^2]."""
    return state[3] ** 2 * ca.tan(state[4]) / limits.wheelbase


def _driven(state: Any, control: Any, step: Any, wheelbase: float) -> Any:
    """Return the state of a kinematic bicycle after a step, by the classic Runge-Kutta method.

    The state is x, y of the point midway between the axles, heading, speed, steering angle; the control is
    acceleration and steering rate.
    """

    def change(state: Any) -> Any:
        slip = ca.atan(0.5 * ca.tan(state[4]))
        course = state[2] + slip
        yaw_rate = state[3] * ca.sin(slip) * 2.0 / wheelbase
        return ca.vertcat(state[3] * ca.cos(course), state[3] * ca.sin(course), yaw_rate, control)

    first = change(state)
    second = change(state + 0.5 * step * first)
    third = change(state + 0.5 * step * second)
    fourth = change(state + step * third)
    return state + step / 6.0 * (first + 2.0 * second + 2.0 * third + fourth)


def _gaps(pose: Any, limits: Limits, poses: Any, sizes: Any) -> list[Any]:
    """Return the gap between a vehicle and each neighbour along the axis that separates them most [m].

    It is negative if they overlap. The axes are those of `smarts.geometry.boxes.box_gaps`.
    """
    length, width = 0.5 * limits.length, 0.5 * limits.width
    cosine, sine = ca.cos(pose[2]), ca.sin(pose[2])
    found = []
    for j in range(poses.size2()):
        pose2, length2, width2 = poses[:, j], 0.5 * sizes[0, j], 0.5 * sizes[1, j]
        cosine2, sine2 = ca.cos(pose2[2]), ca.sin(pose2[2])
        dx, dy = pose2[0] - pose[0], pose2[1] - pose[1]
        along = ca.fabs(cosine * cosine2 + sine * sine2)
        across = ca.fabs(cosine * sine2 - sine * cosine2)
        gaps = (
            ca.fabs(dx * cosine + dy * sine) - length - along * length2 - across * width2,
            ca.fabs(dy * cosine - dx * sine) - width - across * length2 - along * width2,
            ca.fabs(dx * cosine2 + dy * sine2) - length2 - along * length - across * width,
            ca.fabs(dy * cosine2 - dx * sine2) - width2 - across * length - along * width,
        )
        found.append(ca.fmax(ca.fmax(gaps[0], gaps[1]), ca.fmax(gaps[2], gaps[3])))
    return found


def _misses(state: Any, goal: Any, weights: Weights) -> Any:
    """Return the weighted deviations of a state from the goal, in the goal's frame."""
    cosine, sine = ca.cos(goal[2]), ca.sin(goal[2])
    dx, dy = state[0] - goal[0], state[1] - goal[1]
    return ca.vertcat(
        weights.along * (cosine * dx + sine * dy),
        weights.across * (cosine * dy - sine * dx),
        weights.heading * (state[2] - goal[2]),
        weights.speed * (state[3] - goal[3]),
    )
