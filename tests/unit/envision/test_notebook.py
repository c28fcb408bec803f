import html
import re

import pytest

from smarts.envision.notebook import EpisodeFrame
from smarts.envision.viewer_page import Embedded, page_with
from smarts.errors import SmartsError
from tests.compact_fixtures import FOLDER


def test_the_frame_holds_the_page_with_the_episode():
    path = FOLDER / "bubbles.smarts"
    shown = EpisodeFrame(path, height=300)._repr_html_()
    (page,) = re.findall(r'<iframe srcdoc="([^"]*)"', shown)
    assert html.unescape(page) == page_with([Embedded("1", path.name, path.read_bytes())])
    assert 'sandbox="allow-scripts"' in shown
    assert 'height="300"' in shown


def test_what_is_no_episode_is_refused(tmp_path):
    (tmp_path / "a.smarts").write_bytes(b"PAR1")
    with pytest.raises(SmartsError, match=r"a\.smarts"):
        EpisodeFrame(tmp_path / "a.smarts")
