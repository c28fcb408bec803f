"""Encounters: two vehicles whose planned paths contend for a place at about the same time.

An encounter opens when both are faster than 1 m/s, neither has reached the section, and their predicted
arrivals at present speeds, at most 10 s ahead, lie within 3 s of each other. Where paths cross or merge in a
junction the section comes from the map's conflicting lanes; where two lanes lead into the same lane it is the
begin of that lane; where one has to change lanes into the other's it is the road on which they are side by
side. On such a road the first to be ahead when neither has to cross the other any more went first.

The one whose predicted arrival is earlier is predicted first; on a shared road, of arrivals at the place of
the one ahead when the order is settled, from the speeds of the opening. Where the other one enters first, the
order is inverted: by courtesy if the predicted first lost at least as much time, against its prediction, as
the other gained; else because the other one pushed in.
"""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmark.metrics.episode_data import EpisodeData, Lanes, Paths, VehicleTracks
from benchmark.metrics.lane_paths import CHANGE, MERGE, Conflict
from benchmark.metrics.leaders import distance_ahead
from smarts.geometry.compiling import kernel
from smarts.types.events import Outcome

Ints = NDArray[np.int32]
Floats = NDArray[np.float64]

MAX_ARRIVAL_GAP = 3.0
"""Largest difference of the predicted arrivals [s]."""
PREDICTION_HORIZON = 10.0
"""Within which both arrive, as predicted [s]."""
MIN_SPEED = 1.0
"""Speed that both have at least when an encounter opens [m/s]."""
LEAST_LEAD, MOST_LEAD = 0.2, 3.0
"""Between the predicted arrivals, for one of the two to be predicted first [s]."""
ENCOUNTER_TIMEOUT = 15.0
"""Time from the opening within which one enters, and from then until the one that enters second has left the
section [s]."""

UNRESOLVED, SECOND, FIRST, COLLIDED, WAITING = range(5)
"""How an encounter ends for the agent: neither entered; the other entered first, and the agent left the
section in time; the agent entered first; they collided; the other entered first, and the agent was late."""

_KIND, _BEGIN, _END, _OTHER_BEGIN, _OTHER_END, _NAME = range(6)
_AGENT, _OTHER, _STEP, _LEAD, _RESULT, _COURTESY, _GAP_TIME, _BRAKING, _COLUMNS = range(9)


class Ways(NamedTuple):
    """Where the vehicles of an episode may go."""

    paths: Paths
    lanes: Lanes
    sections: Floats
    """A row for each `Conflict`, its fields in order."""
    table: Ints
    """Row of `sections` for each two of `paths` that meet, -1 for none, shape (P, P)."""


class Encounters(NamedTuple):
    """A row for each encounter of each agent; two agents that meet have one each."""

    agent: Ints
    other: Ints
    """Column of the other vehicle."""
    step: Ints
    """When it opened."""
    lead: Floats
    """How much earlier the agent arrives than the other, predicted at the opening [s]."""
    result: Ints
    is_courtesy: NDArray[np.bool_]
    """If the order was inverted: whether the predicted first lost at least the time that the other gained."""
    gap_time: Floats
    """Post-encroachment time [s]: from when the first has left until the second arrives; 0 after a collision,
    NaN where one of them never arrived."""
    braking: Floats
    """The other's largest deceleration until it arrives [m/s^2]."""

    @property
    def is_predicted_first(self) -> NDArray[np.bool_]:
        """Whether the agent was predicted first; never of both of two agents that meet."""
        return (self.lead >= LEAST_LEAD) & (self.lead <= MOST_LEAD)

    @property
    def is_predicted_second(self) -> NDArray[np.bool_]:
        """Whether the other one was predicted first."""
        return (self.lead <= -LEAST_LEAD) & (self.lead >= -MOST_LEAD)


def find_encounters(episode: EpisodeData) -> Encounters:
    """Return all encounters of all agents."""
    motion = episode.motion
    sections, table = _sections(episode)
    rows: list[Floats] = []
    for agent in np.flatnonzero(episode.own >= 0).tolist():
        own = int(episode.own[agent])
        is_collision = episode.agents["outcome"][agent] == Outcome.COLLISION
        partner = int(episode.partner[agent]) if is_collision else -1
        end = int(episode.agents["end_step"][agent])
        for other in range(len(motion.length)):
            if other != own and _may_meet(table, motion, own, other):
                driving = episode.driving[:, agent]
                found = _meet(
                    motion,
                    Ways(episode.paths, episode.lanes, sections, table),
                    own,
                    other,
                    driving,
                    partner == other,
                    end,
                    episode.dt,
                )
                found[:, _AGENT] = agent
                rows.append(found)
    found = np.concatenate(rows) if rows else np.zeros((0, _COLUMNS))
    return Encounters(
        agent=found[:, _AGENT].astype(np.int32),
        other=found[:, _OTHER].astype(np.int32),
        step=found[:, _STEP].astype(np.int32),
        lead=found[:, _LEAD],
        result=found[:, _RESULT].astype(np.int32),
        is_courtesy=found[:, _COURTESY] > 0,
        gap_time=found[:, _GAP_TIME],
        braking=found[:, _BRAKING],
    )


