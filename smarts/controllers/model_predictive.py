"""Model-predictive tracking of a path: replans a drivable path in each step.

With e the offset to the left of the path, psi the heading relative to it, kappa its curvature and u the
vehicle's curvature, the vehicle moves as de/ds = psi, dpsi/ds = u - kappa. The plan minimises the weighted
sum of squares of e, psi and du/ds over the reference's points, with |u| bounded by steering lock and grip.
The bound is handled by a fixed number of iterations of the alternating direction method of multipliers (Boyd
et al., Foundations and Trends in Machine Learning 3(1), 2011, section 5.2), each one Riccati recursion. The
plan becomes the reference of the tracking law.
"""

from __future__ import annotations

import math
from typing import ClassVar

import numpy as np

from smarts.arrays import Bools, Floats
from smarts.controllers.action_formats import ActionFormat, PathFormat
from smarts.controllers.trajectory_tracking import write_paths
from smarts.dynamics.performance import Abilities
from smarts.geometry.binding import LateBound
from smarts.geometry.compiling import kernel
from smarts.geometry.segments import wrapped
from smarts.roads.scene import Scene
from smarts.types.actions import Actions, Commands
from smarts.types.world import State

OFFSET_WEIGHT = 1.0
"""Weight of squared offsets [1/m^2]."""
HEADING_WEIGHT = 5.0
"""Weight of squared relative headings [1/rad^2]."""
RATE_WEIGHT = 40.0
"""Weight of the squared change of curvature along the path, at rest [m^4]."""
SPEED_WEIGHT = 40.0
"""Growth of this weight with the squared speed [m^2 s^2]."""
LATERAL_ACCELERATION = 6.0
"""Maximum lateral acceleration of a plan [m/s^2]."""
ROUNDS = 12
"""Iterations of the alternating direction method."""
PENALTY = 50.0
"""Penalty of this method on the squared difference of curvature [m^2]."""


class ModelPredictive:
    """Tracks a path of x, y, heading, speed by model-predictive control.

    Args:
        scene: The world, its maps and its routes.
    """

    action_format: ClassVar[ActionFormat] = PathFormat(columns=(1, 2, 3, 4))
    follows_lanes: ClassVar[bool] = False

    def __init__(self, scene: Scene) -> None:
        state = scene.world.state
        self._write = LateBound(write_paths, state)
        self._plan = LateBound(plan_references, state, Abilities.of_all().sharpest)

    def command(self, actions: Actions, chosen: Bools, out: Commands) -> None:
        """Write a plan along each chosen agent's path; see `Controller`."""
        self._write.to(actions, out)(chosen)
        self._plan.to(out)(chosen)


@kernel
def plan_references(state: State, sharpest: Floats, commands: Commands, chosen: Bools) -> None:
    """Replace the references of chosen agents by plans from their vehicles' poses; see `Commands`."""
    vehicles = state.vehicles
    most = commands.reference.shape[2]
    work = np.zeros((9, most))
    plan = np.zeros((3, most))
    for b in range(chosen.shape[0]):
        for a in range(chosen.shape[1]):
            if not chosen[b, a] or commands.reference_length[b, a] < 3:
                continue
            v = state.agents.slot[b, a]
            points = commands.reference[b, a]
            cos, sin = math.cos(points[0, 2]), math.sin(points[0, 2])
            dx, dy = vehicles.position[b, v, 0] - points[0, 0], vehicles.position[b, v, 1] - points[0, 1]
            # The centre of a turning vehicle moves at an angle to its heading. The plan begins at the first
            # point, up to one spacing behind the vehicle, so the pose is moved back along its arc.
            fast = max(abs(vehicles.speed[b, v]), 1.0)
            curvature = vehicles.yaw_rate[b, v] / fast
            course = wrapped(
                vehicles.heading[b, v] + math.atan(vehicles.lateral_speed[b, v] / fast) - points[0, 2]
            )
            along = dx * cos + dy * sin
            turn = course - min(max(curvature * along, -1.0), 1.0)
            chord = min(max(0.5 * (course + turn), -1.0), 1.0)
            offset = dy * cos - dx * sin - math.tan(chord) * along
            bound = min(sharpest[vehicles.kind[b, v]], LATERAL_ACCELERATION / (fast * fast))
            weight = RATE_WEIGHT + SPEED_WEIGHT * fast * fast
            _solve(
                points, commands.reference_length[b, a], offset, turn, curvature, bound, weight, work, plan
            )
            _shift(points, commands.reference_length[b, a], plan)


