"""Whether vehicles that nothing drives gain energy, over random brakes and steering.

    python perf/energy.py --sequences 10000 [--model kinematic] [--seconds 10]

Every sequence is a vehicle of one of the types, on one of six frictions, with sound tyres or a flat one, that
starts forwards or backwards, single tracks also in a spin, and coasts, brakes and steers at random with the
throttle shut. At each of its 10 ms sub-steps the kinetic energy of its body (rotation included) may not
exceed the least that kinetic and stored energy have come to before: what is gained comes from a spring, or
in Bullet from a wheel's spin. A kinematic vehicle has neither, and gains nothing.

Stored is at most, from the vehicle's state:

- in a tyre's bristle, whose force grows with its deflection e as k e and never beyond the tyre's largest
  force F: k e^2 / 2 up to e = F / k, then F (e - F / (2 k));
- in Bullet, in the suspension: a wheel's spring and the axle's roll stiffness; in the shell of a vehicle that
  has tipped over; and in the height of the centre of gravity. All are counted from where the vehicle rests;
- in Bullet, in the spin of its wheels.

Ends with exit code 1 if a vehicle gained energy.
"""

from __future__ import annotations

import argparse
import itertools
import sys
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from smarts.dynamics import FLAT_TYRE, MODELS, TYRE_MODELS, Fleet
from smarts.dynamics.chassis import SHELL_SINK
from smarts.dynamics.layout import GRAVITY
from smarts.dynamics.wheel import LEAST_FRICTION
from smarts.types.streams import Purpose, stream

Floats = NDArray[np.float64]

TYPES = ("passenger", "bus", "coach", "truck", "motorcycle")
FRICTIONS = (0.05, 0.2, 0.4, 0.7, 0.9, 1.2)
DT = 0.01
"""Sub-step [s]."""
PLACES = 20
"""Vehicles in Bullet that share a simulation, out of each other's reach."""
TOLERANCE = 1e-9
"""Of energies, for rounding."""


@dataclass(frozen=True)
class Gain:
    """What became of the vehicles of one model, one row each."""

    kind: NDArray[np.str_]
    """Their types."""
    mass: Floats
    """[kg]."""
    start: Floats
    """Kinetic energy at the start [J]."""
    unexplained: Floats
    """The most by which kinetic energy exceeded what kinetic and stored energy had come to before [J]."""
    most_stored: Floats
    """The most that `stored_energy` came to [J]."""
    regained: Floats
    """The most by which kinetic energy rose above its least [J]."""

    @property
    def breaches(self) -> NDArray[np.bool_]:
        """Whose kinetic energy rose by more than what had been stored."""
        return ~(self.unexplained <= TOLERANCE * np.maximum(self.start, 1.0))


def kinetic_energy(fleet: Fleet) -> Floats:
    """Return the kinetic energy of each vehicle's body, rotation included [J], shape (E,)."""
    cars, bodies = fleet._cars, fleet._bodies
    turning = np.einsum("eij,ej->ei", _axes(bodies), bodies[:, 10:13])
    moving = cars["mass"] * (bodies[:, 7:10] ** 2).sum(1)
    return 0.5 * (moving + (cars["inertia"] * turning**2).sum(1))


def stored_energy(fleet: Fleet, model: str) -> Floats:
    """Return the most that may become kinetic energy of each vehicle's body [J], shape (E,)."""
    if model == "kinematic":
        return np.zeros(len(fleet._cars))
    if model == "dynamic":
        return bristle_energy(fleet, by_axle=True)
    spinning = 0.5 * (fleet._cars["wheel_inertia"] * fleet._states["spin"] ** 2).sum(1)
    return bristle_energy(fleet, by_axle=False) + suspension_energy(fleet) + shell_energy(fleet) + spinning


