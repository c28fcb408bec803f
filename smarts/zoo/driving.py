"""What the zoo's drivers share: how they see, follow and change lanes; arrays of N vehicles at once."""

from __future__ import annotations

import math
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from smarts.agents.criteria import DoneCriteria
from smarts.agents.interface import AgentInterface
from smarts.agents.policy import ActionBatch, BatchAgent
from smarts.arrays import Bools, Floats, Ints
from smarts.controllers.tracking import ACCELERATION_TRIM, SPEED_GAIN
from smarts.dynamics.car_following import idm_free, idm_interaction
from smarts.observations.surroundings import LANE_TRAFFIC, OWN_VEHICLE, Lane, Own
from smarts.types.actions import ActionSpaceType, LaneAction
from smarts.types.traffic import Signal
from smarts_agent_kit.memory import Memory as Memory

STEP = 0.1
"""Length of a step, by which policies count time [s]; with others they are refused (`step_length`)."""
HARDEST = 8.0
"""Largest deceleration of a driver [m/s^2]."""
LATE_BRAKING = 4.0
"""A driver that would have to brake harder for an amber light drives on [m/s^2]."""
YIELD_BRAKING = 6.0
"""The same for vehicles that go first at a junction [m/s^2]."""
LINE_OVERLAP = 1.0
"""By so much nearer than to a leader a driver stops to a line where others go first [m]."""
LEAST_SPEED = 0.1
"""Lower bound of desired speeds, so that IDM stays finite [m/s]."""
HORIZON_TIME = 15.0
HORIZON = 60.0
"""A lane change that the route demands is begun this long [s], and at least this far [m], before its end."""
URGENT = 30.0
"""Nearer than this to the end of its lane a driver accepts smaller gaps [m]."""
FALLING_BACK = 1.5
"""Deceleration at which a driver falls back behind a vehicle in the lane that it needs [m/s^2]..."""
FALLING_BACK_SPEED = 2.0
"""...down to this speed [m/s]."""
SAFE_BRAKING = 4.0
"""The hardest that a lane change may make a driver brake [m/s^2]; MOBIL's safety criterion."""
LEAST_GAP = 1.0
"""Gap to both vehicles in the lane that a driver changes to [m]."""

DRIVER = AgentInterface(
    action=ActionSpaceType.LaneWithContinuousSpeed,
    vehicle_model="kinematic",
    done_criteria=DoneCriteria(off_route=False),
    accelerometer=False,
    lane_positions=False,
)
"""The interface of the rule-based drivers: one, so that they share columns."""


class Seen(NamedTuple):
    """The observation `surroundings` of N vehicles by name; see `Own` and `Lane` for the numbers."""

    own: Floats
    """Shape (N, len(Own))."""
    lanes: Floats
    """Observations of the own lane, the left and the right one, shape (N, 3, len(Lane))."""

    @classmethod
    def of(cls, batch: ActionBatch) -> Seen:
        """Return the views of a batch."""
        return cls(batch.observations[OWN_VEHICLE], batch.observations[LANE_TRAFFIC])

    @property
    def speed(self) -> Floats:
        """[m/s], shape (N,)."""
        return self.own[:, Own.SPEED]


class Idm(NamedTuple):
    """Parameters of the intelligent driver model, see `smarts.dynamics.car_following`."""

    tau: float = 1.2
    """Time gap to the leader [s]."""
    accel: float = 2.0
    """Largest acceleration [m/s^2]."""
    decel: float = 3.0
    """Comfortable deceleration [m/s^2]."""
    min_gap: float = 2.0
    """Gap to a standing leader [m]."""

    def acceleration(self, speed: Any, desired: Any, gap: Any, leader_speed: Any) -> Floats:
        """Return the acceleration of drivers [m/s^2]; all values broadcast.

        Args:
            speed: [m/s]
            desired: Speed on a free road [m/s].
            gap: To the leader, bumper to bumper [m]; infinite for none.
            leader_speed: [m/s]
        """
        following = self.accel, self.decel, self.tau, self.min_gap, np.maximum(gap, 0.1), speed, leader_speed
        free = idm_free.py_func(self.accel, speed, np.maximum(desired, LEAST_SPEED))
        free = np.maximum(free, -self.decel)
        return np.clip(free - idm_interaction.py_func(*following), -HARDEST, self.accel)


