"""The table of algorithms: config, settings and tags of each. Imports neither torch nor Ray."""

from __future__ import annotations

from enum import StrEnum
from typing import NamedTuple

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

# One line an algorithm; order: by paradigm, then from plain to elaborate.
ALGORITHMS: dict[str, Entry] = {
    "pg": Entry(
        "algorithms.pg:PGConfig",
        settings.PGSettings,
        _DEC,
        "M1",
        _BOTH,
        "independent policy gradient on whole trajectories",
    ),
    "a2c": Entry(
        "algorithms.a2c:A2CConfig",
        settings.A2CSettings,
        _DEC,
        "M1",
        _BOTH,
        "independent advantage actor-critic",
        recurrent=True,
    ),
    "ppo": Entry(
        "algorithms.ppo:PPOConfig", settings.PPOSettings, _DEC, "M1", _BOTH, "independent PPO", recurrent=True
    ),
    "recurrent_ippo": Entry(
        "algorithms.recurrent_ppo:RecurrentIPPOConfig",
        settings.RecurrentIPPOSettings,
        _DEC,
        "M1",
        _BOTH,
        "independent PPO, memories in policies and critics",
        recurrent=True,
    ),
    "dqn": Entry(
        "algorithms.dqn:DQNConfig",
        settings.DQNSettings,
        _DEC,
        "M1",
        _DISCRETE,
        "independent double duelling Q-learning",
        recurrent=True,
    ),
    "opponent_q": Entry(
        "algorithms.opponent_q:OpponentQConfig",
        settings.OpponentQSettings,
        _DEC,
        "M2",
        _DISCRETE,
        "Q-learning of joint actions, with models of the others",
        least_agents=2,
    ),
    "pr2": Entry(
        "algorithms.pr2:PR2Config",
        settings.PR2Settings,
        _DEC,
        "M2",
        _DISCRETE,
        "Q-learning that expects the others to answer",
        least_agents=2,
    ),
    "rommeo": Entry(
        "algorithms.rommeo:ROMMEOConfig",
        settings.ROMMEOSettings,
        _DEC,
        "M2",
        _DISCRETE,
        "Q-learning with an optimistic model of the others, regularised by what they did",
        least_agents=2,
    ),
    "commnet": Entry(
        "algorithms.commnet:CommNetConfig",
        settings.CommNetSettings,
        _CEN,
        "M3",
        _BOTH,
        "hidden layers broadcast when acting",
        communication=True,
    ),
    "bicnet": Entry(
        "algorithms.bicnet:BiCNetConfig",
        settings.BiCNetSettings,
        _CEN,
        "M3",
        _BOTH,
        "deterministic actor-critic, recurrent over agents",
        communication=True,
    ),
    "mat": Entry(
        "algorithms.mat:MATConfig",
        settings.MATSettings,
        _CEN,
        "M3",
        _BOTH,
        "a transformer acts for all agents, one after another",
        communication=True,
        equal_spaces=True,
    ),
    "centralised_v": Entry(
        "algorithms.centralised_v:CentralisedVConfig",
        settings.CentralisedVSettings,
        _CTDE,
        "M3",
        _BOTH,
        "PPO with a central critic",
        recurrent=True,
    ),
    "coma": Entry(
        "algorithms.coma:COMAConfig",
        settings.COMASettings,
        _CTDE,
        "M3",
        _DISCRETE,
        "policy gradient with counterfactual advantages",
        recurrent=True,
    ),
    "recurrent_mappo": Entry(
        "algorithms.recurrent_ppo:RecurrentMAPPOConfig",
        settings.RecurrentMAPPOSettings,
        _CTDE,
        "M3",
        _BOTH,
        "PPO with a central critic, memories in both",
        recurrent=True,
    ),
    "happo": Entry(
        "algorithms.happo:HAPPOConfig",
        settings.HAPPOSettings,
        _CTDE,
        "M3",
        _BOTH,
        "PPO, agent after agent; no shared networks",
        recurrent=True,
    ),
    "maddpg": Entry(
        "algorithms.maddpg:MADDPGConfig",
        settings.MADDPGSettings,
        _CTDE,
        "M3",
        _BOTH,
        "critics of all agents' actions",
    ),
    "maac": Entry(
        "algorithms.maac:MAACConfig",
        settings.MAACSettings,
        _CTDE,
        "M3",
        _DISCRETE,
        "soft actor-critic, attention in its critic",
    ),
    "mf_q": Entry(
        "algorithms.mf_q:MeanFieldQConfig",
        settings.MeanFieldQSettings,
        _CTDE,
        "M4",
        _DISCRETE,
        "values of the neighbours' mean action",
    ),
    "mf_ac": Entry(
        "algorithms.mf_ac:MeanFieldACConfig",
        settings.MeanFieldACSettings,
        _CTDE,
        "M4",
        _DISCRETE,
        "MF-Q's critic with a policy",
    ),
    "vdn": Entry(
        "algorithms.vdn:VDNConfig",
        settings.VDNSettings,
        _CTDE,
        "M3",
        _DISCRETE,
        "team value as a sum of values",
        recurrent=True,
    ),
    "qmix": Entry(
        "algorithms.qmix:QMIXConfig",
        settings.QMIXSettings,
        _CTDE,
        "M3",
        _DISCRETE,
        "team value as a monotone function of values",
        recurrent=True,
    ),
    "maven": Entry(
        "algorithms.maven:MAVENConfig",
        settings.MAVENSettings,
        _CTDE,
        "M3",
        _DISCRETE,
        "QMIX committed to a latent for each episode",
        recurrent=True,
    ),
    "qtran": Entry(
        "algorithms.qtran:QTRANConfig",
        settings.QTRANSettings,
        _CTDE,
        "M3",
        _DISCRETE,
        "any team value, with a sum that has its optimum",
        recurrent=True,
    ),
    "qdpp": Entry(
        "algorithms.qdpp:QDPPConfig",
        settings.QDPPSettings,
        _CTDE,
        "M3",
        _DISCRETE,
        "team value as a determinant of qualities and diversity",
    ),
    "networked_q": Entry(
        "algorithms.networked_q:NetworkedQConfig",
        settings.NetworkedQSettings,
        _NET,
        "M3",
        _DISCRETE,
        "team value fitted by consensus over a graph",
        communication=True,
    ),
}
