"""Recorded traffic."""

from __future__ import annotations

import math
from dataclasses import dataclass

from smarts.sstudio.sstypes.identity import Described


@dataclass(frozen=True, eq=False)
class TrafficHistoryDataset(Described):
    """Trajectories recorded in the world, to be replayed as traffic."""

    name: str
    """A name, unique in the scenario."""
    source_type: str
    """The format: "CommonRoad", "SHF", "NGSIM", "FCD", "INTERACTION", "Argoverse", "Waymo" or "SMARTS"."""
    input_path: str | None = None
    """The data's path; without it the data set is a placeholder that nothing is read from."""
    scenario_id: str | None = None
    """The scenario in a Waymo file."""
    x_margin_px: float = 0.0
    """The map's offset along x [pixels]."""
    y_margin_px: float = 0.0
    """The map's offset along y [pixels]."""
    swap_xy: bool = False
    """Whether the data's axes are exchanged."""
    flip_y: bool = False
    """Whether the data is mirrored about the x axis."""
    filter_off_map: bool = False
    """Whether to leave out positions outside the map's bounding box."""
    map_lane_width: float = 3.7
    """The width of a lane on the map; over `real_lane_width_m` it is the map's scale."""
    real_lane_width_m: float = 3.7
    """The width of a lane in the world [m]."""
    speed_limit_mps: float | None = None
    """The speed at which added agents begin [m/s]."""
    heading_inference_window: int = 2
    """Number of positions that a heading is averaged over."""
    heading_inference_min_speed: float = 2.2
    """Below this speed the heading is held, since positions are noisy [m/s]."""
    max_angular_velocity: float | None = None
    """The fastest turn that is believed [rad/s]."""
    default_heading: float = 1.5 * math.pi
    """The heading where none can be inferred [rad]."""
