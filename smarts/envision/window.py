"""Where `render_mode="human"` shows pictures: in a notebook's output, or in a window."""

from __future__ import annotations

import io
import sys
from typing import Any

import PIL.Image

from smarts.envision.animation import Image
from smarts.errors import SmartsError


def window() -> NotebookOutput | PlotWindow:
    """Return a place to show pictures at.

    Raises:
        SmartsError: There is neither a notebook nor a display.
    """
    return NotebookOutput() if in_notebook() else PlotWindow()


def check_window() -> None:
    """Raise if there is no place to show pictures at.

    Raises:
        SmartsError: There is neither a notebook nor a display.
    """
    if not in_notebook():
        _check_display()


def in_notebook() -> bool:
    """Return whether this is a notebook's process; a script may import what belongs to one."""
    module = sys.modules.get("IPython")
    shell = None if module is None else module.get_ipython()
    return hasattr(shell, "kernel")


class NotebookOutput:
    """The output of a notebook's cell."""

    def __init__(self) -> None:
        self._handle: Any = None

    def show(self, image: Image) -> None:
        """Show a picture in place of the last one."""
        from IPython.display import Image as Shown  # pyright: ignore[reportMissingImports]
        from IPython.display import display  # pyright: ignore[reportMissingImports]

        data = io.BytesIO()
        PIL.Image.fromarray(image).save(data, "png")
        shown = Shown(data.getvalue())
        if self._handle is None:
            self._handle = display(shown, display_id=True)
        else:
            self._handle.update(shown)

    def close(self) -> None:
        """Leave the last picture where it is."""
        self._handle = None


class PlotWindow:
    """A window of matplotlib.

    Raises:
        SmartsError: There is no display.
    """

    def __init__(self) -> None:
        import matplotlib.pyplot as plt

        _check_display()
        self._plots = plt
        self._figure = plt.figure()
        self._axes = self._figure.add_axes((0.0, 0.0, 1.0, 1.0))
        self._axes.set_axis_off()
        self._picture: Any = None

    def show(self, image: Image) -> None:
        """Show a picture in place of the last one."""
        if self._picture is None:
            self._picture = self._axes.imshow(image)
        else:
            self._picture.set_data(image)
        self._figure.canvas.draw_idle()
        self._plots.pause(0.001)

    def close(self) -> None:
        """Close the window."""
        self._plots.close(self._figure)


def _check_display() -> None:
    import matplotlib.pyplot as plt

    if plt.get_backend().lower() not in {name.lower() for name in _interactive()}:
        raise SmartsError(
            f"there is no display: matplotlib draws with {plt.get_backend()}",
            place='render_mode="human"',
            remedy='give render_mode="rgb_array", or envision=True and run smarts-bench view --live',
        )


def _interactive() -> list[str]:
    from matplotlib.backends.registry import BackendFilter, backend_registry

    return backend_registry.list_builtin(BackendFilter.INTERACTIVE)
