"""The agent types: usual combinations of sensors and actions, by name."""

from __future__ import annotations

import enum


class AgentType(enum.IntEnum):
    """Names and numbers are the original's; `AgentInterface.from_type` says what each stands for."""

    Buddha = 0
    """Watches nothing and does nothing."""
    Full = 1
    """All sensors; throttle, brake and steering."""
    Standard = 2
    """Waypoints and neighbours; throttle, brake and the rate of steering."""
    Laner = 3
    """Waypoints; the four lane actions."""
    Loner = 4
    """Waypoints; throttle, brake and steering."""
    Tagger = 5
    """Waypoints and neighbours; throttle, brake and steering."""
    StandardWithAbsoluteSteering = 6
    """Waypoints and neighbours; throttle, brake and steering."""
    LanerWithSpeed = 7
    """Waypoints; target speed and lane change."""
    Tracker = 8
    """Waypoints; a path that is tracked."""
    Boid = 9
    """Waypoints and neighbours; target poses of several vehicles."""
    MPCTracker = 10
    """Waypoints; a path that is tracked by model-predictive control."""
    TrajectoryInterpolator = 11
    """A path with times that is followed exactly."""
    Direct = 12
    """Neighbours and signals; speed, or acceleration and yaw rate."""
