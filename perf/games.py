"""Scores of the algorithms on the small games of their tests: three seeds and their mean.

    python perf/games.py [--games pg dqn ...] [--seeds 1 2 3]

The games, recipes and scores are those of the slow tests below `tests/unit/algorithms/`, which only ask for a
line that they must pass.
"""

from __future__ import annotations

import argparse
import importlib
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import torch

ROOT = Path(__file__).resolve().parents[1]
TESTS = ROOT / "tests" / "unit" / "algorithms"


def games() -> dict[str, Callable[[int], float]]:
    """Return by name what plays a game with a seed and returns its agents' mean score, of mf_ac the worst."""
    sys.path[:0] = [str(ROOT), str(TESTS), str(TESTS / "joint")]
    names = ("games", "pg", "maac", "mean_field", "networked_q", "commnet", "recurrence", "replay_kinds")
    games, pg, maac, field, networked, commnet, recurrence, kinds = (
        importlib.import_module(f"test_{name}") for name in names
    )
    rules = importlib.import_module("tests.games.games")

    def of_steps(name: str, game: str, steps: int, **settings) -> Callable[[int], float]:
        return lambda seed: games.score(name, getattr(rules, game), steps, seed, **settings).mean()

    explore = {"epsilon": (1.0, 1.0), "gamma": 0.99, "lr": 2e-3}
    unfolded = {"gru": 16, "sequence_length": 16}
    cues = {"ppo": 6_000, "a2c": 12_000, "dqn": 4_000, "centralised_v": 6_000}
    return {
        "pg promise": lambda seed: pg.promise_score(seed, cut=False),
        **{f"{name} cues": of_steps(name, "Cues", steps, gamma=0.5) for name, steps in cues.items()},
        "mf_ac cues": field.cues_score,
        "mf_ac cues, entropy_coeff=0.01": lambda seed: field.cues_score(seed, entropy_coeff=0.01),
        "maddpg product": of_steps("maddpg", "Product", 4_000, gamma=0.5),
        "maac product": lambda seed: maac.score(rules.Product, 4_000, seed).mean(),
        "mf_q follow": lambda seed: field.follow_score(seed, "auto"),
        "networked_q gifts": networked.gifts_score,
        "qmix two steps": lambda seed: 4 * of_steps("qmix", "TwoStep", 3_000, **explore)(seed),
        "vdn two steps": lambda seed: 4 * of_steps("vdn", "TwoStep", 3_000, **explore)(seed),
        "ppo target": of_steps("ppo", "Target", 16_000, gamma=0.5),
        "maddpg target": of_steps("maddpg", "Target", 4_000, gamma=0.5),
        **{
            f"{name} recall": lambda seed, name=name: recurrence.recalled(name, seed, 50, **unfolded)
            for name in ("ppo", "centralised_v")
        },
        **{
            f"{name} recall": lambda seed, name=name: kinds.recalled(
                name, seed, 6_000, gru=16, sequence_length=8
            )
            for name in ("dqn", "vdn", "qmix")
        },
        "commnet levers": lambda seed: commnet.levers_score(seed, 500),
    }


def main() -> None:
    """Play and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--games", nargs="+", default=[""], help="beginnings of names, as `ppo` or `'mf_ac cues'`"
    )
    parser.add_argument("--seeds", type=int, nargs="+", default=[1, 2, 3])
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    for name, play in games().items():
        if not name.startswith(tuple(arguments.games)):
            continue
        start = time.process_time()
        scores = [float(play(seed)) for seed in arguments.seeds]
        each = " ".join(f"{score:7.3f}" for score in scores)
        seconds = (time.process_time() - start) / len(scores)
        print(f"{name:32s} {each}  mean {np.mean(scores):7.3f}  {seconds:4.0f} s CPU each", flush=True)


if __name__ == "__main__":
    main()
