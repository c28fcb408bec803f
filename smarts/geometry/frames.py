"""Angles and frames; converts between headings and SUMO's compass angles.

A heading is counter-clockwise from +x in (-pi, pi] [rad]. SUMO's angle is clockwise from north in degrees.
The functions take floats or arrays and can be compiled with numba.
"""

from __future__ import annotations

import math
from typing import TypeVar

from smarts.arrays import Floats

FARTHEST = 1e7
"""Positions with larger coordinates, or NaN, are on no map [m]."""
Angle = TypeVar("Angle", float, Floats)


def wrap_angle(angle: Angle) -> Angle:
    """Return the equal angle in (-pi, pi] [rad]."""
    # Python's modulo has the divisor's sign, so the bracket is in [0, 2 pi) and pi itself stays pi.
    return math.pi - (math.pi - angle) % (2.0 * math.pi)


def heading_from_compass(degrees: Angle) -> Angle:
    """Return the heading [rad] of a SUMO angle [degrees]."""
    return wrap_angle((90.0 - degrees) * (math.pi / 180.0))


def compass_from_heading(heading: Angle) -> Angle:
    """Return the SUMO angle in [0, 360) [degrees] of a heading [rad]."""
    return (90.0 - heading * (180.0 / math.pi)) % 360.0
