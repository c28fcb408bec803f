"""What the loop around the step is made of, and what may watch it: the least that they have to offer."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from smarts.roads.scene import Scene
from smarts.sim.simulation import Simulation
from smarts.types.actions import Actions
from smarts.types.episode import EpisodeStart
from smarts.types.frame import Frame

Bools = NDArray[np.bool_]
Ints = NDArray[np.int32]


class Schedule(Protocol):
    """What `smarts.sim.schedule` gives: which episode comes when."""

    def start(self, world: int, episode: int, seed: int | None = None) -> EpisodeStart:
        """Return an episode, a function of the arguments alone."""
        ...


class EpisodeAnnotator(Protocol):
    """What `smarts.sim.recorder.EpisodeRecorder` offers to those who have something to say."""

    def annotate(self, name: str, values: ArrayLike, agent_ids: Bools, step: Ints | None = None) -> None:
        """Add to the record what is said about decisions, by default about those on the present state."""
        ...

    def finish(self, env_mask: Bools) -> None:
        """Have the episodes of some simulations written."""
        ...


class Parts(Protocol):
    """What `smarts.sim.assembly.Assembly` holds."""

    @property
    def simulation(self) -> Simulation:
        """The step."""
        ...

    @property
    def schedule(self) -> Schedule:
        """Which episode comes when."""
        ...

    @property
    def scene(self) -> Scene:
        """What the stages work in."""
        ...

    @property
    def actions(self) -> Actions:
        """What agents have asked for, written in place."""
        ...

    @property
    def recorder(self) -> EpisodeAnnotator | None:
        """Where to note what is said about decisions, if episodes are recorded."""
        ...


class StepListener(Protocol):
    """What an environment lets see every step: an `ArrayAdapter`, or what makes objects for users."""

    def collect(self, frame: Frame, is_last: bool) -> object:
        """See one step of a decision, or a reset; `is_last` if the decision ends with it."""
        ...

    def reset(self, egos: Bools) -> None:
        """Forget what is remembered of these egos, shape (B, N)."""
        ...
