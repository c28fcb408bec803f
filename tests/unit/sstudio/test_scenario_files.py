"""Whole scenario files as people write them: the paper's listing, and the original's two styles."""

from collections import Counter
from xml.etree import ElementTree

import pytest

from smarts.core.colors import Colors
from smarts.errors import ScenarioError
from smarts.sstudio import types as t
from smarts.sstudio.build import build_scenario
from tests.raising import raises

MERGE_NODES = """<nodes>
    <node id="north" x="0" y="60"/> <node id="south" x="0" y="-60"/> <node id="join" x="120" y="0"/>
    <node id="split" x="320" y="0"/> <node id="up" x="420" y="50"/> <node id="down" x="420" y="-50"/>
</nodes>"""
MERGE_EDGES = """<edges>
    <edge id="top_left" from="north" to="join" speed="13.89"/>
    <edge id="down_left" from="south" to="join" speed="13.89"/>
    <edge id="merge" from="join" to="split" numLanes="2" speed="13.89"/>
    <edge id="top_right" from="split" to="up" speed="13.89"/>
    <edge id="down_right" from="split" to="down" speed="13.89"/>
</edges>"""

PAPER = """
import os
from smarts.sstudio import gen_missions, gen_traffic
from smarts.sstudio.types import *

scenario = os.path.dirname(os.path.realpath(__file__))

# 1. agent mission initialization and generation
agent_missions = [
    Mission(Route(begin=("top_left", 0, 10), end=("down_right", 0, 30))),
]

gen_missions(scenario=scenario, missions=agent_missions)

# 2. define social vehicle with diverse behavior
impatient_car = TrafficActor(
    name="car",
    speed=Distribution(sigma=0.2, mean=1.0),
    lane_changing_model=LaneChangingModel(impatience=1, cooperative=0.25),
    junction_model=JunctionModel(
        drive_after_red_time=1.5,
        drive_after_yellow_time=1.0,
        impatience=1.0
    ),
)

patient_car = TrafficActor(
    name="car",
    speed=Distribution(sigma=0.2, mean=0.8),
    lane_changing_model=LaneChangingModel(impatience=0, cooperative=0.5),
    junction_model=JunctionModel(drive_after_yellow_time=1.0, impatience=0.5)
)

# 3. traffic flow customization
traffic = Traffic(
    flows=[
        Flow(
            route=Route(begin=("down_left", 0, 30), end=("merge", 0, 150),),
            rate=1.,
            actors={impatient_car: 0.5, patient_car: 0.5},
        ),
    ]
)

gen_traffic(scenario, traffic, name="example")
"""


@pytest.fixture
def merge_folder(tmp_path):
    """Return a function that makes a scenario folder on the paper's map."""

    def make(script):
        (tmp_path / "map.nod.xml").write_text(MERGE_NODES)
        (tmp_path / "map.edg.xml").write_text(MERGE_EDGES)
        (tmp_path / "scenario.py").write_text(script)
        return tmp_path

    return make


def test_the_papers_listing(merge_folder):
    built = build_scenario(merge_folder(PAPER))
    (mission,) = built.scenario.ego_missions
    assert mission == t.Mission(t.Route(begin=("top_left", 0, 10), end=("down_right", 0, 30)))
    root = ElementTree.parse(built.traffic["example"].routes[0]).getroot()
    kinds = {kind.attrib["speedFactor"]: kind.attrib for kind in root.iter("vType")}
    assert kinds.keys() == {"normc(1,0.2,0.2,2)", "normc(0.8,0.2,0.2,2)"}
    impatient, patient = kinds["normc(1,0.2,0.2,2)"], kinds["normc(0.8,0.2,0.2,2)"]
    assert (impatient["lcImpatience"], impatient["lcCooperative"], impatient["impatience"]) == (
        "1",
        "0.25",
        "1",
    )
    assert (impatient["jmDriveAfterRedTime"], impatient["jmDriveAfterYellowTime"]) == ("1.5", "1")
    assert (patient["lcImpatience"], patient["impatience"]) == ("0", "0.5")
    assert "jmDriveAfterRedTime" not in patient
    (mixture,) = root.iter("vTypeDistribution")
    assert Counter(mixture.attrib["probabilities"].split()) == {"0.5": 2}
    (flow,) = root.iter("flow")
    assert (flow.attrib["vehsPerHour"], flow.attrib["arrivalPos"]) == ("1", "150")
    (route,) = root.iter("route")
    assert route.attrib["edges"] == "down_left merge"


# The first generation: smarts.sstudio.types, edges, overwrite flags, functions for each part.


