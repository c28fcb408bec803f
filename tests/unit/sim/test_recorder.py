"""Recording: what is read back equals a naive log of every step; a store never holds half an episode."""

import dataclasses
import itertools
import signal
import subprocess
import sys
import textwrap

import numpy as np
import pytest

from smarts.agents.interface import AgentInterface
from smarts.sim.assembly import assemble
from smarts.sim.episode_files import PARTIAL, EpisodeStore, RecordedEpisode, arrow_schema, episodes_in
from smarts.sim.recorder import EpisodeRecorder
from smarts.sim.recorder_kernel import NEAR
from smarts.sstudio.build import build_scenario
from smarts.types.actions import ActionSpaceType, LaneAction
from smarts.types.agent_states import AgentStatus
from smarts.types.episode_schema import TABLE, TABLES
from smarts.types.events import Outcome

WORLDS, EGOS, PERIOD, LIMIT = 2, 4, 5, 60
KEEP = 150

VEHICLES = {
    **{name: name for name in ("generation", "owner", "kind", "heading", "speed", "lateral_speed")},
    **{name: name for name in ("acceleration", "lateral_acceleration", "yaw_rate", "length", "width")},
    **{name: name for name in ("lane", "route", "desired_speed")},
    "s": "lane_position",
    "t": "lane_offset",
}
AGENT_STATES = (
    "state",
    "slot",
    "generation",
    "throttle",
    "brake",
    "steering",
    "route_progress",
    "remaining",
    "distance_travelled",
)
AGENT_STATES += ("lap", "target_lane", "change_phase", "arrival_number")


class Log:
    """Keeps everything of every frame, as plain as possible; stands in the recorder's place before it."""

    def __init__(self, recorder):
        self.recorder = recorder
        self.frames = [[] for _ in range(WORLDS)]

    def record(self, frame):
        world = frame.world
        for row in np.flatnonzero(frame.env_mask).tolist():
            if row in frame.starts:
                self.frames[row] = []
            kept = {name: column[row].copy() for name, column in world.vehicles._asdict().items()}
            kept |= {f"agents.{name}": column[row].copy() for name, column in world.agents._asdict().items()}
            kept |= {"bits": frame.events.bits[row].copy(), "partner": frame.contacts.partner[row].copy()}
            kept |= {"side": frame.contacts.side[row].copy(), "step": int(world.step[row])}
            kept["names"] = [world.registry.name(row, slot) for slot in range(world.vehicles.capacity)]
            kept["closing_speed"] = frame.contacts.closing_speed[row].copy()
            kept["terminated"] = frame.events.terminated[row].copy()
            if frame.actions is not None:
                kept |= {
                    f"actions.{n}": getattr(frame.actions, n)[row].copy()
                    for n in ("fresh", "values", "action_mask")
                }
            self.frames[row].append(kept)
        self.recorder.record(frame)

    def close(self):
        self.recorder.close()