class Driver(BatchAgent):
    """A driver that follows leaders by IDM, stops at red lights, ends of lanes and for crossing traffic.

    Subclasses say which lane it wants.

    Args:
        tau: Time gap to the leader [s].
        accel: Largest acceleration [m/s^2].
        decel: Comfortable deceleration [m/s^2].
        min_gap: Gap to a standing leader [m].
        speed_factor: Desired speed, in speed limits.
        max_speed: Upper bound of the desired speed [m/s].
        junction_margin: Margins in time to others at junctions, in those of `smarts/roads/precedence.py`.
    """

    interface: ClassVar[AgentInterface] = DRIVER
    observation: ClassVar[Any] = ["surroundings"]
    step_length: ClassVar[float] = STEP

    def __init__(
        self,
        tau: float = Idm().tau,
        accel: float = Idm().accel,
        decel: float = Idm().decel,
        min_gap: float = Idm().min_gap,
        speed_factor: float = 1.0,
        max_speed: float = math.inf,
        junction_margin: float = 1.0,
    ) -> None:
        self.model = Idm(*map(float, (tau, accel, decel, min_gap)))
        self._speed_factor, self._max_speed = float(speed_factor), float(max_speed)
        if junction_margin != 1.0:
            self.observation = [{"surroundings": {"margins": float(junction_margin)}}]  # pyright: ignore
        self._last = Memory(2)  # speed and target speed

    def act(self, obs: ActionBatch) -> NDArray:
        """Return target speeds and lane changes, shape (N, 2)."""
        seen = Seen.of(obs)
        acceleration, change = self.decide(obs, seen)
        speed = self.trimmed(obs, seen.speed, acceleration)
        self._last.keep(obs, np.column_stack([seen.speed, speed]))
        return np.column_stack([speed, change])

    def trimmed(self, obs: ActionBatch, speed: Floats, acceleration: Floats) -> Floats:
        """Return target speeds, less what the speed controller's integral adds."""
        last = self._last.of(obs)
        too_much = np.where(self._last.is_new(obs), 0.0, excess(speed, last[:, 0], last[:, 1]))
        return target_speed(speed, acceleration - too_much)

    def decide(self, batch: ActionBatch, seen: Seen) -> tuple[Floats, Ints]:
        """Return accelerations [m/s^2] and lane changes (1 left, -1 right, 0 none), shape (N,)."""
        raise NotImplementedError(f"{type(self).__name__} does not define decide(batch, seen)")

    def desired(self, seen: Seen) -> Floats:
        """Return the speeds on a free road [m/s], shape (N,)."""
        return np.minimum(seen.own[:, Own.ALLOWED] * self._speed_factor, self._max_speed)

    def follow(self, seen: Seen, *, keeps_to_route: bool = True) -> Floats:
        """Return accelerations behind leaders and before lines and ends of lanes [m/s^2], shape (N,).

        Args:
            seen: What the drivers see.
            keeps_to_route: Whether they stop where their lane leaves the route, too.
        """
        leader = self._behind_leader(seen, seen.lanes[:, 0])
        found = np.minimum(leader, self.before_lines(seen, keeps_to_route=keeps_to_route))
        return np.minimum(found, self._falling_back(seen)) if keeps_to_route else found

    def _behind_leader(self, seen: Seen, lane: Floats) -> Floats:
        """Return accelerations behind the vehicles ahead in lanes, given by numbers as of `beside`."""
        ahead, its_speed = lane[:, Lane.AHEAD], lane[:, Lane.AHEAD_SPEED]
        return self.model.acceleration(seen.speed, self.desired(seen), ahead, its_speed)

    def before_lines(self, seen: Seen, *, keeps_to_route: bool = True) -> Floats:
        """Return accelerations on a road without others, but for lines and ends of lanes; see `follow`."""
        own, lane, desired = seen.own, seen.lanes[:, 0], self.desired(seen)
        yield_gap = own[:, Own.YIELD_GAP]
        lines = [
            _gap_if(own[:, Own.LIGHT_GAP], self._stops_at_light(own)),
            LINE_OVERLAP + _gap_if(yield_gap, _can_stop(own[:, Own.SPEED], yield_gap, YIELD_BRAKING)),
            lane[:, Lane.LEFT if keeps_to_route else Lane.END],
        ]
        accelerations = [self.model.acceleration(seen.speed, desired, gap, 0.0) for gap in lines]
        return np.minimum.reduce(accelerations)

    def _falling_back(self, seen: Seen) -> Floats:
        """Return accelerations behind the vehicle ahead in the lane that the route demands [m/s^2].

        Of two vehicles side by side that want each other's lane, the rear one lets the other in.
        """
        side = self.demanded_side(seen)
        behind = self._behind_leader(seen, beside(seen, side))
        falls_back = (side != 0) & (seen.speed > FALLING_BACK_SPEED)
        return np.where(falls_back, np.maximum(behind, -FALLING_BACK), HARDEST)

    def _stops_at_light(self, own: Floats) -> Bools:
        light, gap, speed = own[:, Own.LIGHT], own[:, Own.LIGHT_GAP], own[:, Own.SPEED]
        is_red, is_amber = light == Signal.STOP, light == Signal.CAUTION
        return (is_red & _can_stop(speed, gap, HARDEST)) | (is_amber & _can_stop(speed, gap, LATE_BRAKING))

    def demanded_change(self, batch: ActionBatch, seen: Seen) -> Ints:
        """Return the lane changes that the route demands now and that are safe, shape (N,)."""
        side = self.demanded_side(seen)
        braking = np.where(_to_go(seen) < URGENT, 1.5 * SAFE_BRAKING, SAFE_BRAKING)
        return np.where(self.is_safe(batch, seen, side, braking), side, 0)

    def demanded_side(self, seen: Seen) -> Ints:
        """Return the side on which the route demands a lane change now, 0 for none, shape (N,)."""
        is_due = _to_go(seen) < np.maximum(HORIZON, HORIZON_TIME * seen.speed)
        is_due &= seen.own[:, Own.CHANGING] == 0.0
        return np.where(is_due, np.sign(seen.own[:, Own.DEMANDED]), 0).astype(np.int32)

    def is_safe(self, batch: ActionBatch, seen: Seen, side: Ints, braking: Any = SAFE_BRAKING) -> Bools:
        """Return whether lane changes are allowed and make no driver brake too hard, shape (N,).

        Args:
            batch: The request.
            seen: What the drivers see.
            side: 1 for left, -1 for right, 0: never safe; shape (N,).
            braking: The hardest that is allowed [m/s^2].
        """
        lane = beside(seen, side)
        own_speed, its_speed = seen.speed, lane[:, Lane.BEHIND_SPEED]
        own_after = self._behind_leader(seen, lane)
        its_desired = np.maximum(lane[:, Lane.BEHIND_DESIRED], its_speed)
        its_after = self.model.acceleration(its_speed, its_desired, lane[:, Lane.BEHIND], own_speed)
        has_room = (lane[:, Lane.AHEAD] > LEAST_GAP) & (lane[:, Lane.BEHIND] > LEAST_GAP)
        return may_change(batch, seen, side) & has_room & (own_after > -braking) & (its_after > -braking)


