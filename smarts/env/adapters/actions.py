"""Actions of environments -> actions of the simulation: checked, clipped, marked fresh."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from gymnasium.spaces import Box, Discrete, Space
from numpy.typing import NDArray

from smarts.controllers.action_numbers import numbers_of, refusal
from smarts.controllers.lane_actions import lane_action_number
from smarts.errors import ActionError
from smarts.observations.context import AdapterContext
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


def action_of(agent: str, row: int | None = None) -> str:
    """Return what errors call an agent's action, in one of several simulations."""
    return f"action of {agent!r}" + ("" if row is None else f" in simulation {row}")


def remedy_of(kind: ActionSpaceType, space: Space | None = None) -> str:
    """Return what is to be given for an action of a type, or of an adapter's own space."""
    if space is not None and space != action_space(kind):
        return f"give an element of {space}"
    if kind == ActionSpaceType.Lane:
        return f"give 0 to 3: {', '.join(LaneAction.__members__)}"
    alone = ", or a speed [m/s] alone" if kind == ActionSpaceType.Direct else ""
    return f"give an element of {action_space(kind)}{alone}"


def encode_array(served: AdapterContext, given: NDArray, chosen: Bools, out: Actions) -> None:
    """Write the chosen agents' actions, given as rows of a space; see `ArrayAdapter.encode`.

    Raises:
        ActionError: An action is not finite, or not one of a discrete space.
    """
    rows, columns = np.nonzero(chosen)
    agents = served.agent_ids[columns]
    out.action_mask[rows, agents] = served.scene.world.agents.action_mask[rows, agents]
    out.given[rows, agents] = True
    out.fresh[rows, agents] = True
    values = np.asarray(given)[rows, columns]
    if served.action == ActionSpaceType.Lane:
        values = values.reshape(len(rows))
        bad = ~(values[:, None] == _LANE_ACTIONS).any(axis=1)
        _refuse(served, chosen, values, bad, "is no lane action")
        out.values[rows, agents, 0] = values
    elif served.action in _PATH_COLUMNS:
        values = values.reshape(len(rows), -1, PATH_POINTS)
        _refuse(served, chosen, values, _not_finite(values), "is not finite")
        values = _within_bounds(served.action, values)
        for source, target in enumerate(_PATH_COLUMNS[served.action]):
            out.path[rows, agents, :PATH_POINTS, target] = values[:, source]
        out.path_length[rows, agents] = PATH_POINTS
    else:
        low, high = _BOUNDS[served.action]
        values = values.reshape(len(rows), len(low))
        _refuse(served, chosen, values, _not_finite(values), "is not finite")
        out.values[rows, agents, : len(low)] = np.clip(values, low, high)
        _round_lane_changes(served.action, rows, agents, out)


def encode_one(
    agent: str, kind: ActionSpaceType, action: Any, row: int, agent_id: int, action_mask: Bools, out: Actions
) -> None:
    """Write one agent's action as users give it: numbers, a lane action's name, a tuple of columns.

    Target poses of several vehicles may be a mapping from vehicles to poses, as in the original; an agent of
    an environment has one vehicle, and so one pose.

    Args:
        agent_id: Its name, for errors.
        kind: How it acts.
        action: What it does.
        row: Its simulation.
        agent: Its agent.
        action_mask: Which lane actions it may choose, shape (4,).
        out: Written.

    Raises:
        ActionError: The action is not what this type takes, or not finite.
    """
    place, remedy = action_of(agent), remedy_of(kind)
    if kind == ActionSpaceType.Lane:
        out.values[row, agent_id, 0] = lane_action_number(action, agent=place)
    elif kind in _PATH_COLUMNS:
        _write_path(agent, kind, action, row, agent_id, out)
    elif kind == ActionSpaceType.Direct and _is_number(action):
        # The controller tells a speed from acceleration and yaw rate by the third value.
        speed = numbers_of(action, (), place=place, remedy=remedy)
        out.values[row, agent_id, :3] = np.clip(speed, -60, 60), 0.0, 1.0
    else:
        if kind == ActionSpaceType.MultiTargetPose and isinstance(action, Mapping):
            action = _only_pose(agent, action)
        low, high = _BOUNDS[kind]
        if low:
            values = numbers_of(action, (len(low),), place=place, remedy=remedy)
            out.values[row, agent_id, : len(low)] = np.clip(values, low, high)
        if kind == ActionSpaceType.Direct:
            out.values[row, agent_id, 2] = 0.0
        _round_lane_changes(kind, row, agent_id, out)
    out.action_mask[row, agent_id] = action_mask
    out.given[row, agent_id] = out.fresh[row, agent_id] = True


def _is_number(action: Any) -> bool:
    is_array = hasattr(action, "__array__")  # tensors are, too
    return isinstance(action, int | float | np.number) or (is_array and getattr(action, "ndim", 1) == 0)


def _only_pose(agent: str, poses: Mapping[Any, Any]) -> Any:
    if len(poses) != 1:
        raise ActionError(
            f"poses of {len(poses)} vehicles: {', '.join(map(repr, poses))}",
            place=action_of(agent),
            remedy="give that of the agent's vehicle",
        )
    return next(iter(poses.values()))


def _round_lane_changes(
    kind: ActionSpaceType, rows: NDArray | int, agents: NDArray | int, out: Actions
) -> None:
    if kind == ActionSpaceType.LaneWithContinuousSpeed:
        out.values[rows, agents, 1] = np.round(out.values[rows, agents, 1])


def _not_finite(values: NDArray) -> Bools:
    return np.array([not np.isfinite(value).all() for value in values], np.bool_)


def _refuse(served: AdapterContext, chosen: Bools, values: NDArray, bad: Bools, problem: str) -> None:
    """Refuse the first bad one of the chosen agents' values, in the order of `np.nonzero`."""
    if not bad.any():
        return
    first = int(np.argmax(bad))
    row, column = np.argwhere(chosen)[first].tolist()
    place = action_of(served.agents[column], row if len(chosen) > 1 else None)
    raise refusal(values[first].tolist(), problem, place, remedy_of(served.action))


def _path_bound(kind: ActionSpaceType) -> NDArray[np.float64]:
    """Return the largest magnitude of each row of a path action, shape (rows, 1)."""
    return _PATH_BOUND[[*_PATH_COLUMNS[kind]], None]


def _within_bounds(kind: ActionSpaceType, path: NDArray) -> NDArray[np.float64]:
    """Return paths, shape (..., rows, points), clipped as all other actions are.

    What follows a path works with squares and products of its numbers, which must not overflow.
    """
    bound = _path_bound(kind)
    return np.clip(path, -bound, bound)


def _write_path(
    agent: str, kind: ActionSpaceType, action: Any, row: int, agent_id: int, out: Actions
) -> None:
    columns, most = _PATH_COLUMNS[kind], out.path.shape[2]
    place, remedy = action_of(agent), f"give {len(columns)} columns of 1 to {most} points each"
    try:
        shape = np.shape(action)
    except ValueError as error:
        raise refusal(action, "has columns that differ in length", place, remedy) from error
    if len(shape) != 2 or shape[0] != len(columns) or not 0 < shape[1] <= most:
        raise refusal(action, f"is of shape {shape}", place, remedy)
    values = _within_bounds(kind, numbers_of(action, shape, place=place, remedy=remedy))
    out.path_length[row, agent_id] = values.shape[1]
    for source, target in enumerate(columns):
        out.path[row, agent_id, : values.shape[1], target] = values[source]
