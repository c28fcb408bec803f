"""Where `render_mode="human"` shows pictures: in a notebook's output, or in a window."""

from __future__ import annotations

import io
from typing import Any, Protocol

import PIL.Image

from smarts.envision.animation import Image
from smarts.errors import SmartsError


class Window(Protocol):
    """Shows one picture after another in the same place."""

    def show(self, image: Image) -> None:
        """Show a picture in place of the last one."""
        ...

    def close(self) -> None:
        """End."""
        ...


def window(is_notebook: bool) -> Window:
    """Return a place to show pictures at.

    Raises:
        SmartsError: There is neither a notebook nor a display.
    """
    return NotebookOutput() if is_notebook else PlotWindow()


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
        import matplotlib as mpl
        import matplotlib.pyplot as plt

        if mpl.get_backend().lower() not in {name.lower() for name in _interactive()}:
            raise SmartsError(
                f"there is no display: matplotlib draws with {mpl.get_backend()}",
                place='render_mode="human"',
                remedy='give render_mode="rgb_array", or SMARTS_ENVISION and smarts-bench view --live',
            )
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


def _interactive() -> list[str]:
    from matplotlib.backends.registry import BackendFilter, backend_registry

    return backend_registry.list_builtin(BackendFilter.INTERACTIVE)
