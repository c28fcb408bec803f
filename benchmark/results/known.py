"""What is known of a run: what cannot be is left out of its facts and progress, and named."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import pandas as pd

from benchmark.metrics.results import Frame
from benchmark.results.run_folder import CONTINUED, ENDED_BY, PROGRESS_COLUMNS, progress_problem


def known_facts(facts: Mapping[str, Any]) -> tuple[dict[str, Any], str]:
    """Return the content of a run.json without values that cannot be, and what they were."""
    bad = [name for name, fits in _FITS.items() if name in facts and not fits(facts[name])]
    said = "; ".join(f"left out: {name} is {facts[name]!r}" for name in bad)
    return {name: value for name, value in facts.items() if name not in bad}, said


def _is_time(value: Any) -> bool:
    return isinstance(value, int | float) and math.isfinite(value)


def _is_test(value: Any) -> bool:
    if not isinstance(value, dict) or not isinstance(value.get("episodes"), int):
        return False
    modes = value.get("modes", [])
    return isinstance(modes, list) and all(isinstance(mode, str) for mode in modes)


def _are_facts(value: Any) -> bool:
    return isinstance(value, list) and all(isinstance(each, dict) for each in value)


_FITS = {"test_seconds": _is_time, "tested": _is_test, CONTINUED: _are_facts}
"""Facts that are more than shown, and what they must be."""


def known_progress(lines: Sequence[Mapping[str, str]], ending: Mapping[str, Any]) -> tuple[Frame | None, str]:
    """Return progress without lines that cannot be, and what is wrong with it, empty if nothing is.

    Args:
        lines: Of progress.csv.
        ending: Facts and config of a run that is trained to its end; empty of others, whose end is not known.

    Returns:
        Columns of `PROGRESS_COLUMNS`, None without a line.
    """
    problems = [progress_problem(line) for line in lines]
    kept = [line for line, problem in zip(lines, problems, strict=True) if not problem]
    said = [
        f"left out: line {number}, {problem}" for number, problem in enumerate(problems, start=2) if problem
    ]
    frame = None
    if kept:
        frame = pd.DataFrame(kept)[[*PROGRESS_COLUMNS]].apply(pd.to_numeric, errors="coerce")
    if not said and ending:
        said = _missing_end(frame, ending)
    return frame, "; ".join(said)


def _missing_end(progress: Frame | None, ending: Mapping[str, Any]) -> list[str]:
    """Return that progress ends before the training did, if it does."""
    if progress is None:
        return ["missing or empty, though the training is over: there is no learning curve"]
    budget = ending.get("budget") or {}
    wanted, minutes = budget.get("agent_steps"), budget.get("minutes")
    last = progress.iloc[-1]
    steps = last["agent_steps"] / wanted if isinstance(wanted, int | float) and wanted else 1.0
    # Seconds are rounded in the file.
    time = (last["seconds"] + 0.01) / (60 * minutes) if isinstance(minutes, int | float) and minutes else 0.0
    share = {"agent_steps": steps, "minutes": time}.get(str(ending.get(ENDED_BY)), max(steps, time))
    if share >= 1:
        return []
    return [
        f"ends at {last['agent_steps']:,.0f} agent-steps, {share:.0%} of the budget that training used up"
    ]
