import html
import re

import pytest

from smarts.envision.episode_library import read_compact
from smarts.envision.notebook import EpisodeFrame
from smarts.envision.viewer_page import Embedded, page_with
from smarts.errors import SmartsError
from tests.maps import straight
from tests.recordings import Drive, at_speed, record


def test_the_frame_holds_the_page_with_the_episode(tmp_path):
    graph = straight(length=900.0)
    path = record(tmp_path, graph, [Drive([graph.lane_ids[0]], at_speed(2.0, 20, 10.0), agent="ego")])
    shown = EpisodeFrame(path, height=300)._repr_html_()
    (page,) = re.findall(r'<iframe srcdoc="([^"]*)"', shown)
    assert html.unescape(page) == page_with([Embedded("1", path.name, read_compact(path))])
    assert 'sandbox="allow-scripts"' in shown
    assert 'height="300"' in shown


def test_what_is_no_episode_is_refused(tmp_path):
    with pytest.raises(SmartsError, match="nowhere"):
        EpisodeFrame(tmp_path / "nowhere")
