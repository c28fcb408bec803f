"""Tyres that fail."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class TyreFault:
    """What is wrong with one tyre. The default is a sound tyre."""

    radius: float = 1.0
    """Factor on the rolling radius."""
    stiffness: float = 1.0
    """Factor on slip and carcass stiffness."""
    grip: float = 1.0
    """Factor on the road's friction."""
    resistance: float = 0.0
    """Rolling resistance over load that comes on top."""


FLAT_TYRE = TyreFault(radius=0.93, stiffness=0.3, grip=0.7, resistance=0.1)
"""An aired-out tyre: orders of magnitude only, no measured set lies behind them."""
