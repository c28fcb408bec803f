"""The agents of this project, one file each: a line of `_PLACES` makes one known."""

from __future__ import annotations

from smarts.zoo.entry import ZooEntry

_IDM = "Treiber, Hennecke, Helbing, Phys. Rev. E 62 (2000) 1805"

_PLACES = {
    "keep-lane-v0": ("keep_lane:KeepLane", _IDM),
    "non-interactive-v0": ("keep_lane:NonInteractive", "the original's agent of this name"),
    "idm-v0": ("idm:IdmDriver", _IDM),
}
"""Name -> ("file:Class", provenance)."""

AGENTS = {
    name: ZooEntry(
        name,
        f"{__name__}.{place}",
        author="smarts-bench",
        m_level="M0",
        provenance=provenance,
        licence="MIT",
    )
    for name, (place, provenance) in _PLACES.items()
}
"""Name -> entry; nothing is imported before it is asked for."""
