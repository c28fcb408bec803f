"""Scripted policies: what is reached without learning.

A scripted policy has the observations and actions of learned ones. Those of this package read at most the
vector of observation "benchmark" and its action mask, and act by the four lane actions.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol

from smarts.registry import Registry

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from smarts.types.episode import EpisodeStart


class ScriptedPolicy(Protocol):
    """Acts for one agent. The class is called without arguments, once for each agent.

    A class with an attribute `observation` gets that observation, whatever that of the experiment is: a name
    of `observations.yaml`, or a list or dict of features.
    """

    def begin(self, episode: EpisodeStart, agent: int) -> None:
        """Begin an episode. Random draws must be a function of the episode and the agent's number."""
        ...

    def act(self, observation: NDArray[np.float32], mask: NDArray[np.bool_]) -> int:
        """Return an action of the action space; of lane actions an allowed one, 0 to 3.

        Args:
            observation: The agent's: the vector "benchmark", or a dict of arrays by name if there are
                several.
            mask: Allowed lane actions, shape (4,); all True with other action spaces.
        """
        ...


def _adopt(name: str, found: Any) -> Any:
    """Return a user's class after a check that it is a `ScriptedPolicy`."""
    if not isinstance(found, type):
        raise ValueError(f"is {found!r}, no class")
    for method in ("begin", "act"):
        if not callable(getattr(found, method, None)):
            raise ValueError(
                f"has no method {method!r}: see ScriptedPolicy in benchmark/scripted/__init__.py"
            )
    found()
    return found


SCRIPTED_POLICIES = Registry(
    "scripted policy",
    {
        "keep_lane": "benchmark.scripted.simple:KeepLane",
        "parked": "benchmark.scripted.simple:Parked",
        "random": "benchmark.scripted.simple:RandomActions",
        "gap_acceptance": "benchmark.scripted.gap_acceptance:GapAcceptancePolicy",
        "empty_road": "benchmark.scripted.gap_acceptance:EmptyRoad",
        "creep": "benchmark.scripted.gap_acceptance:Creep",
    },
    _adopt,
)
"""Name -> "module:Class" of a `ScriptedPolicy`; a user's own is named in this way too."""
