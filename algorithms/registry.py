"""The table of algorithms: where each lives and what kind it is. Imports no framework."""

from __future__ import annotations

from enum import StrEnum
from typing import NamedTuple


class Paradigm(StrEnum):
    """Who knows what, when (section 3 of the SMARTS paper)."""

    DECENTRALISED = "fully decentralised"
    CENTRALISED = "fully centralised"
    CTDE = "centralised training, decentralised execution"
    NETWORKED = "networked agents"


class Actions(StrEnum):
    """Action spaces an algorithm can handle."""

    DISCRETE = "discrete"
    CONTINUOUS = "continuous"
    BOTH = "both"


class Entry(NamedTuple):
    """One algorithm.

    Attributes:
        target: `module:class` of its RLlib config.
        paradigm: Who knows what, when.
        level: Multi-agent intelligence M0-M5 that it can reach, as the paper grades it.
        actions: Action spaces it can handle.
        communication: Whether agents exchange messages when they act.
        recurrent: Whether its policy may carry memory.
        summary: One line for the table.
    """

    target: str
    paradigm: Paradigm
    level: str
    actions: Actions
    communication: bool
    recurrent: bool
    summary: str

    def acts_in(self, kind: Actions) -> bool:
        """Return whether the algorithm can handle a space of this kind."""
        return self.actions in (kind, Actions.BOTH)


def _entry(
    target: str,
    paradigm: Paradigm,
    level: str,
    actions: Actions,
    summary: str,
    *,
    communication: bool = False,
    recurrent: bool = False,
) -> Entry:
    return Entry(f"algorithms.{target}", paradigm, level, actions, communication, recurrent, summary)


_D, _F, _C, _N = Paradigm.DECENTRALISED, Paradigm.CENTRALISED, Paradigm.CTDE, Paradigm.NETWORKED

# One line an algorithm; order: by paradigm, then from plain to elaborate.
ALGORITHMS: dict[str, Entry] = {
    "pg": _entry("pg:PGConfig", _D, "M1", Actions.BOTH, "independent policy gradient on whole lives"),
    "a2c": _entry(
        "a2c:A2CConfig", _D, "M1", Actions.BOTH, "independent advantage actor-critic", recurrent=True
    ),
    "ppo": _entry("ppo:PPOConfig", _D, "M1", Actions.BOTH, "independent PPO", recurrent=True),
    "dqn": _entry(
        "dqn:DQNConfig", _D, "M1", Actions.DISCRETE, "independent double duelling Q-learning", recurrent=True
    ),
    "commnet": _entry(
        "commnet:CommNetConfig",
        _F,
        "M3",
        Actions.BOTH,
        "hidden layers broadcast when acting",
        communication=True,
    ),
    "centralised_v": _entry(
        "centralised_v:CentralisedVConfig",
        _C,
        "M3",
        Actions.BOTH,
        "PPO with a central critic",
        recurrent=True,
    ),
    "maddpg": _entry("maddpg:MADDPGConfig", _C, "M3", Actions.BOTH, "critics that see everybody's actions"),
    "maac": _entry(
        "maac:MAACConfig", _C, "M3", Actions.DISCRETE, "soft actor-critic, attention in its critic"
    ),
    "mf_q": _entry(
        "mf_q:MeanFieldQConfig", _C, "M4", Actions.DISCRETE, "values of the neighbours' mean action"
    ),
    "mf_ac": _entry("mf_ac:MeanFieldACConfig", _C, "M4", Actions.DISCRETE, "MF-Q's critic with a policy"),
    "vdn": _entry(
        "vdn:VDNConfig", _C, "M3", Actions.DISCRETE, "team value as a sum of values", recurrent=True
    ),
    "qmix": _entry(
        "qmix:QMIXConfig",
        _C,
        "M3",
        Actions.DISCRETE,
        "team value as a monotone function of values",
        recurrent=True,
    ),
    "networked_q": _entry(
        "networked_q:NetworkedQConfig",
        _N,
        "M3",
        Actions.DISCRETE,
        "team value fitted by consensus over a graph",
        communication=True,
    ),
}
