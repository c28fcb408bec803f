"""The vocabulary of scenarios; `smarts.sstudio.types` is the usual way in."""

from smarts.sstudio.sstypes.actor import Actor
from smarts.sstudio.sstypes.actor.social_agent_actor import BoidAgentActor, SocialAgentActor
from smarts.sstudio.sstypes.actor.traffic_actor import TrafficActor
from smarts.sstudio.sstypes.actor.traffic_engine_actor import TrafficEngineActor
from smarts.sstudio.sstypes.bubble import Bubble
from smarts.sstudio.sstypes.bubble_limits import BubbleLimits
from smarts.sstudio.sstypes.condition import (
    CompoundCondition,
    Condition,
    ConditionOperator,
    ConditionRequires,
    ConditionTrigger,
    DependeeActorCondition,
    ExpireTrigger,
    LiteralCondition,
    NegatedCondition,
    OffRoadCondition,
    SubjectCondition,
    TimeWindowCondition,
    VehicleSpeedCondition,
    VehicleTypeCondition,
)
from smarts.sstudio.sstypes.constants import MAX, MISSING
from smarts.sstudio.sstypes.dataset import TrafficHistoryDataset
from smarts.sstudio.sstypes.distribution import Distribution, TruncatedDistribution, UniformDistribution
from smarts.sstudio.sstypes.entry_tactic import EntryTactic, IdEntryTactic, TrapEntryTactic
from smarts.sstudio.sstypes.map_spec import MapBuilder, MapSpec
from smarts.sstudio.sstypes.mission import (
    AnyMission,
    CutIn,
    EndlessMission,
    GroupedLapMission,
    LapMission,
    Mission,
    UTurn,
    Via,
)
from smarts.sstudio.sstypes.route import JunctionEdgeIDResolver, RandomRoute, Route
from smarts.sstudio.sstypes.scenario import (
    Scenario,
    ScenarioMetadata,
    ScenarioMetadataFields,
    SocialMissions,
    StartVariation,
    Variation,
)
from smarts.sstudio.sstypes.standard_metadata import StandardMetadata
from smarts.sstudio.sstypes.traffic import Flow, Stop, Traffic, Trip
from smarts.sstudio.sstypes.traffic_model import (
    JunctionModel,
    LaneChangingModel,
    SmartsJunctionModel,
    SmartsLaneChangingModel,
    TrafficModel,
)
from smarts.sstudio.sstypes.zone import ConfigurableZone, MapZone, PositionalZone, RoadSurfacePatch, Zone
from smarts.types.condition_state import ConditionState

__all__ = [
    "MAX",
    "MISSING",
    "Actor",
    "AnyMission",
    "BoidAgentActor",
    "Bubble",
    "BubbleLimits",
    "CompoundCondition",
    "Condition",
    "ConditionOperator",
    "ConditionRequires",
    "ConditionState",
    "ConditionTrigger",
    "ConfigurableZone",
    "CutIn",
    "DependeeActorCondition",
    "Distribution",
    "EndlessMission",
    "EntryTactic",
    "ExpireTrigger",
    "Flow",
    "GroupedLapMission",
    "IdEntryTactic",
    "JunctionEdgeIDResolver",
    "JunctionModel",
    "LaneChangingModel",
    "LapMission",
    "LiteralCondition",
    "MapBuilder",
    "MapSpec",
    "MapZone",
    "Mission",
    "NegatedCondition",
    "OffRoadCondition",
    "PositionalZone",
    "RandomRoute",
    "RoadSurfacePatch",
    "Route",
    "Scenario",
    "ScenarioMetadata",
    "ScenarioMetadataFields",
    "SmartsJunctionModel",
    "SmartsLaneChangingModel",
    "SocialAgentActor",
    "SocialMissions",
    "StandardMetadata",
    "StartVariation",
    "Stop",
    "SubjectCondition",
    "TimeWindowCondition",
    "Traffic",
    "TrafficActor",
    "TrafficEngineActor",
    "TrafficHistoryDataset",
    "TrafficModel",
    "TrapEntryTactic",
    "Trip",
    "TruncatedDistribution",
    "UTurn",
    "UniformDistribution",
    "Variation",
    "VehicleSpeedCondition",
    "VehicleTypeCondition",
    "Via",
    "Zone",
]
