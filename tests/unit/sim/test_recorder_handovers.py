"""What is recorded of vehicles that change hands and of bubbles, from hand-made frames."""

import dataclasses

import numpy as np
import pytest

from smarts.sim.agent_pool import Hold
from smarts.sim.episode_files import RecordedEpisode
from smarts.sim.episode_tables import rows_of_holds
from smarts.sim.recorder import EpisodeRecorder
from smarts.types.agent_states import AgentStatus
from smarts.types.bubbles import COUNTS, BubbleStates, PlacedBubble
from smarts.types.episode import AgentStart
from smarts.types.mission import AgentMission
from smarts.types.transfers import CarriedOut, Reason, Refusal, Transfer
from smarts.types.vehicles import Owner
from tests.unit.sim.test_recorder_by_hand import EGO, Recording
from tests.worlds import Car

TRAFFIC, AGENT, NOBODY = Owner.TRAFFIC, Owner.AGENT, Owner.NOBODY
COLUMN = 1
SQUARE = np.array([[0.0, 0.0], [10.0, 0.0], [10.0, 10.0], [0.0, 10.0], [0.0, 0.0]])


class Handovers(Recording):
    """An ego in column 0, and two traffic vehicles that social agents have in column 1 in turn."""

    def __init__(self, folder):
        cars = [Car(x, 0.0, name=name, mission=ego) for x, name, ego in CARS]
        super().__init__(folder, cars)
        made = self.made
        scene, pool = self.recorder._scene, made.pool
        self.recorder.close()
        self.recorder = EpisodeRecorder(scene, folder, pool, policies=["keep-lane", "idm"])

    def announce(self, name, policy):
        start = AgentStart(name, (0.0, 0.0, 0.0), 0.0, AgentMission(), interface=0, policy=policy)
        self.made.pool.starts[0].append(start)
        return len(self.made.pool.starts[0]) - 1

    def hold(self, number, slot, state):
        """Let an agent have a vehicle from the step that comes next."""
        agents = self.world.agents
        self.made.pool.holds[0].append(Hold(number, COLUMN, int(self.world.step[0]) + 1))
        agents.agent[0, COLUMN], agents.slot[0, COLUMN] = number, slot
        agents.generation[0, COLUMN] = self.world.vehicles.generation[0, slot]
        agents.state[0, COLUMN], agents.release_step[0, COLUMN] = state, -1

    def transfer(self, slot, owners, columns, reason, number=-1, **more):
        generation = int(self.world.vehicles.generation[0, slot])
        (from_owner, to_owner), (from_agent, to_agent) = owners, columns
        transfer = Transfer(
            0, slot, generation, from_owner, from_agent, to_owner, to_agent, reason, number=number
        )
        return CarriedOut(transfer, **more)


CARS = [(100.0, "ego", EGO), (120.0, "first", None), (140.0, "second", None)]


@pytest.fixture(scope="module")
def episode(tmp_path_factory) -> RecordedEpisode:
    recording = Handovers(tmp_path_factory.mktemp("handovers"))
    agents = recording.world.agents
    recording.begin()
    recording.step(2)
    one = recording.announce("social-first", 1)
    recording.hold(one, 1, AgentStatus.SHADOWING)
    shadow = recording.transfer(1, (TRAFFIC, TRAFFIC), (-1, -1), Reason.SHADOW, number=one)
    recording.step(transfers=[shadow])  # 3
    recording.step(2)  # 4, 5
    agents.state[0, COLUMN] = AgentStatus.ACTIVE
    refused = {"refusals": 2, "last_refusal": Refusal.TOO_CLOSE}
    recording.step(
        transfers=[recording.transfer(1, (TRAFFIC, AGENT), (COLUMN, COLUMN), Reason.TAKE, **refused)]
    )
    recording.step(social_failures={(0, one): "NaN"})  # 7
    agents.state[0, COLUMN], agents.release_step[0, COLUMN] = AgentStatus.LEAVING, 8
    recording.step(2)  # 8, 9
    two = recording.announce("social-second", 0)
    release = recording.transfer(1, (AGENT, TRAFFIC), (COLUMN, -1), Reason.RELEASE, refusals=1)
    recording.hold(two, 2, AgentStatus.ACTIVE)
    take = recording.transfer(2, (TRAFFIC, AGENT), (-1, -1), Reason.TAKE, number=two)
    recording.step(transfers=[release, take])  # 10
    recording.step(3)
    return recording.read()


def rows(episode, table):
    columns = episode.table(table)
    return [dict(zip(columns, values, strict=True)) for values in zip(*(columns.values()), strict=True)]


