"""What becomes of vehicles in a run with hand-overs, and of the same vehicles in the same run without.

Vehicles have the same names in both runs. A crash is two footprints that begin to overlap, a hard braking a
step with more than 4.5 m/s^2, a stop a vehicle that moved and comes to a stand.
"""

from __future__ import annotations

import math
from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from smarts.geometry.boxes import boxes_overlap
from smarts.sim.ownership import Ownership
from smarts.types.frame import Frame
from smarts.types.transfers import CarriedOut, Departure, Reason
from smarts.types.vehicles import Owner, VehicleStates

STANDING = 0.1
"""Below this speed a vehicle stands [m/s]."""
MOVING = 2.0
"""Above this speed it moves [m/s]."""
HARD = 4.5
"""Deceleration above which a vehicle brakes hard [m/s^2]."""
SOON = 10.0
"""So long after a transfer a crash or a stop counts as one of it [s]."""
LONG = 30.0
"""A stand is long from this time on [s]: runs end after 60 s."""
LATE = 10.0
"""A release should be carried out within this time [s]."""
NEVER_TAKEN, STILL_WAITS = "take refused, never made", "release refused, waits at the end"
ARRIVED, REMOVED = "release refused, then arrived", "release refused, then removed"
UNRESOLVED = {NEVER_TAKEN: "", STILL_WAITS: "", ARRIVED: "", REMOVED: "0"}
"""What may become of a refused transfer that is never carried out, and the target."""
FARTHEST = 12.1
"""Between the centres of two footprints that overlap [m]: no vehicle is longer."""


@dataclass
class Watch:
    """What happened in one run, by the vehicles' names."""

    dt: float
    seen: set[str] = field(default_factory=set)
    crashes: dict[str, list[int]] = field(default_factory=lambda: defaultdict(list))
    """Steps in which a vehicle's footprint begins to overlap another."""
    brakings: dict[str, list[int]] = field(default_factory=lambda: defaultdict(list))
    stops: dict[str, list[int]] = field(default_factory=lambda: defaultdict(list))
    transfers: list[tuple[str, int]] = field(default_factory=list)
    stand: Counter[str] = field(default_factory=Counter)
    """Steps of each vehicle's longest stand."""
    hardest: float = 0.0
    """Largest loss of speed in a step of a vehicle that traffic drives [m/s]."""
    left: set[str] = field(default_factory=set)
    """Vehicles that are not there any more at the end."""
    removed: Counter[Departure] = field(default_factory=Counter)
    """Vehicles that agents have not given back."""
    waits: list[float] = field(default_factory=list)
    """How long each release was refused [s]; infinite if the vehicle was removed instead."""
    unresolved: Counter[str] = field(default_factory=Counter)
    """Refused transfers that were never carried out, by what became of them: see `UNRESOLVED`."""
    _departed: dict[tuple[int, int], Departure] = field(default_factory=dict)
    """Why agents' vehicles (slot, generation) have left."""
    _now: dict[str, tuple[float, int, int]] = field(default_factory=dict)
    """Speed, owner, and steps of standing of the vehicles of the last step."""
    _moving: set[str] = field(default_factory=set)
    """Vehicles that have moved since their last stop."""
    _overlapping: set[tuple[str, str]] = field(default_factory=set)

    def take(self, frame: Frame) -> None:
        """Take in one step of a run of one simulation."""
        world = frame.world
        vehicles, step = world.vehicles.of(0), int(world.step[0])
        for done in frame.transfers:
            self._note(done)
        slots = np.flatnonzero(vehicles.alive)
        names = [world.registry.name(0, slot) for slot in slots.tolist()]
        before, self._now = self._now, {}
        columns = vehicles.speed[slots].tolist(), vehicles.owner[slots].tolist()
        for name, speed, owner in zip(names, *columns, strict=True):
            was, had, stood = before.get(name, (speed, owner, 0))
            stood = stood + 1 if abs(speed) < STANDING else 0
            self._now[name] = speed, owner, stood
            self.stand[name] = max(self.stand[name], stood)
            if had != owner:
                self.transfers.append((name, step))
            elif owner == Owner.TRAFFIC:
                self.hardest = max(self.hardest, was - speed)
            if was - speed > HARD * self.dt + 1e-6:
                self.brakings[name].append(step)
            if speed > MOVING:
                self._moving.add(name)
            elif stood == 1 and name in self._moving:
                self._moving.remove(name)
                self.stops[name].append(step)
        self.seen.update(names)
        pairs = {(names[one], names[other]) for one, other in _overlaps(vehicles, slots)}
        for pair in pairs - self._overlapping:
            for name in pair:
                self.crashes[name].append(step)
        self._overlapping = pairs

    def _note(self, done: CarriedOut) -> None:
        """Note a vehicle that an agent has given up."""
        transfer = done.transfer
        if transfer.reason == Reason.LEAVE:
            key = transfer.slot, transfer.generation
            self._departed[key] = Departure(transfer.departure)
        elif transfer.reason == Reason.RELEASE and transfer.from_owner == Owner.AGENT:
            self.waits.append(done.refusals * self.dt)

    def end(self, ownership: Ownership) -> None:
        """End the run."""
        self.left = self.seen - self._now.keys()
        counts = zip(Departure, ownership.departed[0].tolist(), strict=True)
        self.removed += Counter(dict(counts))
        for each in ownership.unresolved(0):
            if each.reason == Reason.TAKE:
                self.unresolved[NEVER_TAKEN] += 1
            elif each.reason == Reason.RELEASE:
                self._note_unreleased((each.slot, each.generation), each.steps * self.dt)

    def _note_unreleased(self, key: tuple[int, int], waited: float) -> None:
        """Note a vehicle that traffic has refused and that it has not taken back."""
        departure = self._departed.get(key)
        if departure is None:
            self.unresolved[STILL_WAITS] += 1
            if waited > LATE:
                self.waits.append(waited)
        elif departure == Departure.ARRIVED:
            self.unresolved[ARRIVED] += 1
        else:
            self.unresolved[REMOVED] += 1
            self.waits.append(math.inf)


