"""The world with its maps and routes, as sensors, controllers and events read it."""

from __future__ import annotations

from dataclasses import dataclass

from smarts.roads.agent_routes import AgentRoutes
from smarts.roads.atlas import RoadAtlas
from smarts.types.world import World


@dataclass(frozen=True, eq=False)
class Scene:
    """The same three objects for the whole run; their content changes in place."""

    world: World
    atlas: RoadAtlas
    routes: AgentRoutes
