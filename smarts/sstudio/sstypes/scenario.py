"""The scenario: map, traffic, missions and more."""

from __future__ import annotations

import enum
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from smarts.sstudio.sstypes.actor.social_agent_actor import SocialAgentActor
from smarts.sstudio.sstypes.bubble import Bubble
from smarts.sstudio.sstypes.dataset import TrafficHistoryDataset
from smarts.sstudio.sstypes.identity import Described
from smarts.sstudio.sstypes.map_spec import MapSpec
from smarts.sstudio.sstypes.mission import AnyMission, DrawnMission
from smarts.sstudio.sstypes.standard_metadata import StandardMetadata
from smarts.sstudio.sstypes.traffic import Traffic
from smarts.sstudio.sstypes.zone import RoadSurfacePatch
from smarts.types.colors import Colors


class ScenarioMetadataFields(enum.IntEnum):
    """Facts that many scenarios give."""

    actor_of_interest_color = enum.auto()
    """The colour of the actors of interest."""
    actor_of_interest_re_filter = enum.auto()
    """A regular expression that their names match."""
    scenario_difficulty = enum.auto()
    """Difficulty in (0, 1]."""
    scenario_duration = enum.auto()
    """Intended duration [s]."""


def _name(key: str | ScenarioMetadataFields) -> str:
    return key.name if isinstance(key, ScenarioMetadataFields) else key


class ScenarioMetadata(StandardMetadata):
    """Facts about a scenario that do not change what happens in it; see `ScenarioMetadataFields`."""

    def __init__(
        self,
        metadata: Mapping[str | ScenarioMetadataFields, Any] | None = None,
        *,
        actor_of_interest_re_filter: str | None = None,
        actor_of_interest_color: Colors | None = None,
        scenario_difficulty: float | None = None,
        scenario_duration: float | None = None,
    ) -> None:
        named = {
            "actor_of_interest_color": actor_of_interest_color,
            "actor_of_interest_re_filter": actor_of_interest_re_filter,
            "scenario_difficulty": scenario_difficulty,
            "scenario_duration": scenario_duration,
        }
        given = {name: fact for name, fact in named.items() if fact is not None}
        super().__init__({_name(key): fact for key, fact in (metadata or {}).items()} | given)

    def __getitem__(self, key: str | ScenarioMetadataFields) -> Any:
        return super().__getitem__(_name(key))


NO_METADATA = ScenarioMetadata()


@dataclass(frozen=True, eq=False)
class StartVariation(Described):
    """Variation of the egos' starts from episode to episode (an extension)."""

    offset: float = 5.0
    """The start lies within this distance before or behind the mission's [m]."""
    speed: tuple[float, float] = (0.0, 5.0)
    """The least and the largest speed at the start [m/s]."""

    def __post_init__(self) -> None:
        low, high = self.speed
        if self.offset < 0 or low < 0 or high < low:
            raise ValueError(f"{self}: the offset must not be negative, and the speeds must rise from 0")


@dataclass(frozen=True, eq=False)
class Variation(Described):
    """A scenario that agents are tested on but not trained on (an extension).

    What is None is as in the scenario itself.
    """

    description: str
    """The difference, in one line."""
    map_spec: MapSpec | None = None
    traffic: Mapping[str, Traffic] | None = None
    ego_missions: Sequence[AnyMission | DrawnMission] | None = None
    seed: int | None = None


SocialMissions = Mapping[str, tuple[Sequence[SocialAgentActor], Sequence[AnyMission]]]


@dataclass(frozen=True, eq=False)
class Scenario(Described):
    """A map, the traffic on it, and the agents' missions.

    Raises:
        ValueError: Two groups of social agents share an actor.
    """

    map_spec: MapSpec | None = None
    """The map; unless given, the one in the scenario's folder."""
    traffic: Mapping[str, Traffic] | None = None
    """Variations of the traffic by name; episodes take turns with them."""
    ego_missions: Sequence[AnyMission | DrawnMission] | None = None
    """Missions of the learning agents: one agent cycles through them, several agents share them. Or one
    `DrawnMission`, from which each episode draws."""
    social_agent_missions: SocialMissions | None = None
    """Groups of other agents and their missions.

    In a group of as many actors as missions all are present at once. In any other, episodes take turns with
    the pairs of an actor and a mission, or, without missions, with the actors on random routes. Actors' names
    are unique over all groups.
    """
    bubbles: Sequence[Bubble] | None = None
    """Areas in which agents take over traffic vehicles."""
    friction_maps: Sequence[RoadSurfacePatch] | None = None
    """Areas of different friction."""
    traffic_histories: Sequence[TrafficHistoryDataset | str] | None = None
    """Recorded traffic: variations of the traffic, in mode "log"."""
    scenario_metadata: ScenarioMetadata | None = NO_METADATA
    """Facts without effect on the simulation."""
    start_variation: StartVariation | None = None
    """Variation of the starts; None keeps them fixed (an extension)."""
    held_out: Mapping[str, Variation] | None = None
    """Variations by name for measuring generalization (an extension)."""

    def __post_init__(self) -> None:
        homes: dict[str, str] = {}
        for group, actor in self._social_actors():
            if homes.setdefault(actor.name, group) != group:
                raise ValueError(
                    f"the social agent groups {homes[actor.name]!r} and {group!r} share the actor"
                    f" {actor.name!r}: give every actor a name of its own"
                )

    def _social_actors(self) -> Iterator[tuple[str, SocialAgentActor]]:
        for group, pair in (self.social_agent_missions or {}).items():
            # The build refuses what is not a pair of lists. A single actor instead of a sequence is what
            # gen_social_agent_missions accepts, too.
            actors = pair[0] if isinstance(pair, list | tuple) and pair else ()
            actors = actors if isinstance(actors, list | tuple) else [actors]
            yield from ((group, actor) for actor in actors if isinstance(actor, SocialAgentActor))
