"""Demonstrations: what the vehicles of a traffic would have observed as agents, and how they acted.

A file of single-agent episodes with RLlib's columns, a row for each decision (`ray.rllib.core.columns`).
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from smarts.controllers import action_space
from smarts.controllers.inverse import Inverse, Motion, inverse_of
from smarts.env.traffic_agents import TrafficAgents
from smarts.errors import ScenarioError
from smarts.observations.action_mask import MASK
from smarts.observations.lists import Observed
from smarts.recordings.log import Log
from smarts.recordings.tracks import read_tracks
from smarts.sstudio.build import build_scenario
from smarts.sstudio.built import BuiltScenario
from smarts.types.actions import ActionSpaceType
from smarts.whole_files import written_whole

ABOUT = "smarts_demonstrations"
"""Key of the file's metadata: JSON of what was acted, how, and where the data come from."""


MOTION = ("position", "heading", "speed")
_Seen = dict[str, NDArray]
"""The vehicles that decide at a time: hold, name, position, heading, speed, lane, obs, action_mask."""


def demonstrate(
    scenario: str | Path,
    out: Path,
    *,
    traffic: str | None = None,
    observation: Observed = ("car_following",),
    action: str = "Direct",
    decision_interval: int = 5,
    episodes: int = 1,
    seconds: float | None = None,
    seed: int = 42,
) -> list[str]:
    """Write what a traffic's vehicles would have observed, and the actions that explain their motion.

    Args:
        scenario: Folder, or name of the suite.
        out: The Parquet file.
        traffic: Variation of its traffic, by default the last.
        observation: What they observe.
        action: Name of an `ActionSpaceType` whose controller has an inverse.
        decision_interval: Steps from one decision to the next.
        episodes: How many episodes of the traffic.
        seconds: Length of each [s], by default to a recording's end, else 60 s.
        seed: Seed of the run.

    Returns:
        The report, by line.

    Raises:
        SmartsError: The scenario, its traffic, the observation or the action does not fit.
    """
    explain = inverse_of(action)
    built, kind = build_scenario(scenario), ActionSpaceType[action]
    traffic = next(reversed(built.traffic), None) if traffic is None else traffic
    if traffic is None:
        raise ScenarioError("has no traffic", place=built.name, remedy="give a scenario with traffic")
    agents = TrafficAgents(built, traffic, observation, kind, decision_interval=decision_interval, seed=seed)
    try:
        runs = (_transitions(agents, explain, seconds, episode) for episode in range(episodes))
        parts = [part for run in runs for part in run]
    finally:
        agents.close()
    if not parts:
        problem = "no vehicle was there for two decisions"
        raise ScenarioError(problem, place=f"{built.name}, {traffic}", remedy="give more seconds")
    columns = _in_order({name: np.concatenate([part[name] for part in parts]) for name in parts[0]})
    residual = columns.pop("residual")
    facts = _facts(built, traffic)
    said = {
        "scenario": built.name,
        "traffic": traffic,
        "observation": observation if isinstance(observation, str | list | tuple | dict) else None,
        "action": action,
        "action_space": str(action_space(kind)),
        "decision_interval": decision_interval,
        "median_residual": float(np.median(residual)),
        **facts,
    }
    with written_whole(out) as partial:
        pq.write_table(_table(columns, said), partial)
    return [
        f"{built.name}, {traffic}: {len(residual)} decisions of {len(set(columns['eps_id']))} vehicles",
        f"actions {action}, which end {np.median(residual):.2f} m from where the vehicles were (median; "
        f"95%: within {np.quantile(residual, 0.95):.2f} m, at most {residual.max():.2f} m)",
        f"licence: {facts['licence'] or 'none named'}",
    ]


def about(file: str | Path) -> dict[str, Any]:
    """Return what a file says of its demonstrations; nothing where another program has written it."""
    return json.loads((pq.read_schema(file).metadata or {}).get(ABOUT.encode(), b"{}"))


