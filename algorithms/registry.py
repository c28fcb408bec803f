"""The table of algorithms: config, settings and tags of each. Imports neither torch nor Ray."""

from __future__ import annotations

from enum import StrEnum
from typing import Any, NamedTuple

from algorithms import settings
from algorithms.settings import JointSettings


class Paradigm(StrEnum):
    """What agents know in training and when they act (section 3 of the SMARTS paper)."""

    DECENTRALISED = "fully decentralised"
    CENTRALISED = "fully centralised"
    CTDE = "centralised training, decentralised execution"
    NETWORKED = "networked agents"


class ActionKind(StrEnum):
    """Action spaces an algorithm can handle."""

    DISCRETE = "discrete"
    CONTINUOUS = "continuous"
    BOTH = "both"


class Entry(NamedTuple):
    """One algorithm.

    Attributes:
        target: `module:class` of its RLlib config.
        settings: What it can be set to.
        paradigm: What its agents know in training and when they act.
        level: Multi-agent intelligence M0-M5 that it can reach, as the paper grades it.
        actions: Action spaces it can handle.
        summary: One line for the table.
        communication: Whether agents exchange messages when they act.
        recurrent: Whether its policy may carry memory.
        least_agents: Fewest agents that it can learn with.
        equal_spaces: Whether all agents must have the same spaces.
    """

    target: str
    settings: type[JointSettings]
    paradigm: Paradigm
    level: str
    actions: ActionKind
    summary: str = ""
    communication: bool = False
    recurrent: bool = False
    least_agents: int = 1
    equal_spaces: bool = False

    def acts_in(self, kind: ActionKind) -> bool:
        """Return whether the algorithm can handle a space of this kind."""
        return self.actions in (kind, ActionKind.BOTH)


_DEC, _CEN, _CTDE, _NET = Paradigm.DECENTRALISED, Paradigm.CENTRALISED, Paradigm.CTDE, Paradigm.NETWORKED
_DISCRETE, _BOTH = ActionKind.DISCRETE, ActionKind.BOTH


def _entry(place: str, *tags: Any, **more: Any) -> Entry:
    """Return the entry of `file:Stem`: the config `StemConfig` in the file, and `StemSettings`."""
    return Entry(
        f"algorithms.{place}Config", getattr(settings, f"{place.partition(':')[2]}Settings"), *tags, **more
    )


# One line an algorithm; order: by paradigm, then from plain to elaborate.
ALGORITHMS: dict[str, Entry] = {
    "bc": _entry("bc:BC", _DEC, "M1", _BOTH, "behavioural cloning of demonstrations"),
    "pg": _entry("pg:PG", _DEC, "M1", _BOTH, "independent policy gradient on whole trajectories"),
    "a2c": _entry("a2c:A2C", _DEC, "M1", _BOTH, "independent advantage actor-critic", recurrent=True),
    "ppo": _entry("ppo:PPO", _DEC, "M1", _BOTH, "independent PPO", recurrent=True),
    "recurrent_ippo": _entry(
        "recurrent_ppo:RecurrentIPPO",
        _DEC,
        "M1",
        _BOTH,
        "independent PPO, memories in policies and critics",
        recurrent=True,
    ),
    "dqn": _entry("dqn:DQN", _DEC, "M1", _DISCRETE, "independent double duelling Q-learning", recurrent=True),
    "opponent_q": _entry(
        "opponent_q:OpponentQ",
        _DEC,
        "M2",
        _DISCRETE,
        "Q-learning of joint actions, with models of the others",
        least_agents=2,
    ),
    "pr2": _entry(
        "pr2:PR2", _DEC, "M2", _DISCRETE, "Q-learning that expects the others to answer", least_agents=2
    ),
    "rommeo": _entry(
        "rommeo:ROMMEO",
        _DEC,
        "M2",
        _DISCRETE,
        "Q-learning with an optimistic model of the others, regularised by what they did",
        least_agents=2,
    ),
    "commnet": _entry(
        "commnet:CommNet", _CEN, "M3", _BOTH, "hidden layers broadcast when acting", communication=True
    ),
    "bicnet": _entry(
        "bicnet:BiCNet",
        _CEN,
        "M3",
        _BOTH,
        "deterministic actor-critic, recurrent over agents",
        communication=True,
    ),
    "mat": _entry(
        "mat:MAT",
        _CEN,
        "M3",
        _BOTH,
        "a transformer acts for all agents, one after another",
        communication=True,
        equal_spaces=True,
    ),
    "centralised_v": _entry(
        "centralised_v:CentralisedV", _CTDE, "M3", _BOTH, "PPO with a central critic", recurrent=True
    ),
    "coma": _entry(
        "coma:COMA", _CTDE, "M3", _DISCRETE, "policy gradient with counterfactual advantages", recurrent=True
    ),
    "recurrent_mappo": _entry(
        "recurrent_ppo:RecurrentMAPPO",
        _CTDE,
        "M3",
        _BOTH,
        "PPO with a central critic, memories in both",
        recurrent=True,
    ),
    "happo": _entry(
        "happo:HAPPO", _CTDE, "M3", _BOTH, "PPO, agent after agent; no shared networks", recurrent=True
    ),
    "maddpg": _entry("maddpg:MADDPG", _CTDE, "M3", _BOTH, "critics of all agents' actions"),
    "maac": _entry("maac:MAAC", _CTDE, "M3", _DISCRETE, "soft actor-critic, attention in its critic"),
    "mf_q": _entry("mf_q:MeanFieldQ", _CTDE, "M4", _DISCRETE, "values of the neighbours' mean action"),
    "mf_ac": _entry("mf_ac:MeanFieldAC", _CTDE, "M4", _DISCRETE, "MF-Q's critic with a policy"),
    "vdn": _entry("vdn:VDN", _CTDE, "M3", _DISCRETE, "team value as a sum of values", recurrent=True),
    "qmix": _entry(
        "qmix:QMIX", _CTDE, "M3", _DISCRETE, "team value as a monotone function of values", recurrent=True
    ),
    "maven": _entry(
        "maven:MAVEN", _CTDE, "M3", _DISCRETE, "QMIX committed to a latent for each episode", recurrent=True
    ),
    "qtran": _entry(
        "qtran:QTRAN",
        _CTDE,
        "M3",
        _DISCRETE,
        "any team value, with a sum that has its optimum",
        recurrent=True,
    ),
    "qdpp": _entry(
        "qdpp:QDPP", _CTDE, "M3", _DISCRETE, "team value as a determinant of qualities and diversity"
    ),
    "networked_q": _entry(
        "networked_q:NetworkedQ",
        _NET,
        "M3",
        _DISCRETE,
        "team value fitted by consensus over a graph",
        communication=True,
    ),
}