def target_speed(speed: Floats, acceleration: Floats) -> Floats:
    """Return target speeds that accelerate vehicles; controllers add `SPEED_GAIN` for each m/s lacking."""
    return np.maximum(speed + acceleration / SPEED_GAIN, 0.0)


def excess(speed: Floats, last_speed: Floats, last_target: Floats) -> Floats:
    """Return by how much vehicles accelerate more than their last target speeds ask for [m/s^2], shape (N,).

    That is the integral part of the speed controller, which a steady acceleration winds up; a driver that
    takes no account of it drives 5% too fast.
    """
    asked = SPEED_GAIN * (last_target - 0.5 * (speed + last_speed))
    return np.clip((speed - last_speed) / STEP - asked, 0.0, ACCELERATION_TRIM)


def beside(seen: Seen, side: Ints) -> Floats:
    """Return the numbers of the lane on a side (1 left, -1 right, 0 own), shape (N, len(Lane))."""
    return seen.lanes[np.arange(len(side)), np.where(side == 0, 0, np.where(side > 0, 1, 2))]


def may_change(batch: ActionBatch, seen: Seen, side: Ints) -> Bools:
    """Return whether a lane change is allowed and none is in progress, shape (N,)."""
    left, right = (
        batch.action_mask[:, each] for each in (LaneAction.change_lane_left, LaneAction.change_lane_right)
    )
    is_allowed = np.where(side > 0, left, right) & (side != 0)
    is_open = beside(seen, side)[:, Lane.OPEN] > 0.0
    return is_allowed & is_open & (seen.own[:, Own.CHANGING] == 0.0)


def _to_go(seen: Seen) -> Floats:
    """Return the distance to where the lane, or the route, ends [m], shape (N,)."""
    left = seen.lanes[:, 0, Lane.LEFT]
    return np.where(np.isfinite(left), left, seen.own[:, Own.REMAINING])


def _gap_if(gap: Floats, condition: Any) -> Floats:
    return np.where(condition, gap, np.inf)


def _can_stop(speed: Floats, gap: Floats, braking: float) -> Bools:
    """Return whether vehicles can stop before a line at a gap; a line that is passed counts no more."""
    return (gap > 0.0) & (speed * speed <= 2.0 * braking * np.maximum(gap, 0.0))
