"""Agents' actions, and the commands that vehicles carry out."""

from __future__ import annotations

import enum
from typing import NamedTuple

from smarts.arrays import Bools, Bytes, Floats, Ints
from smarts.types import columns

MOST_VALUES = 8
"""Numbers that an action other than a path consists of, at most."""
PATH_COLUMNS = 5
"""Columns of a path: time [s], x, y [m], heading [rad], speed [m/s]."""


class ActionSpaceType(enum.IntEnum):
    """How an agent acts, and which controller carries it out; names and numbers are the original's."""

    controller: str
    """The controller as "module:Class"."""

    def __new__(cls, number: int, controller: str) -> ActionSpaceType:  # noqa: D102
        kind = int.__new__(cls, number)
        kind._value_, kind.controller = number, controller
        return kind

    Continuous = 0, "smarts.controllers.continuous:Continuous"
    """Throttle, brake, steering."""
    Lane = 1, "smarts.controllers.lane_actions:LaneActions"
    """A `LaneAction`."""
    ActuatorDynamic = 2, "smarts.controllers.continuous:ActuatorDynamic"
    """Throttle, brake, rate of steering [1/s]."""
    LaneWithContinuousSpeed = 3, "smarts.controllers.lane_following:LaneFollowing"
    """Target speed [m/s], lane change: -1 right, 0, 1 left."""
    TargetPose = 4, "smarts.controllers.target_pose:TargetPose"
    """x, y [m], heading [rad], time until there [s]."""
    Trajectory = 5, "smarts.controllers.trajectory_tracking:TrajectoryTracking"
    """A path of x, y, heading, speed, to be tracked."""
    MultiTargetPose = 6, "smarts.controllers.target_pose:MultiTargetPose"
    """A target pose for each vehicle of the agent."""
    MPC = 7, "smarts.controllers.model_predictive:ModelPredictive"
    """A path of x, y, heading, speed, to be tracked by model-predictive control."""
    TrajectoryWithTime = 8, "smarts.controllers.trajectory_interpolation:TrajectoryInterpolation"
    """A path of time, x, y, heading, speed, to be followed exactly."""
    Direct = 9, "smarts.controllers.direct:Direct"
    """Speed [m/s], or acceleration [m/s^2] and yaw rate [rad/s]."""
    Empty = 10, "smarts.controllers.empty:Empty"
    """Nothing."""
    RelativeTargetPose = 11, "smarts.controllers.target_pose:RelativeTargetPose"
    """Changes of x, y [m] and heading [rad], to be reached in one step."""
    AlongPath = 12, "smarts.controllers.along_path:AlongPath"
    """Acceleration [m/s^2] along the path that the vehicle was recorded on (not in the original)."""


class LaneAction(enum.IntEnum):
    """The four discrete actions; agents may give the number or the name."""

    keep_lane = 0
    slow_down = 1
    change_lane_left = 2
    change_lane_right = 3


class Actions(NamedTuple):
    """The actions of all agents, shape (B, A), refilled in place.

    Values are finite and within their bounds: they are checked when they are encoded.
    """

    kind: Bytes
    """An `ActionSpaceType`."""
    given: Bools
    """Whether the agent has acted since it entered; until then `FallbackController` drives."""
    fresh: Bools
    """Whether the action is new in this step. What happens once (a lane change, a relative pose, a path that
    begins now) happens only when fresh; lasting parts (a speed, a throttle) are kept."""
    values: Floats
    """Shape (B, A, 8); how many count and what they mean follows from the kind."""
    action_mask: Bools
    """`AgentStates.action_mask` at the agent's decision, shape (B, A, 4)."""
    age: Ints
    """Steps since the agent's decision as a fresh action is carried out, 0 without latency."""
    path: Floats
    """Rows of time, x, y, heading, speed, shape (B, A, P, 5); P is 0 if no agent acts by paths."""
    path_length: Ints

    @classmethod
    def allocate(cls, worlds: int, agents: int, path: int = 0) -> Actions:
        """Return buffers without actions for B simulations of A agents and paths of at most P points."""
        more = {"values": (MOST_VALUES,), "action_mask": (len(LaneAction),), "path": (path, PATH_COLUMNS)}
        actions = columns.allocate(cls, (worlds, agents), more=more)
        actions.kind[:] = ActionSpaceType.Empty
        return actions


class CommandMode(enum.IntEnum):
    """How a command moves a vehicle."""

    NONE = 0
    """Without a command: the vehicle rolls."""
    ACTUATORS = 1
    """By throttle, brake and steering."""
    ACTUATORS_RATE = 2
    """By throttle, brake and the rate of steering."""
    TRACK = 3
    """By a reference that it steers along."""
    PLACE = 4
    """By poses, whatever its dynamics."""


KINKED = 4.0
"""`Commands.window` of references that are not planned for the vehicle [m]."""


class Commands(NamedTuple):
    """Commands to the vehicles of all agents for one step, shape (B, A), refilled in place."""

    mode: Bytes
    """A `CommandMode`."""
    actuators: Floats
    """Throttle and brake in [0, 1], steering in [-1, 1] (left positive) or its rate [1/s]; (B, A, 3)."""
    reference: Floats
    """Points ahead, nearest first: x, y [m], heading [rad], speed [m/s], shape (B, A, R, 4)."""
    reference_length: Ints
    window: Floats
    """Length over which a reference's curvature is averaged, since lanes have kinks [m]."""
    poses: Floats
    """Poses at the end of each sub-step: x, y [m], heading [rad], speed [m/s], shape (B, A, S, 4)."""

    @classmethod
    def allocate(cls, worlds: int, agents: int, *, reference: int = 64, substeps: int = 10) -> Commands:
        """Return buffers without commands for B simulations of A agents, R points and S sub-steps."""
        more = {"actuators": (3,), "reference": (reference, 4), "poses": (substeps, 4)}
        commands = columns.allocate(cls, (worlds, agents), more=more)
        commands.window[:] = KINKED
        return commands
