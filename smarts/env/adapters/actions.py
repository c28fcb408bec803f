"""Actions of environments -> actions of the simulation: checked, clipped, marked fresh."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from gymnasium.spaces import Box, Discrete, Space
from numpy.typing import NDArray

from smarts.controllers.lane_actions import lane_action_number
from smarts.env.adapters.protocol import Served
from smarts.errors import ActionError
from smarts.types.actions import Actions, ActionSpaceType, LaneAction

Bools = NDArray[np.bool_]

_FAR = 1e6
_LANE_ACTIONS = np.array([*LaneAction])
_BOUNDS: dict[ActionSpaceType, tuple[list[float], list[float]]] = {
    ActionSpaceType.Continuous: ([0, 0, -1], [1, 1, 1]),
    ActionSpaceType.ActuatorDynamic: ([0, 0, -1], [1, 1, 1]),
    ActionSpaceType.LaneWithContinuousSpeed: ([0, -1], [60, 1]),
    ActionSpaceType.TargetPose: ([-_FAR, -_FAR, -2 * np.pi, 0], [_FAR, _FAR, 2 * np.pi, 1000]),
    ActionSpaceType.MultiTargetPose: ([-_FAR, -_FAR, -2 * np.pi, 0], [_FAR, _FAR, 2 * np.pi, 1000]),
    ActionSpaceType.RelativeTargetPose: ([-6, -6, -np.pi], [6, 6, np.pi]),
    ActionSpaceType.Direct: ([-10, -np.pi], [10, np.pi]),
    ActionSpaceType.Empty: ([], []),
}
"""Least and greatest values of the types that are a few numbers."""

_PATH_COLUMNS = {
    ActionSpaceType.Trajectory: (1, 2, 3, 4),
    ActionSpaceType.MPC: (1, 2, 3, 4),
    ActionSpaceType.TrajectoryWithTime: (0, 1, 2, 3, 4),
}
"""Which columns of `Actions.path` the rows of a path action fill."""

_PATH_BOUND = np.array([1000.0, _FAR, _FAR, 1000.0, 100.0])
"""The largest magnitudes of a path's time [s], x, y [m], heading [rad] and speed [m/s]."""

PATH_POINTS = 32
"""The most points of a path."""


def action_space(kind: ActionSpaceType) -> Space:
    """Return what agents of a type choose from."""
    if kind == ActionSpaceType.Lane:
        return Discrete(len(LaneAction))
    if kind in _BOUNDS:
        low, high = _BOUNDS[kind]
        return Box(np.array(low, np.float32), np.array(high, np.float32), dtype=np.float32)
    bound = np.repeat(_path_bound(kind), PATH_POINTS, axis=1).astype(np.float32)
    return Box(-bound, bound, dtype=np.float32)


def encode_array(served: Served, given: NDArray, chosen: Bools, out: Actions) -> None:
    """Write the chosen agents' actions, given as rows of a space; see `ArrayAdapter.encode`.

    Raises:
        ActionError: An action is not finite, or not one of a discrete space.
    """
    rows, columns = np.nonzero(chosen)
    seats = served.seats[columns]
    out.legal[rows, seats] = served.scene.world.seats.legal[rows, seats]
    out.given[rows, seats] = True
    out.fresh[rows, seats] = True
    values = np.asarray(given)[rows, columns]
    if served.action == ActionSpaceType.Lane:
        values = values.reshape(len(rows))
        bad = ~(values[:, None] == _LANE_ACTIONS).any(axis=1)
        _refuse(served, rows, columns, values, bad, "is not one of 0 to 3")
        out.values[rows, seats, 0] = values
    elif served.action in _PATH_COLUMNS:
        values = values.reshape(len(rows), -1, PATH_POINTS)
        _refuse(served, rows, columns, values, _not_finite(values), "is not finite")
        values = _within_bounds(served.action, values)
        for source, target in enumerate(_PATH_COLUMNS[served.action]):
            out.path[rows, seats, :PATH_POINTS, target] = values[:, source]
        out.path_length[rows, seats] = PATH_POINTS
    else:
        low, high = _BOUNDS[served.action]
        values = values.reshape(len(rows), len(low))
        _refuse(served, rows, columns, values, _not_finite(values), "is not finite")
        out.values[rows, seats, : len(low)] = np.clip(values, low, high)
        _round_lane_changes(served.action, rows, seats, out)


