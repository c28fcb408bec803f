"""How far vehicles take to stop from 20 m/s, over v^2 / (2 mu g), with ABS and with wheels that lock.

python perf/stopping.py
"""

from __future__ import annotations

import numpy as np

from smarts.dynamics import Fleet
from smarts.dynamics.layout import GRAVITY

TYPES = ("passenger", "bus", "coach", "truck", "motorcycle")
SPEED = 20.0
"""Of every stop's start [m/s]."""


def stopping_distance(name: str, friction: float, *, abs: bool) -> float:
    """Return the way of a car in Bullet under full braking, on the Magic Formula [m]."""
    with Fleet(1, 1) as fleet:
        fleet.road.friction[:] = friction
        fleet.spawn(0, name, (0.0, 0.0), 0.0, SPEED)
        fleet.set_assistance(0, abs=abs, traction_control=True)
        while fleet.motion.velocity[0, 0] > 1e-3:
            fleet.step(np.array([[0.0, 1.0, 0.0]]))
        return float(fleet.motion.position[0, 0])


def main() -> None:
    """Measure and print."""
    print("type        friction   with ABS   locked over ABS")
    for friction in (0.9, 0.4):
        ideal = SPEED**2 / (2.0 * friction * GRAVITY)
        for name in TYPES:
            held = stopping_distance(name, friction, abs=True)
            locked = stopping_distance(name, friction, abs=False)
            print(f"{name:10} {friction:9} {held / ideal:10.3f} {locked / held:17.3f}")


if __name__ == "__main__":
    main()
