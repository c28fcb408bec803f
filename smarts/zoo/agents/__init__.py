"""The agents of this project, one file each: a line of `_PLACES` makes one known."""

from __future__ import annotations

from smarts.zoo.entry import ZooEntry

_IDM = "Treiber, Hennecke, Helbing, Phys. Rev. E 62 (2000) 1805"

_MOBIL = "Kesting, Treiber, Helbing, TRR 1999 (2007) 86"
_OURS = "written for this project"

_PLACES = {
    "keep-lane-v0": ("keep_lane:KeepLane", _IDM),
    "idm-v0": ("idm:IdmDriver", _IDM),
    "mobil-v0": ("mobil:MobilDriver", _MOBIL),
    "aggressive-v0": ("mobil:AggressiveDriver", _MOBIL),
    "gap-acceptance-v0": ("gap_acceptance:GapAcceptance", _OURS),
    "cut-in-v0": ("cut_in:CutIn", _OURS),
    "overtaking-v0": ("overtaking:Overtaking", _OURS),
    "u-turn-v0": ("u_turn:UTurn", _OURS),
    "boids-v0": ("boids:Boids", "Reynolds, SIGGRAPH 1987"),
    "random-v0": ("random_actions:RandomActions", _OURS),
    "trajectory-v0": ("trajectory:TrajectoryPlayer", _OURS),
    "non-interactive-v0": ("keep_lane:NonInteractive", "after the original's agent of this name"),
    "chase-via-points-v0": ("chase_via_points:ChaseViaPoints", "after the original's agent of this name"),
}
"""Name -> ("file:Class", provenance)."""

_DEFAULTS = {
    "aggressive-v0": {
        **{"tau": 0.6, "accel": 2.8, "decel": 4.5, "min_gap": 1.5, "speed_factor": 1.2},
        **{"politeness": 0.0, "threshold": 0.1, "safe_braking": 6.0, "junction_margin": 0.4},
    },
}
"""Name -> options that differ from those of the class."""

AGENTS = {
    name: ZooEntry(
        name,
        f"{__name__}.{place}",
        defaults=_DEFAULTS.get(name, {}),
        author="smarts-bench",
        m_level="M0",
        provenance=provenance,
        licence="MIT",
    )
    for name, (place, provenance) in _PLACES.items()
}
"""Name -> entry; nothing is imported before it is asked for."""
