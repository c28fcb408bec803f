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
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch

_HOPING, _PLAIN = ("pr2", "rommeo"), ("opponent_q", "dqn")
"""Agents that expect answers to what they do, and their baselines, that expect none."""

ROOT = Path(__file__).resolve().parents[1]
TESTS = ROOT / "tests" / "unit" / "algorithms"


def games() -> dict[str, Callable[[int], Any]]:
    """Return by name what plays a game with a seed and returns its agents' scores, of mf_ac the worst."""
    sys.path[:0] = [str(ROOT), str(TESTS), str(TESTS / "joint")]
    names = ("games", "pg", "maac", "mean_field", "networked_q", "commnet", "recurrence", "replay_kinds")
    games, pg, maac, field, networked, commnet, recurrence, kinds = (
        importlib.import_module(f"test_{name}") for name in names
    )
    coma, qtran, bicnet, maven = (
        importlib.import_module(f"test_{name}") for name in ("coma", "qtran", "bicnet", "maven")
    )
    happo, memories, mat, opponents = (
        importlib.import_module(f"test_{name}") for name in ("happo", "recurrent_ppo", "mat", "opponents")
    )

    return {
        "pg promise": pg.promise_score,
        **{f"{name} cues": partial(games.cues_score, name) for name in games.CUES},
        "mf_ac cues": field.cues_score,
        "mf_ac cues, entropy_coeff=0.01": partial(field.cues_score, entropy_coeff=0.01),
        "maddpg product": games.product_score,
        "maac product": maac.product_score,
        "mf_q follow": partial(field.follow_score, graph="auto"),
        "networked_q gifts": networked.gifts_score,
        **{f"{name} two steps": partial(games.two_step_score, name) for name in ("qmix", "vdn")},
        **{f"{name} target": partial(games.target_score, name) for name in games.TARGET},
        **{f"{name} recall": partial(recurrence.recalled, name) for name in ("ppo", "centralised_v")},
        **{f"{name} recall": partial(kinds.recalled, name) for name in ("dqn", "vdn", "qmix")},
        "commnet levers": commnet.levers_score,
        **{f"{name} shares": partial(coma.shares_score, name=name) for name in ("coma", "centralised_v")},
        **{f"{name} mirror": partial(bicnet.mirror_score, name=name) for name in ("bicnet", "maddpg")},
        **{f"{name} committed": partial(maven.committed_score, name=name) for name in ("maven", "qmix")},
        "qtran matrix": qtran.matrix_score,
        "qtran matrix, alt": partial(qtran.matrix_score, variant="alt"),
        **{f"{name} matrix": partial(qtran.matrix_score, name=name) for name in ("vdn", "qmix")},
        "qdpp matrix": partial(qtran.matrix_score, name="qdpp", reward_scale=0.1),
        "qdpp matrix, own_share=1": partial(qtran.matrix_score, name="qdpp", reward_scale=0.1, own_share=1.0),
        **{f"{name} yielding": partial(happo.yielding_score, name) for name in ("happo", "ppo")},
        **{f"{name} turncoat": partial(opponents.turncoat_score, name) for name in (*_PLAIN, *_HOPING)},
        **{f"{name} climbing": partial(opponents.climbing_score, name) for name in (*_HOPING, *_PLAIN)},
        **{f"{name} hills": partial(opponents.hills_score, name) for name in (*_HOPING, *_PLAIN)},
        **{f"{name} doors": partial(mat.doors_score, name) for name in ("mat", "ppo", "commnet")},
        **{f"{name} recall": partial(recurrence.recalled, name) for name in memories.BOTH},
        **{f"{name} luck": partial(memories.luck_error, name, gru=16) for name in memories.BOTH},
        **{f"{name} luck": partial(memories.luck_error, name) for name in ("ppo", "centralised_v")},
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
        scores = [float(np.mean(play(seed))) for seed in arguments.seeds]
        each = " ".join(f"{score:7.3f}" for score in scores)
        seconds = (time.process_time() - start) / len(scores)
        print(f"{name:32s} {each}  mean {np.mean(scores):7.3f}  {seconds:4.0f} s CPU each", flush=True)


if __name__ == "__main__":
    main()
