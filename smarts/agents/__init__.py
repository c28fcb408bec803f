"""Agents: interfaces (sensors and actions), policies, and specs, which hold both."""

from smarts.agents.criteria import (
    AgentsAliveDoneCriteria,
    AgentsListAlive,
    DoneCriteria,
    EventConfiguration,
    InterestDoneCriteria,
)
from smarts.agents.interface import AgentInterface
from smarts.agents.options import (
    OGM,
    RGB,
    Accelerometer,
    BasicLidar,
    DrivableAreaGridMap,
    InterfaceError,
    LanePositions,
    Lidar,
    NeighborhoodVehicles,
    OcclusionMap,
    RoadWaypoints,
    SensorParams,
    Signals,
    VelodyneHDL32E,
    Vias,
    Waypoints,
)
from smarts.agents.policy import ActionBatch, Agent, AgentPolicy, BatchAgent
from smarts.agents.pooled import PooledAgents
from smarts.agents.spec import AgentSpec
from smarts.agents.types import AgentType
from smarts.types.actions import ActionSpaceType

__all__ = [
    "OGM",
    "RGB",
    "Accelerometer",
    "ActionBatch",
    "ActionSpaceType",
    "Agent",
    "AgentInterface",
    "AgentPolicy",
    "AgentSpec",
    "AgentType",
    "AgentsAliveDoneCriteria",
    "AgentsListAlive",
    "BasicLidar",
    "BatchAgent",
    "DoneCriteria",
    "DrivableAreaGridMap",
    "EventConfiguration",
    "InterestDoneCriteria",
    "InterfaceError",
    "LanePositions",
    "Lidar",
    "NeighborhoodVehicles",
    "OcclusionMap",
    "PooledAgents",
    "RoadWaypoints",
    "SensorParams",
    "Signals",
    "VelodyneHDL32E",
    "Vias",
    "Waypoints",
]