def _sections(episode: EpisodeData) -> tuple[Floats, Ints]:
    """Return the sections of this episode as rows, and the row for each two paths that meet, -1 for none."""
    motion, numbers = episode.motion, episode.book_numbers
    table = np.full((len(numbers), len(numbers)), -1, np.int32)
    rows: list[Conflict] = []
    for own in episode.own[episode.own >= 0].tolist():
        both = (motion.path[:, own, None] >= 0) & (motion.path >= 0)
        codes = motion.path[:, own, None].astype(np.int64) * len(numbers) + motion.path
        for code in np.unique(codes[both]).tolist():
            path, other = divmod(code, len(numbers))
            section = episode.book.section(numbers[path], numbers[other])
            if section is not None and table[path, other] < 0:
                table[path, other] = len(rows)
                rows.append(section)
    return np.array([dataclasses.astuple(row) for row in rows], float).reshape(-1, 6), table


@kernel
def _may_meet(table: Ints, motion: VehicleTracks, own: int, other: int) -> bool:
    for k in range(len(motion.path)):
        path, path2 = motion.path[k, own], motion.path[k, other]
        if path >= 0 and path2 >= 0 and table[path, path2] >= 0:
            return True
    return False


@kernel
def _meet(
    motion: VehicleTracks,
    ways: Ways,
    own: int,
    other: int,
    driving: NDArray[np.bool_],
    collided: bool,
    end: int,
    dt: float,
) -> Floats:
    """Return the encounters of an agent's vehicle with another one, in the order in which they opened."""
    sections, table = ways.sections, ways.table
    found = np.zeros((16, _COLUMNS))
    count, k, last = 0, 0, np.inf
    while k < len(motion.path) and count < len(found):
        row = _section_at(motion, table, own, other, k)
        if (
            row >= 0
            and driving[k]
            and sections[row][_NAME] != last
            and _opens(motion, sections[row], own, other, k)
        ):
            last = sections[row][_NAME]
            into = found[count]
            into[_OTHER], into[_STEP] = other, k
            ahead, ahead2 = _ahead(motion, sections[row], own, other, k)
            into[_LEAD] = ahead2 / motion.speed[k, other] - ahead / motion.speed[k, own]
            k = _follow(motion, ways, own, other, k, row, collided, end, dt, into)
            count += 1
        k += 1
    return found[:count]


@kernel
def _section_at(motion: VehicleTracks, table: Ints, own: int, other: int, k: int) -> int:
    if not (motion.present[k, own] and motion.present[k, other]):
        return -1
    path, path2 = motion.path[k, own], motion.path[k, other]
    return int(table[path, path2]) if path >= 0 and path2 >= 0 else -1


@kernel
def _ahead(motion: VehicleTracks, section: Floats, own: int, other: int, k: int) -> tuple[float, float]:
    """Return how far the two have to go to where they contend [m], below 0 if they are there."""
    s, s2 = motion.s[k, own] - section[_BEGIN], motion.s[k, other] - section[_OTHER_BEGIN]
    if int(section[_KIND]) != CHANGE:
        return -s - motion.length[own] / 2, -s2 - motion.length[other] / 2
    place = max(0.0, s, s2)
    return place - s, place - s2


@kernel
def _opens(motion: VehicleTracks, section: Floats, own: int, other: int, k: int) -> bool:
    ahead, ahead2 = _ahead(motion, section, own, other, k)
    speed, speed2 = motion.speed[k, own], motion.speed[k, other]
    if speed <= MIN_SPEED or speed2 <= MIN_SPEED:
        return False
    if int(section[_KIND]) != CHANGE and (ahead <= 0.0 or ahead2 <= 0.0):
        return False
    time, time2 = ahead / speed, ahead2 / speed2
    return abs(time - time2) <= MAX_ARRIVAL_GAP and max(time, time2) <= PREDICTION_HORIZON


