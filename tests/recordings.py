"""Hand-made recorded episodes: vehicles move along lanes as specified, in the recorder's format."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from benchmark.metrics.episode_data import EpisodeData
from smarts.roads.lane_graph import ConflictKind, LaneGraph
from smarts.sim.episode_files import EpisodeStore, RecordedEpisode
from smarts.types.actions import ActionSpaceType
from smarts.types.agent_states import AgentStatus
from smarts.types.episode_schema import TABLE, VERSION
from smarts.types.events import Outcome
from smarts.types.vehicles import Owner
from tests.maps import Road, crossing, graph_of, straight

DT = 0.1
LENGTH, WIDTH = 4.0, 1.8
CAR = dict(owner=int(Owner.TRAFFIC), kind=0, length=LENGTH, width=WIDTH)


@dataclass
class Drive:
    """A vehicle's motion along consecutive lanes."""

    lanes: Sequence[str]
    """Ids of the lanes; s counts from the beginning of the first one."""
    s: ArrayLike
    """Arc length at each instant [m]."""
    t: ArrayLike = 0.0
    """Offset to the left of the lane's centreline [m]."""
    agent: str = ""
    """Name of the vehicle's agent, "" for traffic."""
    outcome: Outcome = Outcome.NONE
    partner: int = -1
    """Number of the drive with which the vehicle collided."""
    kind: int = 0
    route: Sequence[str] = ()
    desired_speed: float = 10.0
    acceleration: ArrayLike | None = None
    """Acceleration [m/s^2], by default the change of speed."""
    lateral_acceleration: ArrayLike = 0.0
    actions: Sequence[tuple[int, int]] = ()
    """Step and lane action of each decision."""
    extras: Sequence[tuple[int, str, Sequence[float]]] = ()
    free_flow_time: float = 5.0
    action_mask: int = 15
    goal_lane: str = ""
    begin: int = 0
    """First instant."""
    remaining: float = 0.0
    is_oncoming: bool = False
    """Whether the vehicle faces against its lanes; it drives forwards where s decreases."""
    decisions: Sequence[dict[str, Any]] = ()
    """Further rows of `decisions`."""
    columns: dict[str, Any] = field(default_factory=dict)
    """Further columns of the agent's row in `agents`."""
    agents: dict[str, ArrayLike] = field(default_factory=dict)
    """Further columns of the agent's rows in `agent_states`: a number for each instant or one for all."""


def at_speed(speed: float, steps: int, begin: float = 0.0) -> np.ndarray:
    """Return s at each of `steps` + 1 instants [m]."""
    return begin + speed * DT * np.arange(steps + 1)


def at_speeds(speeds: Sequence[float], begin: float = 0.0) -> np.ndarray:
    """Return s at each instant [m] from the speeds of the steps [m/s]."""
    return begin + np.concatenate(([0.0], np.cumsum(np.asarray(speeds, float) * DT)))


def record(
    folder: Path,
    graph: LaneGraph,
    drives: Sequence[Drive],
    name: str = "episode",
    tables: Mapping[str, Sequence[dict[str, Any]]] | None = None,
    **facts: Any,
) -> Path:
    """Write an episode, with rows of further tables; return its folder."""
    store = EpisodeStore(folder)
    steps = max(drive.begin + len(np.asarray(drive.s)) for drive in drives) - 1
    rows: dict[str, list[dict[str, Any]]] = {table: [*(tables or {}).get(table, ())] for table in TABLE}
    rows["episode"] = [
        {
            **dict(version=VERSION, program="", scenario="hand_made", traffic="", map=store.map(graph)),
            **dict(seed=1, world=0, episode=0, traffic_engine="SUMO", traffic_seed=0, dt=DT, steps=steps),
            **dict(is_complete=True, is_invalid=False, remark="", limit=0, most_vehicles=0),
            "traffic_overlaps": 0,
            **facts,
        }
    ]
    agent_id = 0
    for slot, drive in enumerate(drives):
        number = -1
        if drive.route:
            number = len(rows["routes"])
            edges = [graph.edge_number(edge) for edge in drive.route]
            rows["routes"].append({"route": number, "edges": edges})
        motion = _motion(graph, drive)
        for k, row in enumerate(motion):
            row |= dict(step=drive.begin + k, slot=slot, generation=1, route=number, **CAR)
            row["kind"] = drive.kind
            row["owner"] = int(Owner.AGENT if drive.agent else Owner.TRAFFIC)
            rows["vehicles"].append(row)
        if drive.agent:
            _write_agent(rows, graph, drive, slot, agent_id)
            agent_id += 1
    writer = store.begin(name)
    for table, each in rows.items():
        columns = TABLE[table].columns
        writer.append(table, {column.name: [row.get(column.name, 0) for row in each] for column in columns})
    return writer.finish()


