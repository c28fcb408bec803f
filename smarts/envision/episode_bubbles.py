"""The bubbles of a recorded episode, as they move."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from matplotlib.artist import Artist

from smarts.arrays import Floats
from smarts.envision.bubble_shapes import moved, placed_shapes
from smarts.sim.episode_files import RecordedEpisode


class EpisodeBubbles:
    """Finds and draws the outlines of bubbles in any step.

    Args:
        episode: The recorded episode.
    """

    def __init__(self, episode: RecordedEpisode) -> None:
        self.names: list[str] = episode.table("bubbles")["id"].tolist()
        self._travels = [followed != "" for followed in episode.table("bubbles")["followed"]]
        rings, poses = episode.table("bubble_rings"), episode.table("bubble_poses")
        outlines = [np.stack(pair, -1) for pair in zip(rings["x"], rings["y"], strict=True)]
        owners = zip(rings["bubble"].tolist(), rings["is_margin"].tolist(), outlines, strict=True)
        self._rings: dict[tuple[int, bool], list[Floats]] = {}
        for number, is_margin, ring in owners:
            self._rings.setdefault((number, is_margin), []).append(ring)
        is_of = [poses["bubble"] == number for number in range(len(self.names))]
        columns = [poses[name] for name in ("step", "x", "y", "angle", "is_active")]
        # Each bubble's changes, in order of steps.
        self._poses = [np.stack([column[rows] for column in columns], -1, dtype=float) for rows in is_of]

    def shapes(self, step: int) -> Iterator[Artist]:
        """Yield the shapes of all bubbles in a step."""
        for number, name in enumerate(self.names):
            now = self._poses[number]
            change = np.searchsorted(now[:, 0], step, side="right") - 1
            if change >= 0:
                _, *pose, is_active = now[change].tolist()
                zone, margin = self._rings[number, False], self._rings[number, True]
                travels = self._travels[number]
                yield from placed_shapes(
                    zone, margin, pose, name=name, travels=travels, is_active=bool(is_active)
                )

    def corners(self) -> Floats:
        """Return all corners of all bubbles in all poses [m], shape (., 2)."""
        corners = [
            moved(ring, pose)
            for number in range(len(self.names))
            for ring in self._rings[number, True]
            for pose in self._poses[number][:, 1:4].tolist()
        ]
        return np.concatenate([np.zeros((0, 2)), *corners])
