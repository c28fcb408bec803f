import json
import math
from pathlib import Path

import numpy as np
import pytest

from smarts.core.colors import Colors
from smarts.errors import ScenarioError
from smarts.sstudio import types as t
from smarts.sstudio.decoding import CallableReference, decode
from smarts.sstudio.encoding import canonical, encode

AGENT = t.SocialAgentActor("agent", "zoo:agent-v0", policy_kwargs={"speed": 3, "names": {"a", "b"}})
ROUTE = t.Route(("a", 0, "base"), ("b", 1, 20.5), via=["c"])
EVERYTHING = t.Scenario(
    map_spec=t.MapSpec("map.xodr"),
    traffic={
        "one": t.Traffic(
            flows=[
                t.Flow(
                    ROUTE,
                    600,
                    actors={
                        t.TrafficActor("car", lane_changing_model=t.LaneChangingModel(speed_gain=2)): 0.25,
                        t.TrafficActor("car", speed=t.UniformDistribution(0.5, 1)): 0.75,
                    },
                    stops=[t.Stop("c", 0, 50, 20)],
                )
            ],
            trips=[t.Trip("leader", t.RandomRoute(), actor=t.TrafficActor("x", vehicle_type="truck"))],
            warm_up=20,
        )
    },
    ego_missions=[
        t.Mission(ROUTE, task=t.CutIn(complete_on_edge_id=t.JunctionEdgeIDResolver("a", 0, "b", 1))),
        t.EndlessMission(("a", 0, "random"), via=(t.Via("a", 0, 3, 5),)),
        t.LapMission(ROUTE, 3, entry_tactic=t.TrapEntryTactic(1, zone=t.MapZone(("a", 0, 1), 10, 1))),
        t.GroupedLapMission(ROUTE, 10, 2, 4, 3, entry_tactic=t.IdEntryTactic(2, "leader")),
    ],
    social_agent_missions={"all": ([AGENT], [t.Mission(ROUTE)])},
    bubbles=[
        t.Bubble(
            t.ConfigurableZone([(0, 0), (4, 0), (4, 4)]),
            t.BoidAgentActor("boid", "zoo:boid-v0", capacity=t.BubbleLimits(2, 3)),
            airlock_condition=t.TimeWindowCondition(1, 2).trigger(3) | -t.OffRoadCondition(),
        )
    ],
    friction_maps=[t.RoadSurfacePatch(t.PositionalZone((1, 2), (3, 4), 0.5), 0, 10, 0.3)],
    traffic_histories=[t.TrafficHistoryDataset("i80", "NGSIM")],
    scenario_metadata=t.ScenarioMetadata({"n": 1}, actor_of_interest_color=Colors.Blue),
    start_variation=t.StartVariation(3, (1, 2)),
    held_out={"other": t.Variation("Other traffic.", traffic={"none": t.Traffic(flows=[])}, seed=1)},
)


def test_a_scenario_survives_the_round_trip_through_json():
    decoded = decode(json.loads(json.dumps(encode(EVERYTHING))))
    assert decoded == EVERYTHING
    assert canonical(decoded) == canonical(EVERYTHING)
    assert decoded.traffic["one"].flows[0].actors == EVERYTHING.traffic["one"].flows[0].actors
    assert decoded.bubbles[0].airlock_condition == EVERYTHING.bubbles[0].airlock_condition


@pytest.mark.parametrize(
    ("one", "other"),
    [(1, 1.0), (np.float64(0.5), 0.5), (np.int64(3), 3), ([1, 2], (1, 2)), (np.array([1.0, 2.0]), [1, 2])],
)
def test_equal_values_are_encoded_equally(one, other):
    assert canonical(one) == canonical(other)


@pytest.mark.parametrize(
    "value", [math.inf, -math.inf, {"a": {"b": (1, None, True)}}, {1: "x"}, frozenset({1, 2})]
)
def test_plain_data_survives(value):
    assert decode(json.loads(json.dumps(encode(value)))) == value


def test_named_functions_become_references():
    assert encode(Path("a") / "b") == "a/b"
    reference = decode(encode({"f": math.sqrt, "c": t.Route}))
    assert reference["f"] == CallableReference("math:sqrt")
    assert reference["c"].load() is t.Route


def test_what_cannot_be_written_down_is_named():
    value = object()
    scenario = t.Scenario(
        social_agent_missions={
            "all": ([t.SocialAgentActor("a", "zoo:a-v0", policy_kwargs={"x": value})], [t.Mission(ROUTE)])
        }
    )
    with pytest.raises(ScenarioError) as caught:
        encode(scenario)
    assert caught.value.place == "social_agent_missions['all'][0][0].policy_kwargs['x']"