SECOND = """
import random
from itertools import combinations, product
from pathlib import Path

from numpy import random as numpy_random

from smarts.core.colors import Colors
from smarts.errors import ScenarioError
from smarts.sstudio import gen_scenario
from smarts.sstudio import sstypes
from smarts.sstudio.sstypes import (
    Bubble, ConfigurableZone, Distribution, Flow, IdEntryTactic, LaneChangingModel, MapSpec, MapZone, Mission,
    PositionalZone, RandomRoute, Route, Scenario, ScenarioMetadata, SmartsLaneChangingModel, SocialAgentActor,
    TimeWindowCondition, Traffic, TrafficActor, TrafficEngineActor, TrapEntryTactic, Trip,
)
from smarts.sstudio.sstypes.entry_tactic import IdEntryTactic
from smarts.sstudio.sstypes.route import RandomRoute
from smarts.sstudio.sstypes.traffic import Trip

cars = [
    TrafficActor(
        name=f"car_{kind}",
        vehicle_type=kind,
        speed=Distribution(mean=random.uniform(0.5, 1), sigma=0.1),
        lane_changing_model=SmartsLaneChangingModel(cutin_prob=1, assertive=10, dogmatic=True),
    )
    for kind in ("passenger", "coach", "truck", "trailer")
]
ways = list(product(("from_west", "from_south"), ("to_east", "to_north")))
traffic = {
    f"{name}": Traffic(
        engine=engine,
        flows=[
            Flow(
                route=Route(begin=(begin, random.randint(0, 1), "random"), end=(end, 0, "max")),
                rate=60 * numpy_random.uniform(5, 10),
                begin=random.uniform(0, 5),
                end=60 * 15,
                actors={car: numpy_random.randint(1, 5) for car in cars},
                randomly_spaced=True,
                repeat_route=True,
            )
            for begin, end in chosen
        ],
        trips=[Trip("leader", route=RandomRoute(), depart=0.5), Trip("other", RandomRoute(), "bus")],
    )
    for name, (engine, chosen) in enumerate(product(("SUMO", "SMARTS"), combinations(ways, 3)))
}
agent = SocialAgentActor(name="keep-lane-agent", agent_locator="zoo.policies:keep-lane-agent-v0")

gen_scenario(
    scenario=Scenario(
        map_spec=MapSpec(source=f"{Path(__file__).parent}", lanepoint_spacing=1.0),
        traffic=traffic,
        ego_missions=[
            Mission(
                Route(("from_west", 0, 30), ("to_east", 0, "max")),
                entry_tactic=TrapEntryTactic(
                    start_time=12, wait_to_hijack_limit_s=1, zone=MapZone(("from_west", 0, 1), 20, 1)
                ),
            )
        ],
        social_agent_missions={
            "all": (
                [agent],
                [
                    Mission(
                        route=RandomRoute(),
                        entry_tactic=IdEntryTactic(
                            start_time=0.1, actor_id="other", condition=TimeWindowCondition(0.1, 20.0)
                        ),
                    )
                ],
            )
        },
        bubbles=[
            Bubble(
                zone=PositionalZone(pos=(50, 0), size=(10, 15)),
                margin=5,
                actor=agent,
                follow_actor_id=Bubble.to_actor_id(agent, mission_group="all"),
                follow_offset=(-7, 10),
            ),
            Bubble(
                zone=ConfigurableZone(ext_coordinates=[(0, 0), (20, 40)]),
                actor=TrafficEngineActor("engine"),
                active_condition=TimeWindowCondition(1, 9).trigger(delay_seconds=2),
            ),
        ],
        scenario_metadata=ScenarioMetadata(
            actor_of_interest_re_filter=r"^(leader)|(other)$",
            actor_of_interest_color=Colors.Blue,
            scenario_difficulty=0.5,
            scenario_duration=40,
        ),
    ),
    output_dir=Path(__file__).parent,
    seed=40,
)
"""


def test_the_second_generation(scenario_folder):
    built = build_scenario(scenario_folder(SECOND))
    scenario = built.scenario
    assert len(scenario.traffic) == 8
    assert list(built.traffic) == list(scenario.traffic)
    assert scenario.map_spec.source == "."
    assert scenario.scenario_metadata["actor_of_interest_color"] is Colors.Blue
    assert scenario.bubbles[0].follow_actor_id == "social-agent-all-keep-lane-agent"
    assert scenario.ego_missions[0].entry_tactic.start_time == 12
    root = ElementTree.parse(built.traffic["0"].routes[0]).getroot()
    assert {trip.attrib["id"] for trip in root.iter("vehicle")} == {"leader", "other"}
    assert all(flow.attrib["period"].startswith("exp(") for flow in root.iter("flow"))
    assert built.seed == 40


@pytest.mark.parametrize(
    ("call", "meant"), [("t.Scenari()", "'Scenario'"), ("t.Scenario(trafic={})", "'traffic'")]
)
def test_misspelt_names_of_the_language(scenario_folder, call, meant):
    folder = scenario_folder(f"from smarts.sstudio import types as t\n{call}")
    with raises(
        ScenarioError, "scenario.py, line 2", values=[f"id you mean {meant}"]
    ):  # "Did ...", from 3.13 on by Python itself
        build_scenario(folder)
