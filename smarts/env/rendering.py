"""`render` of the environments: a picture of the simulation from above."""

from __future__ import annotations

import warnings
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from smarts.env.runner import SimulationRunner
from smarts.errors import SmartsError, nearest_names

if TYPE_CHECKING:
    from smarts.envision.world_picture import WorldPicture

RenderMode = Literal["rgb_array", "human"]
RENDER_MODES = ("rgb_array", "human")
NO_MODE = (
    'nothing is drawn: the environment was made without render_mode; give render_mode="rgb_array", or record '
    "episodes with simulation=Options(record=FOLDER), which smarts-bench render draws"
)


def check_render_mode(mode: str | None) -> None:
    """Check a render mode before anything is built.

    Raises:
        SmartsError: It is unknown, or there is nowhere to show a picture.
    """
    if mode == "human":
        # Imported late, so that environments without a window start fast.
        from smarts.envision.window import check_window

        check_window()
    if mode is not None and mode not in RENDER_MODES:
        raise SmartsError(
            f"the render mode is {mode!r}",
            place="render_mode",
            remedy=nearest_names(str(mode), RENDER_MODES),
        )


class Renderer:
    """Draws the simulation of one environment.

    Args:
        runner: The simulation.
        mode: `"rgb_array"`, `"human"` or None.
    """

    def __init__(self, runner: SimulationRunner, mode: RenderMode | None) -> None:
        self._runner, self.mode = runner, mode
        self.metadata: dict[str, Any] = {
            "render_modes": [*RENDER_MODES],
            "render_fps": max(1, round(1 / (runner.world.dt * runner.period))),
        }
        self._window: Any = None

    @cached_property
    def _picture(self) -> WorldPicture:
        # Only environments that draw wait for matplotlib.
        from smarts.envision.world_picture import WorldPicture

        return WorldPicture(self._runner.scene)

    def image(self) -> NDArray[np.uint8]:
        """Return a picture of the simulation now, shape (600, 800, 3).

        Raises:
            SmartsError: The environment was closed, or never reset.
        """
        self._runner.check_begun()
        start = self._runner.starts[0]
        assert start is not None
        return self._picture.image(0, start, self._runner.bubbles)

    def render(self) -> NDArray[np.uint8] | None:
        """Return a picture (`rgb_array`), or show it and return None (`human`); without a mode, warn.

        Raises:
            SmartsError: The environment was closed or never reset, or there is nowhere to show a picture.
        """
        if self.mode is None:
            warnings.warn(NO_MODE, stacklevel=3)
            return None
        image = self.image()
        if self.mode == "rgb_array":
            return image
        self._show(image)
        return None

    def after_step(self) -> None:
        """Show the simulation if it is to be shown to a human, as Gymnasium wants it after each step."""
        if self.mode == "human":
            self._show(self.image())

    def close(self) -> None:
        """Close the window, if there is one."""
        if self._window is not None:
            self._window.close()
            self._window = None

    def _show(self, image: NDArray[np.uint8]) -> None:
        if self._window is None:
            # Imported late, so that environments without a window start fast.
            from smarts.envision.window import window

            self._window = window()
        self._window.show(image)
