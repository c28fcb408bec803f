"""The settings of all algorithms: a class for each, in which a field says type, default, range and meaning.

RLlib's configs take their defaults and checks from here, experiment files their errors and their schema, and
`smarts-bench settings NAME` its table. The package imports neither torch nor Ray.
"""

# ruff: noqa: F401 - names for users
from algorithms.settings.base import (
    ActorCriticSettings,
    EpsilonGreedySettings,
    JointSettings,
    OffPolicySettings,
    OnPolicySettings,
    ReplaySettings,
)
from algorithms.settings.faults import SettingFault, faults
from algorithms.settings.kinds import (
    Count,
    FirstAndLast,
    Fraction,
    Graph,
    Near,
    NotNegative,
    Number,
    Positive,
    ScheduledFraction,
    ScheduledWeight,
    Sharing,
    SomeWidths,
    Widths,
)
from algorithms.settings.off_policy import (
    BiCNetSettings,
    DQNSettings,
    MAACSettings,
    MADDPGSettings,
    MAVENSettings,
    MeanFieldACSettings,
    MeanFieldQSettings,
    MeanFieldSettings,
    NetworkedQSettings,
    OpponentQSettings,
    PR2Settings,
    QDPPSettings,
    QMIXSettings,
    QTRANSettings,
    ROMMEOSettings,
    VDNSettings,
)
from algorithms.settings.on_policy import (
    A2CSettings,
    CentralisedVSettings,
    COMASettings,
    CommNetSettings,
    HAPPOSettings,
    MATSettings,
    PGSettings,
    PPOSettings,
    RecurrentIPPOSettings,
    RecurrentMAPPOSettings,
)
