"""Episodes in a notebook: the page inside a cell's output, without a server."""

from __future__ import annotations

import html
from pathlib import Path

from smarts.envision.episode_library import read_compact
from smarts.envision.viewer_page import Embedded, page_with


class EpisodeFrame:
    """Shows a recorded episode as the last value of a notebook's cell.

    The page runs in a frame of its own, which can reach neither the notebook nor the network.

    Args:
        episode: Folder of a recorded episode.
        height: Height of the frame [pixels].

    Raises:
        SmartsError: The episode is damaged.
    """

    def __init__(self, episode: str | Path, *, height: int = 480) -> None:
        path = Path(episode)
        data = read_compact(path)
        self._page, self._height = page_with([Embedded("1", path.name, data)]), height

    def _repr_html_(self) -> str:
        page = html.escape(self._page)
        return (
            f'<iframe srcdoc="{page}" sandbox="allow-scripts" style="border: 0" width="100%" '
            f'height="{self._height:d}"></iframe>'
        )
