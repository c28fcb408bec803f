"""What sensors, controllers and judges of events look at: the world, on its maps, with its routes."""

from __future__ import annotations

from dataclasses import dataclass

from smarts.roads.agent_routes import AgentRoutes
from smarts.roads.atlas import RoadAtlas
from smarts.types.world import World


@dataclass(frozen=True, eq=False)
class Scene:
    """The same three objects for the whole run; what is in them changes in place."""

    world: World
    atlas: RoadAtlas
    routes: AgentRoutes