def test_each_hold_has_a_row(episode):
    found = [tuple(row.values()) for row in rows(episode, "holds")]
    assert [*episode.table("holds")][:4] == ["agent", "agent_id", "name", "policy"]
    assert found == [
        (0, 0, "ego", "", -1, 0, 13, 0, 1, -1, -1),
        (1, 1, "social-first", "idm", 0, 3, 9, 1, 1, Reason.SHADOW, Reason.RELEASE),
        (2, 1, "social-second", "keep-lane", 0, 10, 13, 2, 1, Reason.TAKE, -1),
    ]


def test_an_agent_ends_before_its_vehicle_is_released(episode):
    agents, states = episode.table("agents"), episode.table("agent_states")
    assert agents["entry_step"].tolist() == [0, 3, 10]
    assert agents["end_step"].tolist() == [13, 7, 13]
    own = (states["agent_id"] == COLUMN) & (states["step"] < 10)
    assert states["release_step"][own].tolist() == [-1] * 5 + [8] * 2
    assert states["state"][own].tolist()[-2:] == [AgentStatus.LEAVING] * 2


def test_transfers_name_vehicles_and_agents_even_if_the_column_has_another_at_once(episode):
    found = [tuple(row.values()) for row in rows(episode, "transfers")]
    assert found == [
        (3, 1, 1, "first", TRAFFIC, TRAFFIC, -1, 1, Reason.SHADOW, 0, Refusal.NONE, 0),
        (6, 1, 1, "first", TRAFFIC, AGENT, 1, 1, Reason.TAKE, 2, Refusal.TOO_CLOSE, 0),
        (10, 1, 1, "first", AGENT, TRAFFIC, 1, -1, Reason.RELEASE, 1, Refusal.NONE, 0),
        (10, 2, 1, "second", TRAFFIC, AGENT, -1, 2, Reason.TAKE, 0, Refusal.NONE, 0),
    ]


def test_bubbles_are_recorded_where_they_are_when_that_changes(tmp_path):
    recording = Recording(tmp_path, [Car(100.0, 0.0, mission=EGO)])
    zone, margin = (SQUARE,), (1.2 * SQUARE - 1.0, SQUARE / 2)
    bubbles = (
        PlacedBubble("stays", "keeper", 0, 0, zone, margin),
        PlacedBubble("travels", "boids", 0, 0, zone, margin, followed="bus"),
    )
    recording.start = dataclasses.replace(recording.start, bubbles=bubbles)
    states = BubbleStates.allocate(1, 3)
    states.is_active[:] = True
    recording.frame(starts={0: recording.start}, bubbles=states)
    recording.step(2, bubbles=states)
    states.pose[0, 1] = 5.0, -2.0, 0.25
    recording.step(2, bubbles=states)
    states.is_active[0, 0], states.at_limit[0, 1] = False, 2
    recording.step(2, bubbles=states)
    episode = recording.read()
    assert rows(episode, "bubbles") == [
        {"bubble": 0, "id": "stays", "actor": "keeper", "followed": ""} | dict.fromkeys(COUNTS, 0),
        {"bubble": 1, "id": "travels", "actor": "boids", "followed": "bus"}
        | dict.fromkeys(COUNTS, 0)
        | {"at_limit": 2},
    ]
    rings = rows(episode, "bubble_rings")
    assert [(ring["bubble"], ring["is_margin"]) for ring in rings] == [
        (number, is_margin) for number in (0, 1) for is_margin in (False, True, True)
    ]
    assert np.allclose(np.stack([rings[4]["x"], rings[4]["y"]], -1), 1.2 * SQUARE - 1.0)
    assert [tuple(row.values()) for row in rows(episode, "bubble_poses")] == [
        (0, 0, 0.0, 0.0, 0.0, True),
        (0, 1, 0.0, 0.0, 0.0, True),
        (3, 1, 5.0, -2.0, 0.25, True),
        (5, 0, 0.0, 0.0, 0.0, False),
    ]


def test_rows_of_holds_equal_a_search_of_the_whole_table():
    draws = np.random.default_rng(5)
    for _ in range(50):
        holds = [
            Hold(n, int(draws.integers(4)), step) for n, step in enumerate(sorted(draws.integers(0, 40, 12)))
        ]
        there = [(step, column) for step in range(45) for column in range(4) if draws.random() < 0.5]
        there = [there[place] for place in draws.permutation(len(there))]
        step, agent_id = np.array(there, float).T
        table = {"step": step, "agent_id": agent_id}
        first, last = rows_of_holds(table, holds)
        for place, hold in enumerate(holds):
            end = next((each.step for each in holds[place + 1 :] if each.agent_id == hold.agent_id), 99)
            own = [
                k
                for k, (step, column) in enumerate(there)
                if column == hold.agent_id and hold.step <= step < end
            ]
            own.sort(key=lambda row: there[row])
            assert (first[place], last[place]) == ((own[0], own[-1]) if own else (-1, -1))
