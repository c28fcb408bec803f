"""Areas in which agents take over vehicles from the traffic."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from smarts.errors import ContradictionError
from smarts.sstudio.sstypes.actor import Actor
from smarts.sstudio.sstypes.actor.social_agent_actor import BoidAgentActor, SocialAgentActor
from smarts.sstudio.sstypes.actor.traffic_engine_actor import TrafficEngineActor
from smarts.sstudio.sstypes.bubble_limits import BubbleLimits
from smarts.sstudio.sstypes.condition import ALWAYS, Condition
from smarts.sstudio.sstypes.drawing import drawing
from smarts.sstudio.sstypes.identity import Described
from smarts.sstudio.sstypes.zone import Zone


@dataclass(frozen=True, eq=False)
class Bubble(Described):
    """An area with a margin around it: agents observe vehicles in the margin and drive them inside.

    Raises:
        ContradictionError: The bubble contradicts itself; a `ValueError`.
    """

    zone: Zone
    """The area."""
    actor: SocialAgentActor | TrafficEngineActor
    """The actor that takes over."""
    margin: float = 2
    """The width of the margin [m]."""
    limit: BubbleLimits | None = None
    """Most vehicles that it takes; a boid's own capacity counts too."""
    exclusion_prefixes: Sequence[str] = ()
    """Vehicles whose names begin with one of these are left alone."""
    id: str = field(default_factory=lambda: drawing().serial("bubble"))
    """A name; by default numbered in the order in which the scenario file makes them."""
    follow_actor_id: str | None = None
    """The agent with whose vehicle the bubble travels."""
    follow_offset: tuple[float, float] | None = None
    """Offset of a travelling bubble from a vehicle that faces north [m]."""
    keep_alive: bool = False
    """Whether one agent stays for the whole episode; for boids."""
    follow_vehicle_id: str | None = None
    """The vehicle with which the bubble travels."""
    active_condition: Condition = ALWAYS
    """Condition under which the bubble is active."""
    airlock_condition: Condition = ALWAYS
    """Condition on vehicles that enter the margin."""
    collision_time: float = 5.0
    """How long a vehicle that has collided in the bubble stays as an obstacle before it is removed [s] (an
    extension)."""

    def __post_init__(self) -> None:
        self._check_following()
        if self.keep_alive and not self.is_boid:
            problem = f"it is {self.keep_alive}, and the actor {self.actor.name!r} drives one vehicle"
            raise self._error("keep_alive", problem, "leave it out, or use a BoidAgentActor")

    def _check_following(self) -> None:
        agent, vehicle = self.follow_actor_id, self.follow_vehicle_id
        if agent is not None and vehicle is not None:
            problem = f"it is {agent!r}, and follow_vehicle_id is {vehicle!r}"
            raise self._error("follow_actor_id", problem, "give one of the two")
        if (agent is not None or vehicle is not None) and self.follow_offset is None:
            problem = (
                f"there is none, and the bubble travels with {(agent if vehicle is None else vehicle)!r}"
            )
            raise self._error("follow_offset", problem, "give (x, y) in metres, such as (0, 0)")

    def _error(self, field: str, problem: str, remedy: str) -> ContradictionError:
        return ContradictionError(problem, place=f"{field} of bubble {self.id!r}", remedy=remedy)

    @staticmethod
    def to_actor_id(actor: Actor, mission_group: str | None) -> str:
        """Return the agent id of an actor in a group of social agent missions, for `follow_actor_id`."""
        return "-".join(filter(None, ("social-agent", mission_group, actor.name)))

    @property
    def is_boid(self) -> bool:
        """Whether one agent drives all of the vehicles."""
        return isinstance(self.actor, BoidAgentActor | TrafficEngineActor)

    @property
    def traffic_provider(self) -> str | None:
        """The traffic engine that takes over, if it is one."""
        return self.actor.traffic_provider if isinstance(self.actor, TrafficEngineActor) else None
