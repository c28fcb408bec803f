"""The errors of hand-overs, and where, why and after how long vehicles change hands."""

from __future__ import annotations

from collections import Counter, defaultdict
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from smarts.geometry.frames import wrap_angle
from smarts.types.transfers import Departure, Refusal

ERRORS = ("along", "across", "heading", "speed")


@dataclass
class Tally:
    """What was measured in some runs."""

    steps: int = 0
    errors: dict[str, list[NDArray]] = field(default_factory=lambda: defaultdict(list))
    """Rows of (along, across, heading, speed) by what happened."""
    places: Counter[str] = field(default_factory=Counter)
    """Where vehicles were taken over."""
    kinds: Counter[str] = field(default_factory=Counter)
    ends: Counter[str] = field(default_factory=Counter)
    """How the holds ended."""
    waits: list[float] = field(default_factory=list)
    """From the wish to release to the release [s]; infinite if it never came."""
    refused: NDArray = field(default_factory=lambda: np.zeros(len(Refusal), np.int64))
    departed: NDArray = field(default_factory=lambda: np.zeros(len(Departure), np.int64))

    def add(self, what: str, errors: NDArray) -> None:
        """Add errors, shape (N, 4)."""
        self.errors[what].append(errors)

    def join(self, other: Tally) -> None:
        """Add what was measured in other runs."""
        self.steps += other.steps
        for what, rows in other.errors.items():
            self.errors[what] += rows
        for own, more in ((self.places, other.places), (self.kinds, other.kinds), (self.ends, other.ends)):
            own.update(more)
        self.waits += other.waits
        self.refused, self.departed = self.refused + other.refused, self.departed + other.departed


def step_errors(before: dict[str, NDArray], now: dict[str, NDArray], dt: float) -> NDArray:
    """Return by slot how far a step is off a steady continuation: along, across, heading, speed, (V, 4)."""
    turn = wrap_angle(now["heading"] - before["heading"])
    course = before["heading"] + 0.5 * before["yaw_rate"] * dt
    moved = now["position"] - before["position"]
    along = moved[:, 0] * np.cos(course) + moved[:, 1] * np.sin(course)
    across = moved[:, 1] * np.cos(course) - moved[:, 0] * np.sin(course)
    mean = 0.5 * (before["speed"] + now["speed"])
    return np.abs(
        np.column_stack(
            [
                along - mean * dt,
                across - before["lateral_speed"] * dt,
                turn - before["yaw_rate"] * dt,
                now["speed"] - before["speed"],
            ]
        )
    )


def print_errors(tally: Tally) -> None:
    """Print a table of the errors."""
    print(
        f"{'':24}{'count':>8}" + "".join(f"{name + suffix:>14}" for name in ERRORS for suffix in ("", " 99%"))
    )
    for what, rows in sorted(tally.errors.items()):
        table = np.concatenate(rows)
        cells = "".join(
            f"{value:14.3f}"
            for column in table.T
            for value in (column.max(initial=0.0), np.quantile(column, 0.99) if len(column) else 0.0)
        )
        print(f"{what:24}{len(table):8}{cells}")


def print_tally(tally: Tally) -> None:
    """Print a table of what was measured."""
    print_errors(tally)
    waits = np.array(tally.waits)
    print(f"taken: {dict(tally.places)}, {dict(tally.kinds)}")
    print(f"ends of holds: {dict(tally.ends)}")
    print(
        f"released within 10 s: {np.mean(waits <= 10.0):.1%} of {len(waits)}, median {np.median(waits):.1f} s"
    )
    print("refused, vehicles:", {r.name: int(n) for r, n in zip(Refusal, tally.refused, strict=True) if n})
    print("departed:", {d.name: int(n) for d, n in zip(Departure, tally.departed, strict=True) if n})