def bristle_energy(fleet: Fleet, *, by_axle: bool) -> Floats:
    """Return the most that each vehicle's bristles can give back [J], shape (E,).

    Args:
        fleet: The vehicles.
        by_axle: Whether both tyres of an axle have the mean of their grips, as those of single tracks.
    """
    cars, states = fleet._cars, fleet._states
    grip = fleet._arrays.road[:, :4] * states["grip_factor"]
    if by_axle:
        grip = grip.reshape(-1, 2, 2).mean(2).repeat(2, axis=1)
    grip = np.maximum(grip, LEAST_FRICTION) * states["load"]
    excess = states["load"] / cars["nominal_load"] - 1.0
    magic = (cars["tyre_model"] == TYRE_MODELS.index("pacejka"))[:, None]
    total = np.zeros(len(cars))
    for axis, (at_nominal, with_load) in {"x": ("pdx1", "pdx2"), "y": ("pdy1", "pdy2")}.items():
        first, second = cars[at_nominal][:, None], cars[with_load][:, None]
        largest = np.maximum(first + second * excess, first / 3.0) / cars["static_grip"]
        force = np.maximum(np.where(magic, largest, 1.0) * grip, 1e-9)
        stiffness = cars[f"carcass_{axis}"] * states["stiffness_factor"]
        stretch = np.abs(states[f"deflection_{axis}"]) * stiffness / force
        share = np.where(stretch < 1.0, 0.5 * stretch**2, stretch - 0.5)
        total += (force**2 / stiffness * share).sum(1)
    return total


def suspension_energy(fleet: Fleet) -> Floats:
    """Return what springs and height hold of a vehicle on a level road, over its rest [J], shape (E,).

    A flat tyre that is lower by d lowers the rest, by at most d times its static load: the energy at rest is
    convex in d, since springs are, and that is its slope at 0.
    """
    cars, bodies = fleet._cars, fleet._bodies
    up = _axes(bodies)[:, :, 2]
    hubs = [cars["wheel_x"], cars["wheel_y"], cars["radius"] - cars["cog_height"][:, None]]
    height = bodies[:, 2, None] + np.einsum("kew,ek->ew", np.array(hubs), up)
    rest = cars["static_load"] / cars["spring"]
    radius = cars["radius"] * fleet._states["radius_factor"]
    compression = np.maximum(rest + radius - height, 0.0)
    energy = 0.5 * (cars["spring"] * (compression**2 - rest**2)).sum(1)
    energy += (cars["static_load"] * (cars["radius"] - radius)).sum(1)
    for left in (0, 2):
        difference = compression[:, left] - compression[:, left + 1]
        energy += 0.5 * cars["roll_spring"][:, left] * difference**2
    return energy + cars["mass"] * GRAVITY * (bodies[:, 2] - cars["cog_height"])


def shell_energy(fleet: Fleet) -> Floats:
    """Return what the shell's corners hold of a vehicle that has tipped over [J], shape (E,)."""
    cars, bodies = fleet._cars, fleet._bodies
    signs = np.array(list(itertools.product((-1.0, 1.0), repeat=3)))
    corners = signs * cars["half_size"][:, None, :]
    corners[:, :, 0] -= cars["centre_to_cog"][:, None]
    corners[:, :, 2] += cars["box_height"][:, None]
    height = bodies[:, 2, None] + np.einsum("eck,ek->ec", corners, _axes(bodies)[:, :, 2])
    stiffness = cars["mass"] * GRAVITY / (4.0 * SHELL_SINK)
    return 0.5 * stiffness * (np.minimum(height, 0.0) ** 2).sum(1)


def _axes(bodies: Floats) -> Floats:
    """Return the bodies' axes: row i holds axis i in the world, shape (E, 3, 3)."""
    x, y, z, w = bodies[:, 3:7].T
    return np.array(
        [
            [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + z * w), 2.0 * (x * z - y * w)],
            [2.0 * (x * y - z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + x * w)],
            [2.0 * (x * z + y * w), 2.0 * (y * z - x * w), 1.0 - 2.0 * (x * x + y * y)],
        ]
    ).transpose(2, 0, 1)


