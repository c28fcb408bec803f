"""Compares what a submission claims with what its episodes gave, and its public test with fresh episodes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
import pandas as pd

from benchmark.metrics.results import Frame
from benchmark.results.release import Entry
from benchmark.statistics import holm

Digests = Mapping[str, Sequence[str]]

TOLERATED = 0.01
"""Share of a policy's episodes that may differ from those claimed: it was tested in 32 bits and is played in
64, so that once in a while another of two nearly equal actions is chosen."""
ROUNDED = 1e-5
"""Scores of equal episodes differ by less."""
MOST_P = 0.01
"""Chance that one policy of an honest submission is found to know the test."""
RESAMPLES = 100_000


def compared_digests(entry: Entry, played: Digests) -> tuple[int, int]:
    """Return how many claimed digests are those of the episodes, and how many were compared.

    A digest is of one episode's index, too, so the order does not matter: an episode that could not be
    measured, on either side, is one that differs, and not all behind it.

    Args:
        entry: Entry whose claims are compared.
        played: Scenario -> digest of each episode; see `episode_digests`.
    """
    pairs = [(derived, entry.episodes.get(scenario, ())) for scenario, derived in played.items()]
    equal = sum(len({*derived} & {*claimed}) for derived, claimed in pairs)
    return equal, sum(min(len(derived), len(claimed)) for derived, claimed in pairs)


def differences(entry: Entry, scores: Mapping[str, float], digests: Digests) -> Iterator[str]:
    """Yield in what an entry's claims are not what its episodes gave.

    Args:
        entry: Entry whose claims are compared.
        scores: Scores of the test.
        digests: Scenario -> digest of each episode; see `episode_digests`.
    """
    if not entry.episodes:
        yield "claims no episodes"
        return
    equal, compared = compared_digests(entry, digests)
    differing = compared - equal
    tolerated = compared and differing <= TOLERATED * compared
    if not tolerated:
        yield f"other episodes than claimed: {differing} of {compared} digests differ"
    foreign = [name for name in entry.episodes if name.partition("@")[0] not in entry.scenarios]
    if foreign:
        yield f"claims episodes of {', '.join(foreign)}, which it does not play"
    claimed, played = (
        sum(len(each) for name, each in given.items() if "@" not in name)
        for given in (entry.episodes, digests)
    )
    if claimed != played:
        yield f"claims {claimed} test episodes, {played} were played: its scores are not compared"
        return
    # All agents of the differing episodes may have ended otherwise.
    most = ROUNDED + (differing / compared if tolerated else 0.0)
    for name, value in entry.scores.items():
        if name not in scores:
            yield f"claims {name} {value:.3f}, which its episodes do not give"
        elif abs(value - scores[name]) > most:
            yield f"claims {name} {value:.3f}; its episodes give {scores[name]:.3f}"


def memorized(cells: Mapping[str, Sequence[tuple[Frame, Frame]]]) -> dict[str, list[str]]:
    """Return by cell the rates that are better in the public test than in fresh episodes.

    There is a test for each cell and rate. All policies of a cell play the same public and the same fresh
    episodes, some of which are easier than others, so the unit is an episode, with the mean over the
    policies. P-values are corrected after Holm over all cells and rates.

    Args:
        cells: Cell -> tables of the public test and of the fresh episodes of each of its policies.
    """
    tests = [
        (cell, label, *(_by_episode([pair[part] for pair in pairs], outcome) for part in (0, 1)), sign)
        for cell, pairs in cells.items()
        for label, outcome, sign in (("completion", "goal", 1.0), ("collision", "collision", -1.0))
    ]
    p_values = holm([p_value(sign * public, sign * fresh) for _, _, public, fresh, sign in tests])
    found: dict[str, list[str]] = {}
    for (cell, label, public, fresh, _), corrected in zip(tests, p_values, strict=True):
        if corrected < MOST_P:
            found.setdefault(cell, []).append(
                f"{label} rate {public.mean():.3f} in the public test, {fresh.mean():.3f} in fresh episodes "
                f"(corrected p < {MOST_P:g}): it knows the test"
            )
    return found


def _by_episode(tables: Sequence[Frame], outcome: str) -> np.ndarray:
    """Return the share of each valid episode's agents that ended in a way: the mean over tables."""
    shares = []
    for table in tables:
        rows = table[(table["split"] == "train") & ~table["is_invalid"] & (table["agents"] > 0)]
        shares.append((rows["outcome"] == outcome).groupby([rows["scenario"], rows["world"]]).mean())
    return np.asarray(pd.concat(shares).groupby(level=[0, 1]).mean(), float)


def p_value(larger: np.ndarray, smaller: np.ndarray) -> float:
    """Return the one-sided p-value of a permutation test of means; 1 where there is nothing to compare."""
    if not len(larger) or not len(smaller) or larger.mean() <= smaller.mean():
        return 1.0
    both = np.round(np.concatenate([larger, smaller]), 9)
    values, counts = np.unique(both, return_counts=True)
    rng = np.random.Generator(np.random.Philox(0))
    drawn = rng.multivariate_hypergeometric(counts, len(larger), size=RESAMPLES) @ values
    reached = int((drawn >= both[: len(larger)].sum() - 1e-6).sum())
    return (1 + reached) / (RESAMPLES + 1)
