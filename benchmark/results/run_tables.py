"""The table of a run's test, with checks that it is whole and of this run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from pandas.api.types import is_bool_dtype, is_numeric_dtype

from benchmark.experiment.runs import SCRIPTED, SCRIPTED_SEED
from benchmark.metrics import METRICS, read_table
from benchmark.metrics.results import Frame
from benchmark.metrics.table import COUNTS, EPISODE_KEYS, START
from benchmark.results.files import ResultsError

LABELS = {
    *("algorithm", "training_seed", "task", "task_traffic", "mode", "split", "agent", "is_invalid", "agents"),
    *EPISODE_KEYS,
    *START,
}
"""Columns that every table of a run has."""
RATES = ("completion_rate", "collision_rate")
"""Metrics that every table has, with a number for each agent that took part. Columns of other metrics may be
absent or lack numbers: the metric is n/a then."""

Names = tuple[str, str, str, int]
"""Of a run: algorithm or policy, task, traffic, training seed."""


def names_of(folder: Path) -> Names | None:
    """Return the names of the run in a folder, by the end of its path; None if it is not a run's."""
    kind, second, third, last = folder.parts[-4:] if len(folder.parts) >= 4 else [""] * 4
    if kind == SCRIPTED:
        return second, third, last, SCRIPTED_SEED
    if last.startswith("seed_") and last[5:].isdecimal():
        return kind, second, third, int(last[5:])
    return None


def read_run_table(
    file: Path, names: Names | None, tested: Mapping[str, Any] | None, config: Mapping[str, Any]
) -> Frame:
    """Return the table of a run's test.

    Args:
        file: Its path.
        names: Of the run; None: any.
        tested: As in run.json; None if unknown.
        config: As in config.yaml.

    Raises:
        RecordError: It cannot be read.
        ResultsError: It is of another run, test or version, or holds invalid numbers.
    """
    table = read_table(file)
    _check_columns(table)
    _check_rows(table)
    if names is not None:
        _check_names(table, names)
    if tested is not None:
        _check_extent(table, tested, config)
    return table


def _check_columns(table: Frame) -> None:
    absent = sorted(LABELS - set(table.columns))
    if absent:
        raise ResultsError(f"not a run's table: it has no column '{absent[0]}'")
    absent = [name for name in _of_rates() if name not in table.columns]
    if absent:
        raise ResultsError(f"of another version: it has no column '{absent[0]}'")
    if not is_bool_dtype(table["is_invalid"]):
        raise ResultsError("damaged: its column 'is_invalid' is not of truth values")
    for name in [*START, *_measured(table)]:
        if not is_numeric_dtype(table[name]):
            raise ResultsError(f"damaged: its column '{name}' is not of numbers")


def _of_rates() -> list[str]:
    return [name for rate in RATES for name in METRICS[rate].columns]


def _measured(table: Frame) -> list[str]:
    """Return the columns of metrics that a table has."""
    needed = dict.fromkeys(name for metric in METRICS for name in METRICS[metric].needs)
    return [name for name in needed if name in table.columns]


def _check_rows(table: Frame) -> None:
    if not len(table):
        raise ResultsError("it holds no episodes")
    keys = ["mode", "split", *EPISODE_KEYS, "agent"]
    repeated = int(table.duplicated(keys).sum())
    if repeated:
        raise ResultsError(f"damaged: {repeated} of its {len(table)} agent-episodes are repeated")
    if not table["agents"].isin([0.0, 1.0]).all():
        raise ResultsError("damaged: its column 'agents' is not of 0 and 1")
    took_part = table[~table["is_invalid"] & (table["agents"] > 0)]
    for name in _of_rates():
        bad = int((~np.isfinite(took_part[name].to_numpy(float))).sum())
        if bad:
            raise ResultsError(f"damaged: '{name}' is not a number in {bad} of its {len(table)} rows")


def _check_names(table: Frame, names: Names) -> None:
    wanted = dict(zip(("algorithm", "task", "task_traffic", "training_seed"), names, strict=True))
    for column, value in wanted.items():
        others = [each for each in table[column].unique().tolist() if each != value]
        if others:
            raise ResultsError(f"of another run: its {column} is {others[0]!r}, not {value!r}")


def _check_extent(table: Frame, tested: Mapping[str, Any], config: Mapping[str, Any]) -> None:
    """Raise unless a table has the modes and the number of episodes of a test."""
    modes: Sequence[str] = tested.get("modes", [])
    counts = table.attrs[COUNTS]
    with_agents = table.loc[~table["is_invalid"], ["mode", "split", *EPISODE_KEYS]].drop_duplicates()
    without_agents = counts["measured"] - len(with_agents)
    # Only in bubbles an episode may have no agents, and so no rows.
    has_bubbles = bool((config.get("environment") or {}).get("learn_in_bubbles"))
    if without_agents and not has_bubbles:
        raise ResultsError(
            f"damaged: it has rows of {len(with_agents)} of its {counts['measured']} measured episodes"
        )
    invalid = table.loc[table["is_invalid"], ["mode", "split", *EPISODE_KEYS]].drop_duplicates()
    if not has_bubbles and len(invalid) != counts["invalid"]:
        raise ResultsError(
            f"damaged: it has rows of {len(invalid)} of its {counts['invalid']} invalid episodes"
        )
    lost = counts["incomplete"] + len(counts["corrupted"])
    plain, held_out = (table[table["split"] == split] for split in ("train", "held_out"))
    learned = (table["training_seed"] != SCRIPTED_SEED).any()
    absent = _without_agents(plain, tested["episodes"], without_agents, counts["invalid"])
    for mode in sorted({*plain["mode"], *(modes if learned else [])}):
        _check_count(plain[plain["mode"] == mode], str(mode), tested["episodes"], lost + absent)
    wanted = tested.get("held_out_episodes", 0)
    for (scenario, variation), part in held_out.groupby(["scenario", "variation"]):
        absent = _without_agents(part, wanted, without_agents, counts["invalid"])
        for mode, rows in part.groupby("mode"):
            _check_count(rows, f"{mode} {scenario}@{variation}", wanted, lost + absent)


def _without_agents(rows: Frame, wanted: int, most: int, invalid: int) -> int:
    """Return how many episodes of a mode may lack rows for want of agents.

    An episode in which agents drive in one mode has agents in all: traffic is the same until one comes.

    Args:
        rows: Of all modes of a part of a test.
        wanted: Valid episodes of each mode.
        most: Episodes without agents in the whole test.
        invalid: Invalid episodes of the whole test, which later ones replace in their mode alone.
    """
    valid = rows.loc[~rows["is_invalid"], "world"].nunique()
    return min(most, max(0, wanted - valid + invalid))


def _check_count(rows: Frame, name: str, wanted: int, lost: int) -> None:
    found = rows["world"].nunique()
    invalid = rows.loc[rows["is_invalid"], "world"].nunique()
    if not found - invalid <= wanted <= found + lost:
        raise ResultsError(
            f"of another test: it holds {found} {name} episodes, the run was tested on {wanted}"
        )