def _transitions(
    agents: TrafficAgents, explain: Inverse, seconds: float | None, episode: int
) -> Iterator[dict[str, NDArray]]:
    """Yield the columns of the decisions in an episode, those of each time together."""
    recording, time = agents.reset(episode).traffic.recording, agents.interval * agents.world.dt
    length = 60.0 if seconds is None else seconds
    if recording is not None:  # behind its end vehicles drive by a model
        left = float(Log.load(recording.log).paths.end.max()) - recording.begin
        length = left if seconds is None else min(seconds, left)
    last = _see(agents)
    for number in range(int(length / time + 1e-6)):
        agents.step()
        now = _see(agents)
        _, before, after = np.intersect1d(last["hold"], now["hold"], return_indices=True)
        if len(before):
            begun = {name: column[before] for name, column in last.items()}
            ended = {name: column[after] for name, column in now.items()}
            yield _columns(agents, explain, begun, ended, episode, number)
        last = now


def _see(agents: TrafficAgents) -> _Seen:
    decision, vehicles = agents.decide(), agents.vehicles
    seen = {name: array for name, array in decision.observations.items() if name != MASK}
    flat = [array.reshape(len(array), int(np.prod(array.shape[1:]))) for array in seen.values()]
    found = {name: getattr(vehicles, name)[decision.slot] for name in (*MOTION, "lane")}
    return found | {
        "hold": decision.hold,
        "name": np.array([agents.name(slot) for slot in decision.slot.tolist()], object),
        "obs": np.concatenate(flat, axis=1, dtype=np.float32),
        "action_mask": decision.action_mask,
    }


def _columns(
    agents: TrafficAgents, explain: Inverse, last: _Seen, now: _Seen, episode: int, number: int
) -> dict[str, NDArray]:
    """Return the columns of N vehicles between two decisions."""
    roads, lane, count = agents.roads, np.maximum(last["lane"], 0), len(last["name"])
    side = (now["lane"] == roads.left[lane]) * 1 - (now["lane"] == roads.right[lane])
    is_known = (last["lane"] >= 0) & (now["lane"] >= 0)
    motion = Motion(
        *(np.stack([last[name], now[name]]) for name in MOTION),
        side=np.where(is_known, side, 0),
        limit=roads.speed_limit[lane],
        action_mask=last["action_mask"],
        time=agents.interval * agents.world.dt,
    )
    actions, residual = explain(motion)
    return {
        "eps_id": np.array([f"{episode}/{hold}" for hold in last["hold"].tolist()], object),
        "agent_id": last["name"],
        "t": np.full(count, number),
        "obs": last["obs"],
        "new_obs": now["obs"],
        "actions": actions.astype(np.int64 if actions.ndim == 1 else np.float32),
        "rewards": np.zeros(count, np.float32),
        "action_mask": last["action_mask"],
        "residual": residual,
    }


def _in_order(columns: dict[str, NDArray]) -> dict[str, NDArray]:
    """Return the rows vehicle by vehicle, the last of each marked as cut off."""
    _, episode = np.unique(columns["eps_id"].astype(str), return_inverse=True)
    order = np.lexsort((columns["t"], episode))
    episode, columns = episode[order], {name: column[order] for name, column in columns.items()}
    is_last = np.append(episode[1:] != episode[:-1], True)
    return columns | {"terminateds": np.zeros(len(order), np.bool_), "truncateds": is_last}


def _table(columns: dict[str, NDArray], said: dict[str, Any]) -> pa.Table:
    arrays = {
        name: pa.array(column if column.ndim == 1 else list(column)) for name, column in columns.items()
    }
    return pa.table(arrays).replace_schema_metadata({ABOUT: json.dumps(said)})


def _facts(built: BuiltScenario, traffic: str) -> dict[str, str]:
    """Return where the data come from, and their licence; nothing is known of simulated traffic's."""
    recording = (built.scenario.traffic or {})[traffic].recording
    if recording is None or recording.history is not None:
        return {"licence": "", "attribution": ""}
    facts = read_tracks(built.source / recording.source).facts
    return {name: facts.get(name, "") for name in ("name", "licence", "attribution")}
