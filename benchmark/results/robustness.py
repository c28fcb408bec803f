"""Cross-play and robustness on disk: which policies were played together, under which condition.

robustness/TASK/TRAFFIC/CONDITION/seed_SEED/EVEN+ODD/
    play.json         what was played: policies and their checkpoints, condition, episodes, commit, machine
    episodes.parquet  a row for each agent-episode: `algorithm` drives the agent, `partner` the others
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import pandas as pd

from benchmark.experiment.conditions import AS_TRAINED, condition
from benchmark.experiment.runs import SCRIPTED, SCRIPTED_SEED
from benchmark.metrics import read_table
from benchmark.metrics.results import Frame
from benchmark.results.files import read_versioned
from benchmark.results.reading import CONDITION, Results, RunResult, packed_contents, packed_rows
from smarts.errors import SmartsError

ROBUSTNESS = "robustness"
"""Folder of an experiment's results."""
PLAY, TABLE = "play.json", "episodes.parquet"
PARTNER = "partner"
"""Column that the table of a play has beside those of a test: which policy drives the other agents."""


@dataclass(frozen=True)
class Play:
    """Two policies together: one drives the agents at even places, one those at odd places."""

    task: str
    traffic: str
    condition: str
    """`AS_TRAINED`, or a name of `conditions.yaml`."""
    even: str
    """An algorithm or a scripted policy, by the name of its folder."""
    odd: str
    """The same one: it drives all agents."""
    training_seed: int

    def __str__(self) -> str:
        drivers = self.even if self.even == self.odd else f"{self.even} with {self.odd}"
        return f"{drivers}, {self.task}, {self.traffic}, {self.condition}"

    @property
    def folder(self) -> Path:
        """Folder of its results, within the experiment's folder."""
        seed, drivers = f"seed_{self.training_seed}", f"{self.even}+{self.odd}"
        return Path(ROBUSTNESS, self.task, self.traffic, self.condition, seed, drivers)

    @property
    def drivers(self) -> tuple[str, ...]:
        """Distinct policies."""
        return tuple(dict.fromkeys((self.even, self.odd)))


def trained_state(run: RunResult) -> dict[str, Any]:
    """Return how far a finished run's training is, by which later checkpoints are recognized."""
    if run.is_scripted or run.progress is None:
        return {}
    last = run.progress.iloc[-1]
    return {"agent_steps": int(last["agent_steps"]), "seconds": round(float(last["seconds"]), 2)}


@dataclass(frozen=True)
class Played:
    """What is known of all plays of an experiment that are of one training seed."""

    table: Frame | None
    """Agent-episodes of all plays; None without one."""
    facts: tuple[Mapping[str, Any], ...]
    """Contents of play.json."""
    problems: Mapping[str, str]
    """Folder -> why it was left out."""


def read_played(results: Results) -> Played:
    """Return the plays of an experiment whose policies are still those of its finished runs."""
    plays: dict[int, list[tuple[Mapping[str, Any], Frame]]] = {}
    problems: dict[str, str] = {}
    for place, read_content, read_rows in plays_of(results.root):
        try:
            facts = read_content()
            problem = _outdated(facts, results)
            if not problem:
                plays.setdefault(facts["training_seed"], []).append((facts, read_rows()))
        except SmartsError as error:
            problem = error.problem
        if problem:
            problems[place] = f"{problem}; `smarts-bench robustness` plays it again"
    if len(plays) > 1:
        problems[ROBUSTNESS] = f"policies of training seeds {sorted(plays)}: shown are those of {min(plays)}"
    facts, tables = zip(*plays[min(plays)], strict=True) if plays else ((), ())
    return Played(pd.concat(tables, ignore_index=True) if tables else None, facts, problems)


def plays_of(root: Path) -> Iterator[tuple[str, Callable[[], dict[str, Any]], Callable[[], Frame]]]:
    """Yield the place of each finished play, and what reads its play.json and its rows."""
    rows = packed_rows(root / ROBUSTNESS)
    found = {
        place: (partial(dict, content), partial(rows.get, place))
        for place, content in packed_contents(root / ROBUSTNESS).items()
    }
    for file in (root / ROBUSTNESS).glob(f"*/*/*/*/*/{PLAY}"):
        place = file.parent.relative_to(root).as_posix()
        found[place] = partial(read_versioned, file), partial(read_table, file.with_name(TABLE))
    for place, reading in sorted(found.items()):
        yield place, *reading


def reference_rows(results: Results, task: str, traffic: str, name: str, seed: int) -> Frame | None:
    """Return the agent-episodes of a policy's own test, which plays are compared with; None without one."""
    run = _run_of(results, task, traffic, name, seed)
    if run is None or run.table is None:
        return None
    mode = SCRIPTED if run.is_scripted else "greedy"
    rows = run.table[(run.table["split"] != "held_out") & (run.table["mode"] == mode)]
    played = played_condition(run.test, traffic)
    return rows if played is None else rows[rows[CONDITION].str.removesuffix(" (seen)") == played["name"]]


def played_condition(test: Sequence[Mapping[str, Any]], traffic: str) -> Mapping[str, Any] | None:
    """Return the condition of a test that is played: the first in the task's traffic, or else the first."""
    return min(test, key=lambda each: each["traffic"] not in (None, traffic), default=None)


def _run_of(results: Results, task: str, traffic: str, name: str, seed: int) -> RunResult | None:
    """Return the run of a policy, of an algorithm with a training seed or scripted; None without one."""
    wanted = [(name, task, traffic, each) for each in (seed, SCRIPTED_SEED)]
    runs = (run for run in results.runs if (run.algorithm, run.task, run.traffic, run.seed) in wanted)
    return next(runs, None)


def _outdated(facts: Mapping[str, Any], results: Results) -> str:
    """Return why a play does not belong to the runs as they are, "" if it does."""
    name = facts["condition"]
    if facts["environment"] != ({} if name == AS_TRAINED else condition(name).environment):
        return f"the condition {name} is another one now"
    for name, trained in facts["trained"].items():
        run = _run_of(results, facts["task"], facts["traffic"], name, facts["training_seed"])
        if run is None or run.table is None:
            return f"{name} has no finished run any more"
        if trained_state(run) != trained:
            return f"{name} has been trained again since"
    return ""
