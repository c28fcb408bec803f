"""Cross-play and robustness on disk: which policies were played together, under which condition.

robustness/TASK/TRAFFIC/CONDITION/seed_SEED/EVEN+ODD/
    play.json         what was played: policies and their checkpoints, condition, episodes, commit, machine
    episodes.parquet  a row for each agent-episode: `algorithm` drives the agent, `partner` the others
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import pandas as pd

from benchmark.experiment.conditions import AS_TRAINED, condition
from benchmark.experiment.runs import SCRIPTED, SCRIPTED_SEED
from benchmark.metrics import read_table
from benchmark.metrics.results import Frame
from benchmark.results.files import ResultsError, read_versioned
from benchmark.results.reading import Results, RunResult, packed_contents, packed_rows
from smarts.errors import SmartsError

ROBUSTNESS = "robustness"
"""Folder of an experiment's results."""
PLAY, TABLE = "play.json", "episodes.parquet"
AGAIN = "`smarts-bench robustness` plays it again"
PARTNER, CONDITION = "partner", "condition"
"""Columns that the table of a play has beside those of a test."""


@dataclass(frozen=True)
class Play:
    """Two policies together in a cell: one drives the agents at even places, one those at odd places."""

    task: str
    traffic: str
    condition: str
    """`AS_TRAINED`, or a name of `conditions.yaml`."""
    even: str
    """An algorithm or a scripted policy, by the name of its folder."""
    odd: str
    """The same one: it drives all agents."""
    seed: int
    """Training seed of the policies."""

    def __str__(self) -> str:
        drivers = self.even if self.even == self.odd else f"{self.even} with {self.odd}"
        return f"{drivers}, {self.task}, {self.traffic}, {self.condition}"

    @property
    def folder(self) -> Path:
        """Folder of its results, within the experiment's folder."""
        seed = f"seed_{self.seed}"
        return Path(ROBUSTNESS, self.task, self.traffic, self.condition, seed, f"{self.even}+{self.odd}")

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
    """What is known of all plays of an experiment."""

    table: Frame | None
    """Agent-episodes of all plays; None without one."""
    facts: tuple[Mapping[str, Any], ...]
    """Contents of play.json."""
    problems: Mapping[str, str]
    """Folder -> why it was left out."""

    @property
    def seed(self) -> int | None:
        """Training seed of the policies; None without plays."""
        return None if not self.facts else int(self.facts[0]["training_seed"])


def read_played(results: Results) -> Played:
    """Return the plays of an experiment whose policies are still those of its finished runs."""
    tables, facts, problems = [], [], {}
    for place, (read_content, read_rows) in sorted(plays_of(results.root).items()):
        try:
            content = read_content()
            if problem := _outdated(content, results):
                raise ResultsError(problem, place=place)
            tables.append(read_rows())
            facts.append(content)
        except SmartsError as error:
            problems[place] = f"{error.problem}; {AGAIN}"
    kept = _alike(facts, problems)
    table = pd.concat([tables[k] for k in kept], ignore_index=True) if kept else None
    return Played(table, tuple(facts[k] for k in kept), problems)


def plays_of(root: Path) -> dict[str, tuple[Callable[[], dict[str, Any]], Callable[[], Frame]]]:
    """Return what reads play.json and rows of each finished play, by its place."""
    contents, rows = packed_contents(root / ROBUSTNESS), packed_rows(root / ROBUSTNESS)
    found = {place: (partial(dict, contents[place]), partial(rows.get, place)) for place in contents}
    for file in (root / ROBUSTNESS).glob(f"*/*/*/*/*/{PLAY}"):
        place = file.parent.relative_to(root).as_posix()
        found[place] = partial(read_versioned, file), partial(read_play, file.parent)
    return found


def _alike(facts: Sequence[Mapping[str, Any]], problems: dict[str, str]) -> list[int]:
    """Return the plays that can stand in one table: of one training seed, and in each cell of one extent.

    The number of episodes and the commit of most plays stay; the others are named.
    """
    seeds = sorted({int(each["training_seed"]) for each in facts})
    kept = [k for k, each in enumerate(facts) if each["training_seed"] == seeds[0]]
    if len(seeds) > 1:
        problems[ROBUSTNESS] = f"policies of training seeds {seeds}: shown are those of {seeds[0]}"
    extents: dict[tuple[str, str], Counter[tuple[int, str]]] = {}
    for k in kept:
        extents.setdefault(_cell_of(facts[k]), Counter())[_extent(facts[k])] += 1
    for k in [*kept]:
        (most, _), *others = extents[_cell_of(facts[k])].most_common()
        if others and _extent(facts[k]) != most:
            kept.remove(k)
            problems[_play_of(facts[k]).folder.as_posix()] = (
                f"{_extent(facts[k])[0]} episodes at commit {_extent(facts[k])[1]}, and most plays of this "
                f"cell have {most[0]} at commit {most[1]}; {AGAIN}"
            )
    return kept


def _cell_of(facts: Mapping[str, Any]) -> tuple[str, str]:
    return str(facts["task"]), str(facts["traffic"])


def _extent(facts: Mapping[str, Any]) -> tuple[int, str]:
    return int(facts["episodes"]), str(facts.get("commit"))


def read_play(folder: Path) -> Frame:
    """Return the rows of a play.

    Raises:
        SmartsError: They are missing or damaged.
    """
    return read_table(folder / TABLE)


def reference_rows(results: Results, task: str, traffic: str, name: str, seed: int) -> Frame | None:
    """Return the agent-episodes of a policy's own test, which plays are compared with; None without one."""
    run = run_of(results, task, traffic, name, seed)
    if run is None or run.table is None:
        return None
    mode = SCRIPTED if run.is_scripted else "greedy"
    table = run.table
    return table[(table["split"] == "train") & (table["mode"] == mode)]


def run_of(results: Results, task: str, traffic: str, name: str, seed: int) -> RunResult | None:
    """Return the run of a policy, of an algorithm with a training seed or scripted; None without one."""
    for run in results.runs:
        if (run.task, run.traffic, run.algorithm) == (task, traffic, name) and run.seed in (
            seed,
            SCRIPTED_SEED,
        ):
            return run
    return None


def _outdated(content: Mapping[str, Any], results: Results) -> str:
    """Return why a play does not belong to the runs as they are, "" if it does."""
    name = content["condition"]
    wanted = {} if name == AS_TRAINED else dict(condition(name).environment)
    if dict(content.get("environment", {})) != wanted:
        return f"the condition {name} is another one now"
    for name, trained in dict(content.get("trained", {})).items():
        run = run_of(results, content["task"], content["traffic"], name, content["training_seed"])
        if run is None or run.table is None:
            return f"{name} has no finished run any more"
        if trained_state(run) != trained:
            return f"{name} has been trained again since"
    return ""


def _play_of(content: Mapping[str, Any]) -> Play:
    names = (str(content.get(key)) for key in ("task", "traffic", "condition", "even", "odd"))
    return Play(*names, seed=int(content["training_seed"]))