def episode_of(folder: Path, graph: LaneGraph, *drives: Drive, **facts: Any) -> EpisodeData:
    """Return an episode for metrics."""
    return EpisodeData(RecordedEpisode(record(folder, graph, drives, **facts)))


def _motion(graph: LaneGraph, drive: Drive) -> list[dict[str, Any]]:
    lanes = [graph.lane_of_id(name) for name in drive.lanes]
    ends = np.cumsum(graph.length[lanes])
    stations = np.asarray(drive.s, float)
    offsets = np.broadcast_to(np.asarray(drive.t, float), stations.shape)
    # The speed at an instant is that of the step before it.
    speeds = np.diff(stations, prepend=2 * stations[0] - stations[1]) / DT * (-1 if drive.is_oncoming else 1)
    changes = np.diff(speeds, prepend=speeds[0]) / DT
    if drive.acceleration is not None:
        changes = np.broadcast_to(np.asarray(drive.acceleration, float), stations.shape)
    sideways = np.broadcast_to(np.asarray(drive.lateral_acceleration, float), stations.shape)
    rows = []
    for s, t, speed, change, aside in zip(stations, offsets, speeds, changes, sideways, strict=True):
        place = min(int(np.searchsorted(ends, s, side="right")), len(lanes) - 1)
        on, along = lanes[place], float(s - (ends[place] - graph.length[lanes[place]]))
        on, across = _beside(graph, on, float(t))
        x, y, heading = graph.pose_at(on, along, across)
        heading += math.pi if drive.is_oncoming else 0.0
        row = dict(x=x, y=y, heading=heading, speed=speed, acceleration=change, lane=on, s=along, t=across)
        rows.append(row | dict(desired_speed=drive.desired_speed, lateral_acceleration=aside))
    return rows


def _beside(graph: LaneGraph, lane: int, t: float) -> tuple[int, float]:
    """Return the lane and the offset of a point at offset `t` to the left of a lane's centreline."""
    while t > graph.width[lane] / 2 and graph.left[lane] >= 0:
        t -= (graph.width[lane] + graph.width[graph.left[lane]]) / 2
        lane = int(graph.left[lane])
    return lane, t