def coasting_controls(count: int, seconds: float, draw: np.random.Generator) -> Iterator[Floats]:
    """Yield controls without throttle for each sub-step: held for a third of a second on average.

    Yields:
        Throttle, brake and steering, shape (`count`, 3); the same array each time.
    """
    controls = np.zeros((count, 3))
    for _ in range(round(seconds / DT)):
        changed = draw.random(count) < 0.03
        brake = draw.choice([0.0, 0.0, 0.0, 0.1, 0.5, 1.0], count)
        lock = draw.choice([-1.0, 0.0, 1.0], count)
        steering = np.where(draw.random(count) < 0.5, lock, draw.uniform(-1.0, 1.0, count))
        controls[changed, 1], controls[changed, 2] = brake[changed], steering[changed]
        yield controls


def start(fleet: Fleet, count: int, model: str, tyres: str, draw: np.random.Generator) -> None:
    """Put `count` vehicles on their roads at random speeds, 1 km apart."""
    for row in range(count):
        speed, heading = draw.uniform(-10.0, 35.0), draw.uniform(-3.0, 3.0)
        place = (0.0, 1000.0 * row)
        steering = draw.uniform(-0.5, 0.5) if model == "kinematic" else 0.0
        fleet.spawn(
            row, TYPES[row % len(TYPES)], place, heading, speed, steering=steering, model=model, tyres=tyres
        )
        if draw.random() < 0.1:
            fleet.set_fault(row, int(draw.integers(4)), FLAT_TYRE)
    fleet.road.friction[:] = draw.choice(FRICTIONS, (count, 1))
    if model == "dynamic":
        spinning = count // 4
        fleet._bodies[:spinning, 7:9] += draw.uniform(-8.0, 8.0, (spinning, 2))
        fleet._bodies[:spinning, 12] = draw.uniform(-3.0, 3.0, spinning)


def coast(model: str, sequences: int, seconds: float, tyres: str = "pacejka", seed: int = 0) -> Gain:
    """Let vehicles coast, one for each sequence, and return what they gained."""
    draw = stream(seed, Purpose.STARTS)
    places = PLACES if model == "bullet" else sequences
    with Fleet(-(-sequences // places), places, step=DT, substeps=1) as fleet:
        count = len(fleet._cars)
        start(fleet, count, model, tyres, draw)
        begin = lowest = kinetic_energy(fleet)
        most_stored = stored_energy(fleet, model)
        available = begin + most_stored
        unexplained, regained = np.full(count, -np.inf), np.zeros(count)
        for controls in coasting_controls(count, seconds, draw):
            fleet.step(controls)
            kinetic, stored = kinetic_energy(fleet), stored_energy(fleet, model)
            # A NaN is a breach: maximum and minimum keep it.
            unexplained = np.maximum(unexplained, kinetic - available)
            regained = np.maximum(regained, kinetic - lowest)
            most_stored = np.maximum(most_stored, stored)
            available = np.minimum(available, kinetic + stored)
            lowest = np.minimum(lowest, kinetic)
        kind = np.array([TYPES[row % len(TYPES)] for row in range(count)])
        return Gain(kind, fleet._cars["mass"].copy(), begin, unexplained, most_stored, regained)


def main() -> None:
    """Coast, print a line for each model, tyre model and type, and exit with 1 if energy was gained."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--sequences", type=int, default=10_000, help="of each model")
    parser.add_argument("--seconds", type=float, default=10.0, help="of each sequence")
    parser.add_argument("--model", choices=MODELS, action="append", help="all if not given")
    arguments = parser.parse_args()
    print("model      tyres    type        vehicles  gained  regained J/kg  stored J/kg")
    gained = 0
    for model in arguments.model or MODELS:
        for seed, tyres in enumerate(TYRE_MODELS):
            gain = coast(model, arguments.sequences // len(TYRE_MODELS), arguments.seconds, tyres, seed)
            gained += int(gain.breaches.sum())
            for kind in TYPES:
                rows = gain.kind == kind
                print(
                    f"{model:10} {tyres:8} {kind:11} {rows.sum():8} {gain.breaches[rows].sum():7} "
                    f"{(gain.regained / gain.mass)[rows].max():14.3g} "
                    f"{(gain.most_stored / gain.mass)[rows].max():12.3g}",
                    flush=True,
                )
    sys.exit(1 if gained else 0)


if __name__ == "__main__":
    main()