@kernel
def _follow(
    motion: VehicleTracks,
    ways: Ways,
    own: int,
    other: int,
    opened: int,
    row: int,
    collided: bool,
    end: int,
    dt: float,
    into: Floats,
) -> int:
    """Write the course of an encounter; return its last instant.

    Marks on the odometers say where each arrives and has left. They are updated as long as the section is
    ahead of both, and then hold: a vehicle's path knows nothing of what lies behind it.
    """
    sections, table = ways.sections, ways.table
    section = sections[row]
    is_change = int(section[_KIND]) == CHANGE
    is_settled = not is_change
    arrive, arrive2, leave, leave2 = np.inf, np.inf, np.inf, np.inf
    came, came2, left, left2 = -1.0, -1.0, -1.0, -1.0
    place, place2, settled, ahead_by = 0.0, 0.0, -1.0, 0.0
    timeout = round(ENCOUNTER_TIMEOUT / dt)
    k, last = opened - 1, opened + timeout
    while k < min(last, len(motion.path) - 1):
        k += 1
        found = _section_at(motion, table, own, other, k)
        goes_on = found >= 0 and sections[found][_NAME] == section[_NAME]
        if goes_on and not is_change:
            ahead, ahead2 = _ahead(motion, sections[found], own, other, k)
            arrive, arrive2 = motion.odometer[k, own] + ahead, motion.odometer[k, other] + ahead2
            leave = arrive + _stretch(sections[found], _BEGIN) + motion.length[own]
            leave2 = arrive2 + _stretch(sections[found], _OTHER_BEGIN) + motion.length[other]
        elif is_change and not is_settled and not goes_on:
            gap = -distance_ahead(motion, ways.paths, ways.lanes, own, other, k)
            if np.isfinite(gap) and gap != 0.0:
                is_settled, settled, ahead_by = True, float(k), gap
                reach = abs(gap) - (motion.length[own] + motion.length[other]) / 2
                place, place2 = motion.odometer[k, own], motion.odometer[k, other]
                first = gap > 0.0
                arrive, leave = (place, place) if first else (place + reach, place + reach)
                arrive2, leave2 = (place2 + reach, place2 + reach) if first else (place2, place2)
        if is_settled:
            came = _passed(came, motion.odometer[k, own], arrive, k)
            left = _passed(left, motion.odometer[k, own], leave, k)
            came2 = _passed(came2, motion.odometer[k, other], arrive2, k)
            left2 = _passed(left2, motion.odometer[k, other], leave2, k)
        last = _first_entry(came, came2, opened) + timeout
        if left >= 0.0 and left2 >= 0.0:
            break
    # How late each is where it arrives, at least if it has not at the end, or where the order is settled.
    marks = (place, place2, settled, settled) if is_change else (arrive, arrive2, came, came2)
    late = _lateness(motion, own, opened, marks[0], marks[2] if marks[2] >= 0.0 else k, dt)
    late2 = _lateness(motion, other, opened, marks[1], marks[3] if marks[3] >= 0.0 else k, dt)
    # Where the order is settled is the place of which arrivals were to be predicted.
    behind = ahead_by / motion.speed[opened, other if ahead_by > 0.0 else own]
    into[_LEAD] = late - late2 + behind if settled >= 0.0 else into[_LEAD]
    # Of the predicted first, its delay; of the other, its advance.
    delay, advance = (late, -late2) if into[_LEAD] > 0.0 else (late2, -late)
    into[_COURTESY] = 1.0 if delay >= advance else 0.0
    into[_BRAKING] = _braking(motion, other, opened, k, came2)
    into[_RESULT], into[_GAP_TIME] = UNRESOLVED, np.nan
    if collided and opened <= end <= k and not (0.0 <= left < end and 0.0 <= left2 < end):
        into[_RESULT], into[_GAP_TIME] = COLLIDED, 0.0
        return k
    if came >= 0.0 and (came2 < 0.0 or came <= came2):
        into[_RESULT] = FIRST
        into[_GAP_TIME] = max(came2 - left, 0.0) * dt if came2 >= 0.0 and left >= 0.0 else np.nan
    elif came2 >= 0.0:
        into[_RESULT] = SECOND if left >= 0.0 else WAITING
        into[_GAP_TIME] = max(came - left2, 0.0) * dt if came >= 0.0 and left2 >= 0.0 else np.nan
    return k


@kernel
def _first_entry(came: float, came2: float, opened: int) -> int:
    """Return when the first of two entered, or when the encounter opened if neither has."""
    if came < 0.0 and came2 < 0.0:
        return opened
    return int(max(came, came2) if min(came, came2) < 0.0 else min(came, came2))


@kernel
def _lateness(motion: VehicleTracks, vehicle: int, opened: int, place: float, k: float, dt: float) -> float:
    """Return how much later a vehicle is at a place of its odometer than at the speed of the opening [s]."""
    predicted = (place - motion.odometer[opened, vehicle]) / motion.speed[opened, vehicle]
    return float((k - opened) * dt - predicted)


@kernel
def _braking(motion: VehicleTracks, vehicle: int, opened: int, last: int, came: float) -> float:
    """Return the largest deceleration of a vehicle until it arrives, or until the last instant [m/s^2]."""
    found = 0.0
    for k in range(opened, last + 1):
        if motion.present[k, vehicle] and (came < 0.0 or k <= came):
            found = max(found, -motion.acceleration[k, vehicle])
    return found


@kernel
def _stretch(section: Floats, column: int) -> float:
    """Return how far a section goes along one of its paths [m]; that of a merge is a line."""
    return 0.0 if int(section[_KIND]) == MERGE else section[column + 1] - section[column]


@kernel
def _passed(before: float, odometer: float, mark: float, k: int) -> float:
    return float(k) if before < 0.0 and odometer >= mark else before
