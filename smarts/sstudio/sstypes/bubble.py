"""Areas in which agents take over vehicles from the traffic."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from smarts.sstudio.sstypes.actor import Actor
from smarts.sstudio.sstypes.actor.social_agent_actor import BoidAgentActor, SocialAgentActor
from smarts.sstudio.sstypes.actor.traffic_engine_actor import TrafficEngineActor
from smarts.sstudio.sstypes.bubble_limits import BubbleLimits
from smarts.sstudio.sstypes.condition import ALWAYS, Condition, ConditionRequires
from smarts.sstudio.sstypes.drawing import drawing
from smarts.sstudio.sstypes.identity import Described
from smarts.sstudio.sstypes.zone import Zone


@dataclass(frozen=True, eq=False)
class Bubble(Described):
    """An area with a margin around it: agents observe vehicles in the margin and drive them inside.

    Raises:
        ValueError: The bubble contradicts itself.
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
        if self.margin < 0:
            raise ValueError(f"the margin of {self.id} must not be negative, got {self.margin}")
        self._check_following()
        if self.keep_alive and not self.is_boid:
            raise ValueError(f"keep_alive of {self.id} is for boids, which drive several vehicles")
        is_condition = isinstance(self.active_condition, Condition)  # `validate` refuses others by place
        if is_condition and self.active_condition.requires & ConditionRequires.any_current_actor_state:
            raise ValueError(
                f"the active_condition of {self.id} is about a vehicle: put it into airlock_condition"
            )

    def _check_following(self) -> None:
        if self.follow_actor_id is not None and self.follow_vehicle_id is not None:
            raise ValueError(f"{self.id} cannot follow an agent and a vehicle: give one of the two")
        travels = self.follow_actor_id is not None or self.follow_vehicle_id is not None
        if travels and self.follow_offset is None:
            raise ValueError(f"{self.id} travels with a vehicle and needs a follow_offset")

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
