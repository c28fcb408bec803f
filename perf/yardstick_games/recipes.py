"""The games, how their scores are read, and the settings that each algorithm is trained with."""

from __future__ import annotations

from typing import Any, NamedTuple

from smarts.registry import load_own


class Yardstick(NamedTuple):
    """One game.

    Attributes:
        target: `module:class` of the vector environment.
        steps: Environment steps of a full training.
        measure: What the score is.
        scale: Factor on an episode's return, summed over agents.
        offset: Added to it.
    """

    target: str
    steps: int
    measure: str
    scale: float = 1.0
    offset: float = 0.0

    def score(self, total: float) -> float:
        """Return the score of an episode's return, summed over agents."""
        return self.scale * total + self.offset

    def make(self, num_envs: int, *, limit_ends: bool = False) -> Any:
        """Return copies of the game; `limit_ends`: its time limit is a termination."""
        game = load_own(self.target, "game")(num_envs)
        game.limit_ends = limit_ends
        return game


class Recipe(NamedTuple):
    """How an algorithm is trained.

    Attributes:
        fragment: Steps of each copy between two updates.
        settings: The algorithm's settings that differ from its defaults.
        num_envs: Copies of the game.
        limit_ends: Whether the game's time limit is a termination.
    """

    fragment: int
    settings: dict[str, Any]
    num_envs: int = 64
    limit_ends: bool = False


YARDSTICKS = {
    "foraging": Yardstick(
        "perf.yardstick_games.foraging:Foraging",
        2_000_000,
        "share of the food loaded, Foraging-8x8-2p-2f-coop-v3 (1 is best)",
    ),
    "spread": Yardstick(
        "perf.yardstick_games.spread:Spread",
        2_000_000,
        "return in the publication's units: 2 x - 75, x the sum of simple_spread_v3's rewards over agents",
        scale=2.0,
        offset=-75.0,
    ),
    "matrices": Yardstick(
        "perf.yardstick_games.matrices:Matrices",
        50_000,
        "payoff in 16 random 5 x 5 matrices of two agents, scaled: 1 the best joint action of each, 0 random",
    ),
}
"""Games by name."""

AS_PUBLISHED = "as_published"
"""Ends the names of recipes with the publication's choices."""
# Algorithms by how they are trained.
_EPSILON_GREEDY = (
    *("dqn", "vdn", "qmix", "qtran", "networked_q"),
    *("opponent_q", "pr2", "rommeo", "maven"),
)
_TEAM_VALUES = ("vdn", "qmix", "qtran", "maven")
_RECURRENT = ("recurrent_ippo", "recurrent_mappo")
_ON_POLICY = ("ppo", "centralised_v", "happo", "mat", *_RECURRENT)
_ONE_PASS = ("pg", "a2c", "commnet")
_REPLAY = ("maddpg", "maac", "mf_q", "mf_ac", "bicnet", "qdpp")

_VALUES = {"sharing": "all", "hidden": (64, 64), "lr": 1e-3, "batch_size": 256, "updates_per_step": 1 / 32}
_FORAGING = {**_VALUES, "reward_scale": 10.0, "epsilon_steps": 200_000}
_POLICIES = {"sharing": "all", "hidden": (64, 64), "lr": 1e-3, "minibatch_size": 800}
_SPREAD = {**_VALUES, "gamma": 0.95, "epsilon_steps": 200_000, "reward_scale": 0.2}
_STANDARDIZED = {**_SPREAD, "reward_scale": 1.0, "standardize_rewards": True}
_AS_PUBLISHED = Recipe(8, _STANDARDIZED, limit_ends=True)
"""As EPyMARL plays: rewards are standardised, and the time limit is a termination."""
_FORAGING_AS_PUBLISHED = Recipe(
    8, {**_FORAGING, "reward_scale": 1.0, "standardize_rewards": True}, limit_ends=True
)
_MATRIX = {"hidden": (64, 64), "lr": 1e-3, "epsilon": (1.0, 0.2), "epsilon_steps": 40_000}
_MATRIX_POLICIES = {"hidden": (64, 64), "lr": 3e-3, "minibatch_size": None, "epochs": 4}


def _of_all(values: dict[str, Any], policies: dict[str, Any]) -> dict[str, Recipe]:
    """Return recipes of all algorithms, with settings of values and of policies; none of them is tuned."""
    replay = {name: value for name, value in values.items() if name != "epsilon_steps"}
    one_pass = {name: value for name, value in policies.items() if name != "minibatch_size"}
    return {
        **{name: Recipe(8, values) for name in _EPSILON_GREEDY},
        **{name: Recipe(8, replay) for name in _REPLAY},
        **{name: Recipe(50, policies) for name in _ON_POLICY},
        **{name: Recipe(50, {**policies, "sequence_length": 10}) for name in _RECURRENT},
        **{name: Recipe(5, one_pass) for name in (*_ONE_PASS, "coma")},
        "happo": Recipe(50, {**policies, "sharing": "none"}),
        "networked_q": Recipe(8, {**values, "sharing": "none"}),
    }


RECIPES: dict[str, dict[str, Recipe]] = {
    "foraging": {
        **_of_all({**_FORAGING, "reward_scale": 40.0}, _POLICIES),
        "vdn": Recipe(8, _FORAGING),
        "qmix-gru": Recipe(8, {**_FORAGING, "gru": 64, "sequence_length": 8}),
        f"qmix-{AS_PUBLISHED}": _FORAGING_AS_PUBLISHED,
        "ppo": Recipe(50, {**_POLICIES, "normalize_values": True}),
        "ppo-gru": Recipe(50, {**_POLICIES, "normalize_values": True, "gru": 64, "sequence_length": 10}),
    },
    "spread": {
        **_of_all(_SPREAD, {**_POLICIES, "gamma": 0.95}),
        "ppo": Recipe(50, {**_POLICIES, "gamma": 0.95, "normalize_values": True}),
        "maddpg": Recipe(
            8,
            {
                "sharing": "all",
                "gamma": 0.95,
                "batch_size": 512,
                "updates_per_step": 1 / 64,
                "hidden": (64, 64),
            },
        ),
        **{f"{name}-{AS_PUBLISHED}": _AS_PUBLISHED for name in _TEAM_VALUES},
    },
    "matrices": {
        **{name: Recipe(8, _MATRIX) for name in _EPSILON_GREEDY},
        **{name: Recipe(16, _MATRIX_POLICIES) for name in _ON_POLICY},
        **{name: Recipe(16, {**_MATRIX_POLICIES, "epochs": 1}) for name in _ONE_PASS},
        **{name: Recipe(8, {"hidden": (64, 64)}) for name in (*_REPLAY, "coma")},
    },
}
"""Settings by game and algorithm; "ppo-gru" is a variant of "ppo", and so on."""