@kernel
def _solve(
    points: Floats,
    count: int,
    offset: float,
    turn: float,
    curvature: float,
    bound: float,
    rate_weight: float,
    work: Floats,
    plan: Floats,
) -> None:
    """Write the plan: offset [m], relative heading [rad] and curvature [1/m] at each point, shape (3, R).

    Args:
        points: The path, shape (R, 4).
        count: Number of points of the path.
        offset: Offset of the vehicle at the first point [m].
        turn: Heading of the vehicle relative to the path at the first point [rad].
        curvature: Curvature of the vehicle's current motion [1/m].
        bound: Maximum curvature [1/m].
        rate_weight: Weight of the change of curvature.
        work: Scratch memory, shape (9, R).
        plan: The plan, written.
    """
    target, dual, path_curvature, spacing = work[0], work[1], work[2], work[3]
    for k in range(count):
        target[k], dual[k] = 0.0, 0.0
        if k < count - 1:
            step = math.hypot(points[k + 1, 0] - points[k, 0], points[k + 1, 1] - points[k, 1])
            spacing[k] = max(step, 0.05)
            path_curvature[k] = wrapped(points[k + 1, 2] - points[k, 2]) / spacing[k]
            target[k] = min(max(path_curvature[k], -bound), bound)
    for _ in range(ROUNDS):
        _recurse(count, target, dual, path_curvature, spacing, rate_weight, work)
        plan[0, 0], plan[1, 0], before = offset, turn, curvature
        for k in range(count - 1):
            step = spacing[k]
            change = work[4, k] * plan[0, k] + work[5, k] * plan[1, k] + work[6, k] * before + work[7, k]
            before += change
            plan[2, k] = before
            plan[0, k + 1] = plan[0, k] + step * plan[1, k]
            plan[1, k + 1] = plan[1, k] + step * (before - path_curvature[k])
            target[k] = min(max(before + dual[k], -bound), bound)
            dual[k] += before - target[k]
    plan[0, 0], plan[1, 0] = offset, turn
    for k in range(count - 1):
        plan[2, k] = target[k]
        plan[0, k + 1] = plan[0, k] + spacing[k] * plan[1, k]
        plan[1, k + 1] = plan[1, k] + spacing[k] * (target[k] - path_curvature[k])


@kernel
def _recurse(
    count: int,
    target: Floats,
    dual: Floats,
    path_curvature: Floats,
    spacing: Floats,
    rate_weight: float,
    work: Floats,
) -> None:
    """Write to work[4:8] the feedback of the change of curvature on (offset, heading, curvature before, 1).

    The value of a state x is x'Px + 2p'x; the state after a change w of the curvature u is A x + B w + c.
    """
    value, linear = np.zeros((3, 3)), np.zeros(3)
    value[0, 0], value[1, 1] = OFFSET_WEIGHT, HEADING_WEIGHT
    system, entry = np.zeros((3, 3)), np.zeros(3)
    drift, gain = np.zeros(3), np.zeros(3)
    for k in range(count - 2, -1, -1):
        step = spacing[k]
        system[:] = 0.0
        system[0, 0], system[0, 1] = 1.0, step
        system[1, 1], system[1, 2] = 1.0, step
        system[2, 2] = 1.0
        entry[0], entry[1], entry[2] = 0.0, step, 1.0
        drift[0], drift[1], drift[2] = 0.0, -step * path_curvature[k], 0.0
        # The penalty PENALTY (u + w - desired)^2 belongs to this stage.
        desired = target[k] - dual[k]
        ahead = value @ drift + linear
        curving = rate_weight / step + PENALTY + entry @ (value @ entry)
        gain[:] = entry @ (value @ system)
        gain[2] += PENALTY
        constant = entry @ ahead - PENALTY * desired
        for i in range(3):
            work[4 + i, k] = -gain[i] / curving
        work[7, k] = -constant / curving
        new_value = system.T @ (value @ system)
        new_linear = system.T @ ahead
        new_value[2, 2] += PENALTY
        new_linear[2] -= PENALTY * desired
        for i in range(3):
            new_linear[i] -= gain[i] * constant / curving
            for j in range(3):
                new_value[i, j] -= gain[i] * gain[j] / curving
        new_value[0, 0] += OFFSET_WEIGHT * step
        new_value[1, 1] += HEADING_WEIGHT * step
        value[:] = new_value
        linear[:] = new_linear


@kernel
def _shift(points: Floats, count: int, plan: Floats) -> None:
    """Move a reference's points to the plan."""
    for k in range(count):
        heading = points[k, 2]
        points[k, 0] -= plan[0, k] * math.sin(heading)
        points[k, 1] += plan[0, k] * math.cos(heading)
        points[k, 2] = wrapped(heading + math.atan(min(max(plan[1, k], -1.5), 1.5)))
