"""Vehicles of traffic without an agent stop at red lights, before SUMO drives them again."""

from contextlib import closing

import numpy as np

from smarts.agents import ActionSpaceType, AgentInterface, DoneCriteria
from smarts.agents.policy import BatchAgent
from smarts.env import VectorHiWayEnv
from smarts.providers.sumo_engine import SumoEngine
from smarts.types.agent_states import AgentStatus
from smarts.types.transfers import Refusal
from smarts.types.vehicles import Owner
from smarts.zoo import register

LIGHT = 300.0
NODES = """<nodes>
    <node id="a" x="0" y="0"/> <node id="b" x="300" y="0" type="traffic_light" tl="b"/>
    <node id="c" x="400" y="0"/> <node id="far" x="0" y="500"/> <node id="away" x="2000" y="500"/>
</nodes>"""
EDGES = """<edges>
    <edge id="ab" from="a" to="b" speed="13.89"/> <edge id="bc" from="b" to="c" speed="13.89"/>
    <edge id="ego" from="far" to="away" speed="13.89"/>
</edges>"""
LINKS = """<connections><connection from="ab" to="bc" fromLane="0" toLane="0"/></connections>"""
LIGHTS = """<tlLogics>
    <tlLogic id="b" type="static" programID="0" offset="0"><phase duration="1000" state="r"/></tlLogic>
    <connection from="ab" to="bc" fromLane="0" toLane="0" tl="b" linkIndex="0"/>
</tlLogics>"""
SCRIPT = """
from pathlib import Path
from smarts.sstudio import gen_scenario, types as t

flow = t.Flow(t.Route(("ab", 0, 10), ("bc", 0, "max")), rate=60, begin=0, actors={t.TrafficActor("car"): 1})
driver = t.SocialAgentActor("driver", agent_locator="LOCATOR")
bubble = t.Bubble(t.PositionalZone((MIDDLE, 0), (80, 20)), driver, margin=10, limit=t.BubbleLimits(1, 1))
gen_scenario(
    t.Scenario(
        traffic={"cars": t.Traffic(flows=[flow])},
        ego_missions=[t.Mission(t.Route(("ego", 0, 10), ("ego", 0, "max")))],
        bubbles=[bubble],
    ),
    output_dir=Path(__file__).parent,
)
"""


class Keeping(BatchAgent):
    """Keeps its lane, whatever the light is."""

    interface = AgentInterface(
        action=ActionSpaceType.Lane, vehicle_model="kinematic", done_criteria=DoneCriteria(off_route=False)
    )
    observation = ("speed",)

    def act(self, obs):
        return np.zeros(len(obs.env_id), int)


register("keeping-v0", Keeping)


def test_a_vehicle_that_sumo_does_not_take_back_stops_at_a_red_light(tmp_path, monkeypatch):
    for suffix, text in (("nod", NODES), ("edg", EDGES), ("con", LINKS), ("tll", LIGHTS)):
        (tmp_path / f"map.{suffix}.xml").write_text(text)
    script = SCRIPT.replace("LOCATOR", f"{__name__}:keeping-v0").replace("MIDDLE", "90")
    (tmp_path / "scenario.py").write_text(script)
    monkeypatch.setattr(
        SumoEngine, "can_accept", lambda self, rows, slots: np.full(len(slots), Refusal.TOO_CLOSE, np.int8)
    )
    with closing(VectorHiWayEnv(1, [tmp_path], 1, decision_interval=1)) as env:
        env.reset(seed=1)
        vehicles, agents = env._runner.world.vehicles, env._runner.world.agents
        driven = None
        for _ in range(600):
            env.step([np.zeros((1, 1), int)])
            if driven is None:
                taken = np.flatnonzero(
                    (vehicles.owner[0] == Owner.AGENT) & (vehicles.home[0] == Owner.TRAFFIC)
                )
                driven = int(taken[0]) if len(taken) else None
            elif vehicles.position[0, driven, 0] > LIGHT - 20.0 and vehicles.speed[0, driven] < 0.01:
                break
        assert driven is not None
        front = float(vehicles.position[0, driven, 0] + 0.5 * vehicles.length[0, driven])
        edge = env._runner.scene.atlas.graphs[0]
        line = float(edge.centreline(edge.lane_number("ab", 0))[-1, 0])
        assert line - 3.0 < front <= line
        assert vehicles.speed[0, driven] < 0.01
        assert vehicles.owner[0, driven] == Owner.AGENT, "the fallback controller drives it"
        (column,) = np.flatnonzero(agents.slot[0] == driven)
        assert agents.state[0, column] == AgentStatus.LEAVING or agents.release_step[0, column] >= 0
