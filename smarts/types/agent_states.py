"""Agents as arrays: the vehicle that each drives, and what the step remembers of the agent."""

from __future__ import annotations

import enum
from typing import NamedTuple

from smarts.arrays import Bools, Bytes, Floats, Ints, Shorts
from smarts.types import columns


class AgentStatus(enum.IntEnum):
    """What an agent does now."""

    VACANT = 0
    """The agent is not in this episode, or its episode is over."""
    WAITING = 1
    """The agent enters later: at a time, or into a traffic vehicle that comes into its trap."""
    SHADOWING = 2
    """The agent observes a vehicle that another drives."""
    ACTIVE = 3
    """The agent drives its vehicle."""
    DONE = 4
    """The agent's episode ended in this step; it gives up its vehicle at the beginning of the next."""
    LEAVING = 5
    """The agent's episode is over; the fallback controller drives its vehicle until traffic can take it back.
    The agent is neither observed nor asked, and has no events. After a collision the vehicle brakes, stands
    as an obstacle and is removed."""


class ChangePhase(enum.IntEnum):
    """Where a commanded lane change stands."""

    NONE = 0
    REQUESTED = 1
    """Commanded, the vehicle still in its lane."""
    MOVING = 2
    """Across the line."""
    SETTLED = 3
    """Completed in this step."""
    ABORTED = 4
    """Given up in this step."""


UNSET = -1
"""Stands for no slot, lane, junction, arrival number or step."""

_UNSET_WHEN_EMPTY = (
    *("slot", "agent", "target_lane", "off_route_since"),
    *("arrival_number", "arrival_junction", "entry_step", "release_step"),
)


class AgentStates(NamedTuple):
    """The agents of B simulations, shape (B, A): the egos first, then the agents of the pool.

    docs/develop/a_step.md says which stage writes which column. An agent without a vehicle has slot -1.
    Columns keep their values after the agent's end until another agent holds them or the simulation is reset.
    """

    state: Bytes
    """An `AgentStatus`."""
    slot: Ints
    """The vehicle's slot, -1 for none."""
    generation: Ints
    """The vehicle's generation; with the slot, the vehicle itself."""
    agent: Ints
    """Number of the agent in its episode, -1 for none; several agents may hold a column in turn."""
    entry_step: Ints
    """Step of the episode in which the agent entered, -1 before."""
    period: Shorts
    """Steps from one decision of the agent to the next."""
    next_due: Ints
    """Step of the episode on which the agent decides next."""
    outcome: Bytes
    """An `Outcome`."""
    release_step: Ints
    """Step since which the agent's vehicle is to go back to traffic as soon as it can, or since which it
    stands as an obstacle after a collision; -1 if it is not."""
    harmed: Bools
    """Whether the vehicle has collided: it stays where it is, and is removed, once its agent is LEAVING."""

    throttle: Floats
    """Throttle in [0, 1]."""
    brake: Floats
    """Brake in [0, 1]."""
    steering: Floats
    """Angle of the front wheels, positive to the left [rad]."""

    route_progress: Floats
    """Distance gone along the route [m], without one along the lanes; keeps its last value off the route or
    the road."""
    remaining: Floats
    """Distance left on the route to the goal, all laps [m]; keeps its last value off route or road."""
    skipped: Floats
    """How much nearer to the goal the agent came back than it had left the road, in all [m]."""
    left_road: Bools
    """Whether it was off the road since its progress was last written."""
    lane_changes: Bytes
    """How many the route to the goal's lane still demands, positive where the first is to the left; keeps its
    last value off the route or the road."""
    distance_travelled: Floats
    """Distance driven since entry [m]."""
    lap: Shorts
    """Laps completed."""
    lap_before: Shorts
    """`lap` one step ago."""
    on_road: Bools
    """Whether the centre is on a lane for motor vehicles or inside a junction."""
    corners_on_road: Bytes
    """How many corners of the footprint are, 0 to 4."""
    on_route: Bools
    """Whether the vehicle is on the road, in a lane of the route."""

    action_mask: Bools
    """Whether each of the four lane actions may be chosen next, shape (B, A, 4)."""
    target_lane: Ints
    """Lane that the agent steers for, -1 for none."""
    change_phase: Bytes
    """A `ChangePhase`."""
    effective: Bools
    """Whether the lane command of the last action was carried out."""

    last_moved_position: Floats
    """Position at which the vehicle last had moved [m], shape (B, A, 2)."""
    last_moved_step: Ints
    """Step of the episode in which it was there."""
    off_route_since: Ints
    """Step of the episode since which it has been off its route, -1 if it is on it."""
    via_hit: Bools
    """Whether each via point of the mission was passed, of laps in this one, shape (B, A, W)."""
    arrival_number: Ints
    """Place in the order of arrival at the junction ahead, -1 without one."""
    arrival_junction: Ints
    """The junction that the number is for."""

    @classmethod
    def allocate(cls, worlds: int, agents: int, vias: int = 0) -> AgentStates:
        """Return vacant agents for B simulations of A agents and W via points."""
        more = {"action_mask": (4,), "last_moved_position": (2,), "via_hit": (vias,)}
        made = columns.allocate(cls, (worlds, agents), _UNSET_WHEN_EMPTY, more)
        made.period[:] = 1
        return made

    def clear(self, row: int, agent_id: int | slice = slice(None)) -> None:
        """Clear all columns of some agents of one simulation."""
        columns.clear(self, (row, agent_id), _UNSET_WHEN_EMPTY)
        self.period[row, agent_id] = 1


def agent_names(count: int) -> tuple[str, ...]:
    """Return the default names "agent-0", "agent-1", ..."""
    return tuple(f"agent-{number}" for number in range(count))
