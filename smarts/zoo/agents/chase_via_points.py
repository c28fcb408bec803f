"""The agent `chase-via-points-v0`."""

from __future__ import annotations

from typing import Any, ClassVar

from smarts.agents.interface import AgentInterface
from smarts.agents.options import Waypoints
from smarts.agents.policy import Agent
from smarts.zoo.driving import DRIVER


class ChaseViaPoints(Agent):
    """Drives to its mission's via points, in their lanes and at their speeds; elsewhere keeps its lane.

    It heeds no other vehicles, as the original's agent of this name.
    """

    interface: ClassVar[AgentInterface] = DRIVER.replace(waypoint_paths=Waypoints(lookahead=20))

    def act(self, obs: Any) -> tuple[float, int]:
        """Return the target speed [m/s] and the lane change."""
        own = obs.ego_vehicle_state
        ahead = [via for via in obs.via_data.near_via_points if not via.hit and via.road_id == own.road_id]
        if not ahead:
            paths = [path for path in obs.waypoint_paths if path]
            return (float(paths[0][0].speed_limit) if paths else 0.0), 0
        via = ahead[0]
        difference = via.lane_index - own.lane_index
        return float(via.required_speed), (difference > 0) - (difference < 0)