class Run:
    """Agents that accelerate, brake and change lanes by a rule of their agent and the step, recorded."""

    def __init__(self, folder):
        interface = AgentInterface(action=ActionSpaceType.Lane, max_episode_steps=LIMIT)
        parts = assemble([build_scenario("intersection")], [interface] * EGOS, worlds=WORLDS)
        self.parts, self.simulation, self.actions = parts, parts.simulation, parts.actions
        self.recorder = EpisodeRecorder(parts.scene, folder, parts.pool)
        self.log = Log(self.recorder)
        self.simulation._stages = dataclasses.replace(self.simulation._stages, recorder=self.log)

    def reset(self, episode):
        self.starts = {row: self.parts.schedule.start(row, episode) for row in range(WORLDS)}
        self.simulation.reset(self.starts)

    def step(self, running):
        world, actions = self.simulation.world, self.actions
        due = (
            (world.step % PERIOD == 0)[:, None]
            & (world.agents.state == AgentStatus.ACTIVE)
            & running[:, None]
        )
        actions.fresh[:] = due
        actions.given[:] |= due
        actions.action_mask[:] = world.agents.action_mask
        phase = (world.step // PERIOD)[:, None] + np.arange(EGOS)
        actions.values[:, :, 0] = np.where(phase % 7 == 3, LaneAction.slow_down, LaneAction.keep_lane)
        self.recorder.annotate("probabilities", np.stack([phase, phase + 0.5], -1), due)
        return self.simulation.step(actions, running, np.ones((WORLDS, EGOS), np.bool_))

    def play(self, episode, steps=1000):
        self.reset(episode)
        running = np.ones(WORLDS, np.bool_)
        for _ in range(steps):
            if not running.any():
                break
            running &= ~self.step(running).events.finished


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """Return the recorded episodes of a run, and the log of each."""
    folder = tmp_path_factory.mktemp("episodes") / "of" / "a-run"
    run = Run(folder)
    run.play(1)
    logs = [list(frames) for frames in run.log.frames]
    # What is said about an episode after its end still belongs to it, until the next begins.
    last = np.full(WORLDS, 5, np.int32)
    run.recorder.annotate(
        "reward", np.arange(WORLDS * EGOS).reshape(WORLDS, EGOS), np.ones((WORLDS, EGOS), bool), last
    )
    starts = [run.starts[row] for row in range(WORLDS)]
    routes = [planned(run.parts.scene, row) for row in range(WORLDS)]
    run.reset(2)
    run.step(np.array([True, False]))
    run.simulation.close()
    return folder, logs, starts, routes


def planned(scene, row):
    """Return the routes of a simulation, by ids of edges."""
    ids, routes = scene.atlas.graphs[scene.world.map[row]].edge_ids, scene.world.routes
    return [tuple(ids[edge] for edge in routes.edges(row, n)) for n in range(routes.count(row))]


@pytest.fixture(scope="module", params=range(WORLDS))
def pair(recorded, request):
    folder, logs, starts, routes = recorded
    row = request.param
    episode = RecordedEpisode(folder / f"seed42_world{row}_episode00001")
    return episode, logs[row], starts[row], routes[row]


def rows(episode, table):
    """Return a table as a list of dictionaries."""
    columns = episode.table(table)
    return [dict(zip(columns, values, strict=True)) for values in zip(*columns.values(), strict=True)]


def near(frame):
    """Tell which slots are near an agent that drives or has just ended."""
    slots = frame["agents.slot"][
        (frame["agents.slot"] >= 0) & (frame["agents.state"] >= AgentStatus.SHADOWING)
    ]
    apart = np.linalg.norm(frame["position"][:, None] - frame["position"][slots], axis=-1)
    return frame["alive"] & (apart <= NEAR).any(axis=1)


def test_vehicles_equal_the_log(pair):
    episode, log, _, _ = pair
    recorded = {(row["step"], row["slot"]): row for row in rows(episode, "vehicles")}
    until = {}
    expected = set()
    for frame in log:
        for slot in np.flatnonzero(frame["alive"]).tolist():
            vehicle = slot, int(frame["generation"][slot])
            if near(frame)[slot]:
                until[vehicle] = frame["step"] + KEEP
            if frame["step"] <= until.get(vehicle, -1):
                expected.add((frame["step"], slot))
                row = recorded[frame["step"], slot]
                assert (row["x"], row["y"]) == tuple(frame["position"][slot])
                for column, source in VEHICLES.items():
                    assert row[column] == np.asarray(frame[source][slot]).astype(row[column].dtype), column
    assert set(recorded) == expected
    assert len(expected) > 20 * len(log)


def test_agents_equal_the_log(pair):
    episode, log, _, _ = pair
    recorded = {(row["step"], row["agent_id"]): row for row in rows(episode, "agent_states")}
    expected = 0
    for frame in log:
        for agent_id in np.flatnonzero(frame["agents.state"] >= AgentStatus.SHADOWING).tolist():
            row = recorded[frame["step"], agent_id]
            expected += 1
            for column in AGENT_STATES:
                value = np.asarray(frame[f"agents.{column}"][agent_id])
                assert row[column] == value.astype(row[column].dtype), column
            assert row["events"] == frame["bits"][agent_id]
            assert row["partner_slot"] == frame["partner"][agent_id]
            assert row["action_mask"] == sum(
                1 << bit for bit in np.flatnonzero(frame["agents.action_mask"][agent_id]).tolist()
            )
    assert len(recorded) == expected


def test_decisions_carry_the_state_they_were_made_on(pair):
    episode, log, _, _ = pair
    recorded = {(row["step"], row["agent_id"]): row for row in rows(episode, "decisions")}
    expected = 0
    for before, frame in itertools.pairwise(log):
        for agent_id in np.flatnonzero(frame["actions.fresh"]).tolist():
            expected += 1
            row = recorded[before["step"], agent_id]
            assert row["value_0"] == frame["actions.values"][agent_id, 0]
            assert row["action"] == ActionSpaceType.Lane
            # The mask is that of the state before, which the agent saw.
            assert row["action_mask"] == sum(
                1 << bit for bit in np.flatnonzero(before["agents.action_mask"][agent_id]).tolist()
            )
            assert row["is_effective"] == frame["agents.effective"][agent_id]
    assert len(recorded) == expected
    assert {step % PERIOD for step, _ in recorded} == {0}


def test_agents(pair):
    episode, log, start, routes = pair
    outcomes = set()
    for agent_id, agent in enumerate(rows(episode, "agents")):
        last = next(f for f in log if f["agents.outcome"][agent_id])
        begin = start.agents[agent_id]
        assert agent["name"] == begin.name == f"agent-{agent_id}"
        assert (agent["start_x"], agent["start_y"]) == begin.pose[:2]
        assert agent["start_speed"] == np.float32(begin.speed)
        assert (agent["entry_step"], agent["end_step"]) == (0, last["step"])
        assert agent["outcome"] == last["agents.outcome"][agent_id]
        assert agent["terminated"] == last["terminated"][agent_id]
        assert agent["terminated"] != agent["truncated"]
        assert agent["remaining"] == np.float32(last["agents.remaining"][agent_id])
        assert agent["goal"] == begin.mission.goal
        assert routes[agent["route"]] == begin.mission.route
        assert agent["free_flow_time"] == np.float32(begin.mission.free_flow_time)
        outcomes.add(agent["outcome"])
        if agent["outcome"] != Outcome.COLLISION:
            assert agent["partner_slot"] == -1
            continue
        partner = agent["partner_slot"]
        assert partner == last["partner"][agent_id]
        assert agent["partner"] == last["names"][partner]
        assert agent["partner_owner"] == last["owner"][partner]
        holders = np.flatnonzero(last["agents.slot"] == partner).tolist()
        assert agent["partner_agent_id"] == (holders[0] if holders else -1)
        assert agent["side"] == last["side"][agent_id]
        assert agent["closing_speed"] == np.float32(last["closing_speed"][agent_id])
    assert Outcome.COLLISION in outcomes


def test_names_and_routes(pair):
    episode, log, _, routes = pair
    seen = {}
    for frame in log:
        for slot in np.flatnonzero(near(frame)).tolist():
            seen.setdefault((slot, int(frame["generation"][slot])), (frame["names"][slot], frame["step"]))
    recorded = {(r["slot"], r["generation"]): (r["name"], r["first_step"]) for r in rows(episode, "names")}
    assert recorded == seen
    ids = episode.roads().edge_ids
    assert [tuple(ids[edge] for edge in row["edges"]) for row in rows(episode, "routes")] == routes


def test_extras(pair):
    episode, _, start, _ = pair
    extras = rows(episode, "extras")
    said = {(row["step"], row["agent_id"]): row["values"] for row in extras if row["name"] == "probabilities"}
    decisions = {(row["step"], row["agent_id"]) for row in rows(episode, "decisions")}
    assert set(said) == decisions
    for (step, agent_id), values in said.items():
        assert values.tolist() == [step // PERIOD + agent_id, step // PERIOD + agent_id + 0.5]
    rewards = {row["agent_id"]: row["values"].tolist() for row in extras if row["name"] == "reward"}
    assert rewards == {agent_id: [start.world * EGOS + agent_id] for agent_id in range(EGOS)}
    assert all(row["step"] == 5 for row in extras if row["name"] == "reward")


def test_facts(pair):
    episode, log, start, _ = pair
    facts = episode.facts
    assert facts["scenario"] == "intersection"
    assert (facts["seed"], facts["world"], facts["episode"]) == (42, start.world, 1)
    assert facts["traffic_engine"] == start.engine
    assert facts["traffic_seed"] == start.traffic_seed
    assert facts["traffic"] == start.traffic_name
    assert facts["steps"] == log[-1]["step"]
    assert facts["most_vehicles"] == max(frame["alive"].sum() for frame in log)
    assert facts["is_complete"]
    assert not facts["is_invalid"]
    assert facts["remark"] == ""
    built = build_scenario("intersection").roads()
    assert episode.roads().lane_ids == built.lane_ids
    assert (episode.roads().point_xy == built.point_xy).all()


def test_an_episode_cut_short_says_so(recorded):
    folder = recorded[0]
    for row, steps in ((0, 1), (1, 0)):
        facts = RecordedEpisode(folder / f"seed42_world{row}_episode00002").facts
        assert not facts["is_complete"]
        assert "before its end" in facts["remark"]
        assert facts["steps"] == steps


def test_the_store_holds_whole_episodes_and_nothing_else(recorded):
    folder = recorded[0]
    assert [path.name for path in episodes_in(folder)] == [
        f"seed42_world{world}_episode0000{episode}" for world in range(WORLDS) for episode in (1, 2)
    ]
    assert sorted(path.name for path in folder.iterdir() if path.name[0] != "s") == ["maps"]
    assert len(list((folder / "maps").iterdir())) == 1
    for path in episodes_in(folder):
        always = {table.name for table in TABLES if not table.is_optional}
        # Agents that have ended leave, unless the episode is cut short.
        changes = {"transfers"} if RecordedEpisode(path).facts["is_complete"] else set()
        assert {file.stem for file in path.iterdir()} == always | {"holds"} | changes


def empty(table):
    return {name: [] for name in TABLE[table].names}


KILLED = """
    import os, signal, sys
    from pathlib import Path
    from smarts.sim.episode_files import EpisodeStore
    from smarts.types.episode_schema import TABLE
    rows = {name: [] for name in TABLE["names"].names}
    store = EpisodeStore(Path(sys.argv[1]))
    whole, half = store.begin("whole"), store.begin("half")
    for writer in (whole, half):
        writer.append("names", rows)
    whole.finish()
    os.kill(os.getpid(), signal.SIGKILL)
"""


def test_a_killed_process_leaves_whole_episodes_and_partials(tmp_path):
    process = subprocess.run([sys.executable, "-c", textwrap.dedent(KILLED), str(tmp_path)], check=False)
    assert process.returncode == -signal.SIGKILL
    assert [path.name for path in episodes_in(tmp_path)] == ["whole"]
    assert len(list(tmp_path.glob(f"{PARTIAL}*"))) == 1
    # Another that is still written to, by this process, stays.
    writer = EpisodeStore(tmp_path).begin("mine")
    assert list(tmp_path.glob(f"{PARTIAL}*")) == []
    writer.append("names", empty("names"))
    EpisodeStore(tmp_path)
    assert len(list(tmp_path.glob(f"{PARTIAL}*"))) == 1
    writer.finish()
    assert [path.name for path in episodes_in(tmp_path)] == ["mine", "whole"]


def test_every_table_is_described():
    for table in TABLES:
        assert len(set(table.names)) == len(table.names)
        assert all(column.meaning or column.unit for column in table.columns)
        assert arrow_schema(table).names == list(table.names)
