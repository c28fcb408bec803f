"""An experiment's results in the JSON format of marl-eval (Gorsane et al., 2022)."""

from __future__ import annotations

import json
import math
from typing import Any

from benchmark.metrics.results import Frame
from benchmark.metrics.table import EPISODE_KEYS
from benchmark.results.reading import Results, RunResult

ENVIRONMENT = "smarts_bench"
VALIDATED = {
    "return": "validation_return",
    "completion_rate": "validation_completion",
    "collision_rate": "validation_collision",
}
"""Metric -> its column of progress.csv: one mean for each validation."""
TESTED = {"return": "return", "completion_rate": "goals", "collision_rate": "collisions"}
"""Metric -> its column of the test's table: one mean over agents for each episode."""


def marl_eval_json(results: Results, mode: str) -> str:
    """Return environment -> task -> algorithm -> run -> validations and absolute metrics.

    A task is "TASK, TRAFFIC"; `step_count` counts agent-steps, `elapsed_time` seconds of training.

    Args:
        results: Finished runs that were trained; scripted policies and held-out variations are left out.
        mode: Way of acting, of the absolute metrics.
    """
    tasks: dict[str, dict[str, dict[str, Any]]] = {}
    for run in results.finished:
        if not run.is_scripted:
            runs = tasks.setdefault(f"{run.task}, {run.traffic}", {}).setdefault(run.algorithm, {})
            runs[f"seed_{run.seed}"] = {**_steps(run), "absolute_metrics": _absolute(run.table, mode)}
    return json.dumps({ENVIRONMENT: tasks}, indent=1) + "\n"


def _steps(run: RunResult) -> dict[str, dict[str, Any]]:
    found: dict[str, dict[str, Any]] = {}
    lines: list[dict[str, Any]] = [] if run.progress is None else run.progress.to_dict("records")
    for each in lines:
        values = {name: [each[column]] for name, column in VALIDATED.items() if math.isfinite(each[column])}
        if values:
            times = {"step_count": int(each["agent_steps"]), "elapsed_time": each["seconds"]}
            found[f"step_{len(found)}"] = times | values
    return found


def _absolute(table: Frame, mode: str) -> dict[str, list[float]]:
    """Return the means over agents of each valid episode."""
    kept = table[(table["mode"] == mode) & (table["split"] != "held_out") & ~table["is_invalid"]]
    kept = kept[kept["agents"] > 0]
    found = {}
    for name, column in TESTED.items():
        if column in kept and kept[column].notna().all():
            found[name] = kept.groupby([*EPISODE_KEYS])[column].mean().round(6).tolist()
    return found