def _overlaps(states: VehicleStates, slots: NDArray) -> Iterator[tuple[int, int]]:
    """Yield pairs of places in `slots` whose vehicles' footprints overlap."""
    place, heading = states.position[slots], states.heading[slots]
    size = np.stack([states.length[slots], states.width[slots]], -1)
    apart = np.abs(place[:, None] - place[None]).max(-1)
    one, other = np.nonzero(np.triu(apart < FARTHEST, 1))
    if len(one):
        hit = boxes_overlap(place[one], heading[one], size[one], place[other], heading[other], size[other])
        yield from zip(one[hit].tolist(), other[hit].tolist(), strict=True)


@dataclass
class Safety:
    """Runs with hand-overs beside the same runs without."""

    driven: list[Watch] = field(default_factory=list)
    plain: list[Watch] = field(default_factory=list)

    def rows(self) -> Iterator[tuple[str, str, str, str]]:
        """Yield name, value with hand-overs, value without, and target of each figure."""
        vehicles = [sum(len(watch.seen) for watch in run) for run in (self.driven, self.plain)]
        yield "vehicles", str(vehicles[0]), str(vehicles[1]), ""
        yield "hand-overs", str(sum(len(watch.transfers) for watch in self.driven)), "0", ""
        for what in ("crashes", "brakings", "stops"):
            total = [
                1e3 * sum(map(len, [each for watch in run for each in getattr(watch, what).values()])) / count
                for run, count in zip((self.driven, self.plain), vehicles, strict=True)
            ]
            yield f"{what}, per 1,000 vehicles", f"{total[0]:.1f}", f"{total[1]:.1f}", ""
            soon = [self._soon(what, self.driven), self._soon(what, self.plain)]
            yield f"{what} within {SOON:.0f} s after a transfer", str(soon[0]), str(soon[1]), "no more"
        hardest = [max((watch.hardest for watch in run), default=0.0) for run in (self.driven, self.plain)]
        yield "hardest stop of traffic in a step [m/s]", f"{hardest[0]:.2f}", f"{hardest[1]:.2f}", "0.5"
        longest = [self._longest(run) for run in (self.driven, self.plain)]
        yield "longest stand [s]", f"{longest[0]:.1f}", f"{longest[1]:.1f}", "no longer"
        yield "vehicles that stand longer than SUMO's own", str(self._stand_longer(longest[1])), "0", "0"
        stands = [self._long_stands(run) for run in (self.driven, self.plain)]
        yield f"stands of {LONG:.0f} s of vehicles handed over", str(stands[0]), str(stands[1]), "no more"
        shares = [
            (self._arrived(run) + self._there(run)) / size
            for run, size in zip((self.driven, self.plain), vehicles, strict=True)
        ]
        yield "arrived, or on their way at the end", f"{shares[0]:.2%}", f"{shares[1]:.2%}", "100%"
        gone = sum((watch.removed for watch in self.driven), Counter[Departure]())
        for reason in (Departure.COLLISION, Departure.OFF_LANES):
            yield f"removed: {reason.name.lower()}", str(gone[reason]), "0", "0 but for crashes"
        waits = np.array([wait for watch in self.driven for wait in watch.waits])
        yield (
            f"released within {LATE:.0f} s",
            f"{np.mean(waits <= LATE) if len(waits) else 1.0:.1%}",
            "",
            "95%",
        )
        unresolved = sum((watch.unresolved for watch in self.driven), Counter[str]())
        for what, target in UNRESOLVED.items():
            yield what, str(unresolved[what]), "", target

    def _soon(self, what: str, run: Sequence[Watch]) -> int:
        """Return how many vehicles crash or stop soon after the transfers of the runs with hand-overs."""
        found = 0
        for driven, watch in zip(self.driven, run, strict=True):
            events, steps = getattr(watch, what), round(SOON / watch.dt)
            for name, at in driven.transfers:
                found += any(at <= step <= at + steps for step in events.get(name, ()))
        return found

    def _longest(self, run: Sequence[Watch]) -> float:
        return max((watch.dt * max(watch.stand.values(), default=0) for watch in run), default=0.0)

    def _stand_longer(self, longest: float) -> int:
        """Return how many vehicles of the runs with hand-overs stand longer than some time [s]."""
        return sum(
            watch.dt * steps > longest + 1e-9 for watch in self.driven for steps in watch.stand.values()
        )

    def _long_stands(self, run: Sequence[Watch]) -> int:
        """Return how many stands are long, of the vehicles that change hands in the runs with hand-overs."""
        return sum(
            watch.dt * watch.stand[name] >= LONG - 1e-9
            for driven, watch in zip(self.driven, run, strict=True)
            for name in {name for name, _ in driven.transfers}
        )

    def _arrived(self, run: Sequence[Watch]) -> int:
        lost = (Departure.COLLISION, Departure.OFF_LANES)
        return sum(len(watch.left) - sum(watch.removed[reason] for reason in lost) for watch in run)

    def _there(self, run: Sequence[Watch]) -> int:
        return sum(len(watch.seen) - len(watch.left) for watch in run)


def print_safety(safety: Safety) -> None:
    """Print the figures of some runs: with hand-overs / without."""
    print(f"\n{'':44}{'':>20}   target")
    for name, *values, target in safety.rows():
        print(f"{name:44}{' / '.join(filter(None, values)):>20}   {target}")