def _write_agent(rows: dict[str, list], graph: LaneGraph, drive: Drive, slot: int, agent_id: int) -> None:
    last = drive.begin + len(np.asarray(drive.s)) - 1
    agents = {name: np.broadcast_to(column, np.shape(drive.s)) for name, column in drive.agents.items()}
    for k, s in enumerate(np.asarray(drive.s).tolist()):
        state = AgentStatus.DONE if k == len(np.asarray(drive.s)) - 1 else AgentStatus.ACTIVE
        rows["agent_states"].append(
            {
                **dict(step=drive.begin + k, agent_id=agent_id, state=int(state), slot=slot, generation=1),
                **dict(partner_slot=-1, target_lane=-1, arrival_number=-1, release_step=-1),
                **dict(
                    action_mask=drive.action_mask,
                    route_progress=s - np.asarray(drive.s)[0],
                    distance_travelled=abs(s - np.asarray(drive.s)[0]),
                ),
                **{name: column[k] for name, column in agents.items()},
            }
        )
    taken = {"action": int(ActionSpaceType.Lane), "is_effective": True}
    decisions = [{"step": step, "value_0": action, **taken} for step, action in drive.actions]
    own = {"agent_id": agent_id, "action_mask": drive.action_mask}
    rows["decisions"] += [own | row for row in (*decisions, *drive.decisions)]
    for step, name, values in drive.extras:
        rows["extras"].append(dict(step=step, agent_id=agent_id, name=name, values=list(values)))
    x, y, heading = graph.pose_at(graph.lane_of_id(drive.lanes[0]), float(np.asarray(drive.s)[0]))
    rows["agents"].append(
        {
            **dict(agent_id=agent_id, name=drive.agent, slot=slot, generation=1, length=LENGTH, width=WIDTH),
            **dict(entry_step=drive.begin, end_step=last, outcome=int(drive.outcome), partner=""),
            **dict(partner_slot=drive.partner, partner_generation=1, partner_agent_id=-1, interface=-1),
            **dict(start_x=x, start_y=y, start_heading=heading, start_speed=0.0, route=-1),
            **dict(goal_lane=graph.lane_of_id(drive.goal_lane) if drive.goal_lane else -1),
            **dict(route_length=100.0, free_flow_time=drive.free_flow_time, remaining=drive.remaining),
            **dict(distance_travelled=float(abs(np.asarray(drive.s)[-1] - np.asarray(drive.s)[0]))),
            **drive.columns,
        }
    )


def with_conflict(graph: LaneGraph, first: str, second: str, kind: ConflictKind) -> LaneGraph:
    """Return a map whose two junction lanes conflict, in both directions."""
    pair = graph.lane_of_id(first), graph.lane_of_id(second)
    count = np.zeros(len(graph.lane_ids) + 1, np.int32)
    for lane in pair:
        count[lane + 1 :] += 1
    low, high = sorted(pair)
    whole = [[0.0, graph.length[lane]] for lane in (low, high)]
    return replace(
        graph,
        conflict_start=count,
        conflict_lane=np.array([high, low], np.int32),
        conflict_kind=np.full(2, int(kind), np.int8),
        conflict_yields=np.zeros(2, np.int8),
        conflict_extent=np.array(whole),
        conflict_other_extent=np.array(whole[::-1]),
    )


def crossroads() -> LaneGraph:
    """Return `tests.maps.crossing` with a conflict of the lanes west-east and south-north at (1.6, -1.6).

    Approaches are 80 m long and the lanes in the junction 20 m; these cross after 11.6 m and 8.4 m.
    """
    graph = crossing()
    return with_conflict(
        graph, way(graph, "west_in", "east_out"), way(graph, "south_in", "north_out"), ConflictKind.CROSS
    )


def way(graph: LaneGraph, begin: str, end: str) -> str:
    """Return the id of the junction lane between two roads of one lane."""
    target = graph.lane_number(end, 0)
    for lane in graph.successors(graph.lane_number(begin, 0)).tolist():
        if target in graph.successors(lane):
            return graph.lane_ids[lane]
    raise ValueError(f"no way from {begin} to {end}")


def across(graph: LaneGraph, begin: str, end: str) -> list[str]:
    """Return the lanes from one road to another."""
    return [f"{begin}_0", way(graph, begin, end), f"{end}_0"]


def lane_drop() -> LaneGraph:
    """Return a road "before" of two lanes, 100 m long, of which only the left lane leads to "after"."""
    roads = {
        "before": Road([(0.0, 0.0), (100.0, 0.0)], 2),
        "after": Road([(110.0, 3.2), (200.0, 3.2)], 1),
    }
    return graph_of(roads, [(("before", 1), ("after", 0))])


__all__ = [
    "DT", "LENGTH", "WIDTH", "Drive", "across", "at_speed", "at_speeds", "crossroads", "episode_of",
    "lane_drop", "math", "record", "straight", "way", "with_conflict",
]  # fmt: skip