def encode_one(
    agent: str, kind: ActionSpaceType, action: Any, row: int, seat: int, legal: Bools, out: Actions
) -> None:
    """Write one agent's action as users give it: numbers, a lane action's name, a tuple of columns.

    Target poses of several vehicles may be a mapping from vehicles to poses, as in the original; an agent of
    an environment has one vehicle, and so one pose.

    Args:
        agent: Its name, for errors.
        kind: How it acts.
        action: What it does.
        row: Its simulation.
        seat: Its seat.
        legal: Which lane actions it may choose, shape (4,).
        out: Written.

    Raises:
        ActionError: The action is not what this type takes, or not finite.
    """
    if kind == ActionSpaceType.Lane:
        out.values[row, seat, 0] = lane_action_number(action, agent=f"action of {agent!r}")
    elif kind in _PATH_COLUMNS:
        _write_path(agent, kind, action, row, seat, out)
    elif kind == ActionSpaceType.Direct and _is_number(action):
        # The controller tells a speed from acceleration and yaw rate by the third value.
        out.values[row, seat, :3] = np.clip(_numbers(agent, [action], 1)[0], -60, 60), 0.0, 1.0
    else:
        if kind == ActionSpaceType.MultiTargetPose and isinstance(action, Mapping):
            action = _only_pose(agent, action)
        low, high = _BOUNDS[kind]
        if low:
            out.values[row, seat, : len(low)] = np.clip(_numbers(agent, action, len(low)), low, high)
        if kind == ActionSpaceType.Direct:
            out.values[row, seat, 2] = 0.0
        _round_lane_changes(kind, row, seat, out)
    out.legal[row, seat] = legal
    out.given[row, seat] = out.fresh[row, seat] = True


def _is_number(action: Any) -> bool:
    return isinstance(action, int | float | np.number) or (isinstance(action, np.ndarray) and not action.ndim)


def _only_pose(agent: str, poses: Mapping[Any, Any]) -> Any:
    if len(poses) != 1:
        raise ActionError(
            f"poses of {len(poses)} vehicles: {', '.join(map(repr, poses))}",
            place=f"action of {agent!r}",
            remedy="give that of the agent's vehicle",
        )
    return next(iter(poses.values()))


def _round_lane_changes(
    kind: ActionSpaceType, rows: NDArray | int, seats: NDArray | int, out: Actions
) -> None:
    if kind == ActionSpaceType.LaneWithContinuousSpeed:
        out.values[rows, seats, 1] = np.round(out.values[rows, seats, 1])


def _not_finite(values: NDArray) -> Bools:
    return np.array([not np.isfinite(value).all() for value in values], np.bool_)


def _refuse(
    served: Served, rows: NDArray, columns: NDArray, values: NDArray, bad: Bools, problem: str
) -> None:
    if not bad.any():
        return
    first = int(np.argmax(bad))
    raise ActionError(
        f"action {values[first].tolist()} {problem}",
        place=f"agent {served.agents[columns[first]]!r} of simulation {rows[first]}",
        remedy=f"see the action space: {action_space(served.action)}",
    )


def _numbers(agent: str, action: Any, count: int) -> list[float]:
    try:
        values = np.asarray(action, np.float64).reshape(-1)
    except (TypeError, ValueError) as error:
        raise ActionError(f"{action!r} does not consist of numbers", place=f"action of {agent!r}") from error
    if len(values) != count:
        raise ActionError(f"{action!r} has {len(values)} values, not {count}", place=f"action of {agent!r}")
    if not np.isfinite(values).all():
        raise ActionError(f"{action!r} is not finite", place=f"action of {agent!r}")
    return values.tolist()


def _path_bound(kind: ActionSpaceType) -> NDArray[np.float64]:
    """Return the largest magnitude of each row of a path action, shape (rows, 1)."""
    return _PATH_BOUND[[*_PATH_COLUMNS[kind]], None]


def _within_bounds(kind: ActionSpaceType, path: NDArray) -> NDArray[np.float64]:
    """Return paths, shape (..., rows, points), clipped as all other actions are.

    What follows a path works with squares and products of its numbers, which must not overflow.
    """
    bound = _path_bound(kind)
    return np.clip(path, -bound, bound)


def _write_path(agent: str, kind: ActionSpaceType, action: Any, row: int, seat: int, out: Actions) -> None:
    columns = _PATH_COLUMNS[kind]
    try:
        values = np.asarray(action, np.float64)
    except (TypeError, ValueError) as error:
        raise ActionError("the columns of the path differ in length", place=f"action of {agent!r}") from error
    most = out.path.shape[2]
    if values.ndim != 2 or len(values) != len(columns) or not 0 < values.shape[1] <= most:
        raise ActionError(
            f"a path of shape {values.shape}",
            place=f"action of {agent!r}",
            remedy=f"give {len(columns)} columns of 1 to {most} points each",
        )
    if not np.isfinite(values).all():
        raise ActionError("the path is not finite", place=f"action of {agent!r}")
    values = _within_bounds(kind, values)
    out.path_length[row, seat] = values.shape[1]
    for source, target in enumerate(columns):
        out.path[row, seat, : values.shape[1], target] = values[source]
