"""The one format of recorded episodes: which tables there are, and what each column means.

An episode is a folder with one Parquet file for each table. Metrics, viewer and replay read nothing else.

Indices. Row `step = k` of `vehicles`, `agents` and `signals` is the state after k steps; k = 0 is the reset.
Row `step = k` of `decisions` and `extras` is what was decided on that state, or followed from it until the
agent's next decision, such as its reward. A vehicle is (slot, generation); a lane or an edge is its number in
the map's lane graph, which is the file `maps/<map>.npz` beside the episodes.
"""

from __future__ import annotations

from dataclasses import dataclass

VERSION = 7
"""Number of the format of recorded episodes."""

TEXT, NUMBERS, INTEGERS = "text", "list<float32>", "list<int32>"
"""Kinds of columns beside those of numpy: strings, and lists of numbers of any length."""


@dataclass(frozen=True)
class Column:
    """One column of a table."""

    name: str
    kind: str
    """A numpy dtype, `TEXT`, `NUMBERS` or `INTEGERS`."""
    meaning: str
    unit: str = ""


@dataclass(frozen=True)
class Table:
    """One table of an episode."""

    name: str
    meaning: str
    columns: tuple[Column, ...]
    is_optional: bool = False
    """Whether an episode without rows has no file of the table."""

    @property
    def names(self) -> tuple[str, ...]:
        """The columns' names."""
        return tuple(column.name for column in self.columns)


def _table(name: str, meaning: str, *columns: Column, is_optional: bool = False) -> Table:
    return Table(name, meaning, columns, is_optional)


def _step(meaning: str = "the state is that after so many steps") -> Column:
    return Column("step", "int32", meaning)


AGENT_ID = Column("agent_id", "int16", "the agent's column; agents that come and go may have it in turn")
VEHICLE = (
    Column("slot", "int32", "with the generation, the vehicle"),
    Column("generation", "int32", "with the slot, the vehicle"),
)

