"""The window of `render_mode="human"`, drawn by matplotlib into memory."""

import matplotlib.pyplot as plt
import numpy as np
import pytest

from smarts.envision import window
from smarts.envision.window import PlotWindow
from smarts.errors import SmartsError

HALVES = (255, 0, 0), (0, 0, 255)


def picture(above, below):
    image = np.zeros((60, 80, 3), np.uint8)
    image[:30], image[30:] = above, below
    return image


@pytest.fixture
def agg():
    before = plt.get_backend()
    plt.switch_backend("agg")
    yield
    plt.switch_backend(before)


@pytest.mark.filterwarnings("ignore:.*non-interactive")
@pytest.mark.usefixtures("agg")
def test_a_window_shows_one_picture_after_another_in_the_same_figure(monkeypatch):
    monkeypatch.setattr(window, "_interactive", lambda: ["Agg"])
    shown = PlotWindow()
    figures = plt.get_fignums()
    for above, below in (HALVES, HALVES[::-1]):
        shown.show(picture(above, below))
        canvas = shown._figure.canvas
        canvas.draw()
        middle = np.asarray(canvas.buffer_rgba())[:, canvas.get_width_height()[0] // 2, :3]
        # The picture keeps its proportions and fills the figure's height or width.
        assert (tuple(middle[len(middle) // 4]), tuple(middle[-len(middle) // 4])) == (above, below)
    assert plt.get_fignums() == figures
    shown.close()
    assert len(plt.get_fignums()) == len(figures) - 1


@pytest.mark.usefixtures("agg")
def test_without_a_display_there_is_no_window():
    with pytest.raises(SmartsError, match="there is no display"):
        PlotWindow()