EPISODE = _table(
    "episode",
    "one row: what was played, and how it went",
    Column("version", "int32", "of this format"),
    Column("program", TEXT, "version of the program that wrote it"),
    Column("scenario", TEXT, "with its variation, as in intersection@dense"),
    Column("traffic", TEXT, "variation of the traffic, empty without traffic"),
    Column("map", TEXT, "digest of the lane graph; the file is maps/<map>.npz"),
    Column("seed", "int64", "of the run"),
    Column("world", "int32", "number of the simulation in its run"),
    Column("episode", "int32", "number of the episode in its simulation"),
    Column("traffic_engine", TEXT, "name of the engine that drove the traffic, empty if not recorded"),
    Column("traffic_seed", "int64", "of the traffic engine"),
    Column("dt", "float64", "length of a step", "s"),
    Column("steps", "int32", "how many were made"),
    Column("is_complete", "bool", "whether the episode ran until no ego was active or waiting"),
    Column("is_invalid", "bool", "whether to discard it: an overlap at the start, or traffic failed"),
    Column("remark", TEXT, "why it is invalid or not complete"),
    Column("limit", "int32", "the most vehicles that the traffic engine may have at a time"),
    Column("most_vehicles", "int32", "the most at a time; at the limit, traffic was held back"),
    Column("traffic_overlaps", "int32", "pairs of traffic vehicles that came to overlap"),
)
AGENTS = _table(
    "agents",
    "a row for each agent of the episode, the egos first; its rows in other tables have its agent_id and "
    "steps from entry_step to end_step",
    Column("agent_id", "int16", "the agent's column; -1 for an agent of the pool that never had one"),
    Column("name", TEXT, "the agent's"),
    Column("interface", "int16", "number of its interface in the pool, -1 for egos"),
    *VEHICLE,
    Column("kind", "int8", "VehicleKind"),
    Column("length", "float32", "of the vehicle", "m"),
    Column("width", "float32", "of the vehicle", "m"),
    Column("entry_time", "float32", "when it was to enter", "s"),
    Column("entry_step", "int32", "when it entered, -1 if it never did"),
    Column("end_step", "int32", "its last step, -1 if it never entered"),
    Column("start_x", "float64", "of the start that was drawn", "m"),
    Column("start_y", "float64", "of the start that was drawn", "m"),
    Column("start_heading", "float32", "of the start that was drawn", "rad"),
    Column("start_speed", "float32", "of the start that was drawn", "m/s"),
    Column("action", "int8", "ActionSpaceType of its first decision, -1 without one"),
    Column("goal", "int8", "GoalKind"),
    Column("goal_x", "float64", "", "m"),
    Column("goal_y", "float64", "", "m"),
    Column("goal_radius", "float32", "", "m"),
    Column("goal_lane", "int32", "-1 without a goal on a lane"),
    Column("goal_s", "float32", "along the goal's lane", "m"),
    Column("laps", "int16", "to be driven"),
    Column("route", "int32", "number in routes, -1 without one"),
    Column("route_length", "float32", "from start to goal, 0 for endless missions", "m"),
    Column("free_flow_time", "float32", "that the route takes at the limits", "s"),
    Column("outcome", "int8", "Outcome, NONE if the recording ended before"),
    Column("terminated", "bool", "the episode terminated (no bootstrapping)"),
    Column("truncated", "bool", "ended although it could have gone on"),
    Column("remaining", "float32", "left of the route at the end", "m"),
    Column("distance_travelled", "float32", "driven in all", "m"),
    Column("partner_slot", "int32", "vehicle that it collided with when it ended, -1 for none"),
    Column("partner_generation", "int32", "of that vehicle"),
    Column("partner", TEXT, "public name of that vehicle"),
    Column("partner_owner", "int8", "Owner of that vehicle"),
    Column("partner_agent_id", "int16", "agent that drove it at end_step, -1 for none"),
    Column("side", "int8", "where it was hit: 0 front, 1 left, 2 rear, 3 right"),
    Column("closing_speed", "float32", "at the collision", "m/s"),
    Column("substep", "int8", "of the collision"),
)
VEHICLES = _table(
    "vehicles",
    "a row for each step and each vehicle near an agent that drives or has just ended, and for a while after",
    _step(),
    *VEHICLE,
    Column("owner", "int8", "Owner of the vehicle"),
    Column("kind", "int8", "VehicleKind"),
    Column("x", "float64", "of the centre", "m"),
    Column("y", "float64", "of the centre", "m"),
    Column("heading", "float32", "counter-clockwise from +x", "rad"),
    Column("speed", "float32", "along the heading", "m/s"),
    Column("lateral_speed", "float32", "positive to the left", "m/s"),
    Column("acceleration", "float32", "along the heading", "m/s^2"),
    Column("lateral_acceleration", "float32", "positive to the left", "m/s^2"),
    Column("yaw_rate", "float32", "counter-clockwise", "rad/s"),
    Column("length", "float32", "of the footprint", "m"),
    Column("width", "float32", "of the footprint", "m"),
    Column("lane", "int32", "-1 where none was found"),
    Column("s", "float32", "of the centre along the lane", "m"),
    Column("t", "float32", "of the centre from the lane's middle, positive to the left", "m"),
    Column("route", "int32", "number in routes of the path that it plans, -1 where unknown"),
    Column("desired_speed", "float32", "on a free road", "m/s"),
)
NAMES = _table(
    "names",
    "a row for each recorded vehicle",
    *VEHICLE,
    Column("name", TEXT, "public name"),
    Column("first_step", "int32", "of the record"),
    Column("kind", "int8", "VehicleKind"),
    Column("length", "float32", "of the footprint", "m"),
    Column("width", "float32", "of the footprint", "m"),
)
ROUTES = _table(
    "routes",
    "a row for each planned route",
    Column("route", "int32", "number of the route"),
    Column("edges", INTEGERS, "numbers of its edges, in order"),
)
AGENT_STATES = _table(
    "agent_states",
    "a row for each step and each agent that has a vehicle, the step that ended it included, and those after "
    "it in which its vehicle waits to go back to traffic",
    _step(),
    AGENT_ID,
    Column("state", "int8", "AgentStatus"),
    *VEHICLE,
    Column("events", "int32", "Event bits of this step"),
    Column("partner_slot", "int32", "first vehicle touched in this step, -1 for none"),
    Column("partner_generation", "int32", "of that vehicle"),
    Column("throttle", "float32", "0 to 1"),
    Column("brake", "float32", "0 to 1"),
    Column("steering", "float32", "of the front wheels, positive to the left", "rad"),
    Column("route_progress", "float32", "along the route", "m"),
    Column("remaining", "float32", "to the goal along the route", "m"),
    Column("distance_travelled", "float32", "since entry", "m"),
    Column("lap", "int16", "laps completed"),
    Column("target_lane", "int32", "that it steers for, -1 for none"),
    Column("change_phase", "int8", "ChangePhase"),
    Column("action_mask", "int8", "bit i: lane action i may be chosen next"),
    Column("arrival_number", "int32", "place in the order of arrival at the junction ahead, -1 for none"),
    Column("release_step", "int32", "step since which its vehicle is to go back, -1 if it is not"),
)
DECISIONS = _table(
    "decisions",
    "a row for each action that an agent gave",
    _step("the state on which it was decided"),
    AGENT_ID,
    Column("action", "int8", "ActionSpaceType"),
    *(Column(f"value_{number}", "float32", "of the action, as carried out") for number in range(8)),
    Column("action_mask", "int8", "bit i: lane action i was legal"),
    Column("is_effective", "bool", "whether its lane command was carried out"),
)
SIGNALS = _table(
    "signals",
    "a row for each change of a light; lights not mentioned show nothing",
    _step(),
    Column("lane", "int32", "into the junction"),
    Column("signal", "int8", "Signal"),
)
EXTRAS = _table(
    "extras",
    "whatever the algorithm has to say about its decisions: probabilities, means, values, rewards",
    _step("the state on which the decision was made"),
    AGENT_ID,
    Column("name", TEXT, "what it is"),
    Column("values", NUMBERS, "the numbers"),
)
OBSERVATIONS = _table(
    "observations",
    "a row for each thing that an agent of `record_observations` observed as it decided; positions are "
    "relative to the map's lower left corner in whole metres",
    _step("the state that was observed"),
    AGENT_ID,
    Column("name", TEXT, "waypoints, neighbors, lidar, grid:*, rgb:top_down, or a field of the observation"),
    Column("values", NUMBERS, "the numbers, as docs/guide/envision.md says"),
    is_optional=True,
)
HOLDS = _table(
    "holds",
    "a row for each time that an agent has had a vehicle, in the order in which they began",
    Column("agent", "int32", "row of the agent in agents"),
    AGENT_ID,
    Column("name", TEXT, "the agent's"),
    Column("policy", TEXT, "name of the social policy that acted for it, empty for egos"),
    Column("interface", "int16", "number of its interface in the pool, -1 for egos"),
    Column("first_step", "int32", "in which it had the vehicle"),
    Column("last_step", "int32", "in which it had the vehicle, after its end, too"),
    *VEHICLE,
    Column("began", "int8", "Reason of the transfer that brought it, -1: it came with the agent"),
    Column("ended", "int8", "Reason of the transfer that took it, -1: it was gone, or the end"),
    is_optional=True,
)
TRANSFERS = _table(
    "transfers",
    "a row for each vehicle that changed hands at the beginning of a step",
    _step("the first state after it"),
    *VEHICLE,
    Column("name", TEXT, "public name of the vehicle"),
    Column("from_owner", "int8", "Owner"),
    Column("to_owner", "int8", "Owner"),
    Column("from_agent", "int32", "row in agents of the agent that had it, -1 for none"),
    Column("to_agent", "int32", "row in agents of the agent that got it, -1 for none"),
    Column("reason", "int8", "Reason"),
    Column("refusals", "int32", "steps in which it was refused before"),
    Column("last_refusal", "int8", "Refusal of the last of them, 0 for none"),
    Column("departure", "int8", "Departure: why the vehicle left the simulation, 0 if it did not"),
    is_optional=True,
)
BUBBLES = _table(
    "bubbles",
    "a row for each bubble of the scenario",
    Column("bubble", "int16", "number of the bubble"),
    Column("id", TEXT, "of the bubble"),
    Column("actor", TEXT, "name of the actor that drives its vehicles"),
    Column("followed", TEXT, "name of the vehicle or agent with which it travels, empty if it stays"),
    Column("taken", "int32", "how often an agent began to drive a vehicle"),
    Column("at_limit", "int32", "vehicles that a limit refused, once for each time in the margin"),
    Column("without_column", "int32", "vehicles that found all columns of the agents held"),
    Column("not_drivable", "int32", "vehicles of a kind that agents cannot drive, counted as at_limit"),
    Column("collided", "int32", "vehicles that have collided while an agent held them"),
    Column("never_appeared", "int32", "names it looks for that never appeared"),
    is_optional=True,
)
BUBBLE_RINGS = _table(
    "bubble_rings",
    "a row for each closed line of an outline; a point is inside if it is inside an odd number of them",
    Column("bubble", "int16", "number of the bubble"),
    Column("is_margin", "bool", "of the zone with its margin, in which agents observe; else of the zone"),
    Column("x", NUMBERS, "of the corners; of a bubble that travels, before it follows", "m"),
    Column("y", NUMBERS, "of the corners", "m"),
    is_optional=True,
)
BUBBLE_POSES = _table(
    "bubble_poses",
    "a row for each bubble at the reset, and for each change: its rings are turned by angle about (0, 0), "
    "then moved by (x, y)",
    _step(),
    Column("bubble", "int16", "number of the bubble"),
    Column("x", "float64", "", "m"),
    Column("y", "float64", "", "m"),
    Column("angle", "float64", "counter-clockwise", "rad"),
    Column("is_active", "bool", "whether it takes vehicles"),
    is_optional=True,
)
AGENT_FAILURES = _table(
    "agent_failures",
    "a row for each social agent whose policy failed; the fallback controller drove from then on",
    _step("the first state after it"),
    Column("agent", "int32", "row of the agent in agents"),
    Column("text", TEXT, "what failed"),
    is_optional=True,
)

TABLES = (
    *(EPISODE, AGENTS, VEHICLES, NAMES, ROUTES, AGENT_STATES, DECISIONS, SIGNALS, EXTRAS),
    *(HOLDS, TRANSFERS, BUBBLES, BUBBLE_RINGS, BUBBLE_POSES, AGENT_FAILURES),
    OBSERVATIONS,
)
TABLE = {table.name: table for table in TABLES}
