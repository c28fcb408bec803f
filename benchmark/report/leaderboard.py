"""Many experiments in one list: ranks in each condition, and a summary over conditions."""

from __future__ import annotations

import json
import string
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from algorithms.registry import ALGORITHMS
from benchmark.experiment.environment import engine_mark
from benchmark.experiment.runs import SCRIPTED
from benchmark.metrics import METRICS
from benchmark.metrics.results import Frame, measured_in
from benchmark.report.html import fill
from benchmark.report.paper import algorithm_label, condition_label, task_label, traffic_label
from benchmark.report.protocol import (
    SUBMITTED,
    described,
    differing_scenarios,
    differing_trainings,
    protocol_of,
)
from benchmark.report.ranking import RANKED_BY, UNRANKED, Standing, differences, of_condition, ranks
from benchmark.report.values import MODES, Value, by_key, measure_conditions
from benchmark.report.wording import COMPARED
from benchmark.results.files import read_json, write_whole
from benchmark.results.reading import Results, RunResult, read_results
from benchmark.results.release import ADDRESS, CONFIRMED, MARKED, RATES, REFUSED, SEEDS, VERDICTS, Verdict
from benchmark.statistics import interquartile_mean
from smarts.registry import is_own_name

MAY_EXCHANGE = "its vehicles may tell each other what they see"
"""Remark on an agent at an address, and on an unknown algorithm: neither can be checked from outside."""
STATUSES = (CONFIRMED, MARKED, REFUSED)
"""Status of evaluated policies, the worst last."""
Key = tuple[str, ...]
"""Experiment, algorithm, task and traffic."""
SCRIPTED_PARADIGM, OTHER_PARADIGM = "scripted policy", "other"
"""Paradigms of scripted policies and of algorithms that the registry does not know."""


class Labelled:
    """The names of an algorithm of an experiment in a condition, as the page has them."""

    algorithm: str
    task: str
    traffic: str
    experiment: str

    @property
    def label(self) -> str:
        """Name of the algorithm."""
        return algorithm_label(self.algorithm)

    @property
    def key(self) -> Key:
        """Experiment, algorithm, task and traffic."""
        return self.experiment, self.algorithm, self.task, self.traffic

    @property
    def condition(self) -> str:
        """Name of the condition."""
        return condition_label(self.task, self.traffic)


@dataclass(frozen=True)
class Place(Labelled):
    """An algorithm of an experiment in a condition."""

    protocol: str
    """Letter of its protocol: only those with the same one are ranked among each other."""
    task: str
    traffic: str
    experiment: str
    algorithm: str
    paradigm: str
    standing: Standing
    """Without a rank for scripted policies and submissions that know the test, without a figure, and without
    another algorithm at equal starts."""
    completion: Value
    collision: Value
    own: tuple[Value, ...] = ()
    """Values of `Leaderboard.own_metrics`."""
    status: str = ""
    """Worst status of an evaluated submission's seeds: confirmed, marked or refused."""
    knows_test: bool = False
    """Whether an evaluated submission does better in the public test than in fresh episodes."""

    @property
    def values(self) -> tuple[Value, ...]:
        """What its line shows."""
        return self.completion, self.collision, *self.own


@dataclass(frozen=True)
class Summary(Labelled):
    """An algorithm of an experiment over all conditions."""

    protocol: str
    experiment: str
    algorithm: str
    paradigm: str
    completion: float
    """Interquartile mean over conditions."""
    collision: float
    conditions: int
    most_conditions: int
    """The most conditions of an entry under the protocol; means over fewer are not comparable."""


@dataclass(frozen=True)
class Leaderboard:
    """All places of all experiments."""

    mode: str
    protocols: dict[str, str]
    """Letter -> what it says, or wherein it differs."""
    engines: dict[str, str]
    """Letter -> mark of tests on another engine than SUMO, else ""."""
    places: tuple[Place, ...]
    """Places by protocol, task, traffic and rank."""
    summaries: tuple[Summary, ...]
    """Summaries by protocol and completion."""
    problems: tuple[str, ...]
    own_metrics: tuple[str, ...] = ()
    """Users' own metrics that an experiment has measured; they are shown, ranks do not depend on them."""
    submitted: tuple[Submitted, ...] = ()
    """Policies of releases and submissions that `smarts-bench verify` has evaluated."""


def make_leaderboard(roots: Sequence[Path], mode: str = MODES[0]) -> Leaderboard:
    """Return the places of all algorithms of several experiments.

    Args:
        roots: Folders of the experiments' results.
        mode: Way of acting.

    Raises:
        ResultsError: One is not there.
    """
    roots = [*{root.resolve(): root for root in roots}.values()]
    names = _names(roots)
    experiments: dict[str, Results] = {}
    submitted: list[Submitted] = []
    for name, root in zip(names, roots, strict=True):
        experiments[name] = read_results(root)
        submitted += read_submitted(root, name)
    parts = [_labelled(results, name) for name, results in experiments.items() if results.finished]
    table = pd.concat(parts, ignore_index=True) if parts else pd.DataFrame({"protocol": []})
    letters = {text: _letters(number) for number, text in enumerate(dict.fromkeys(table["protocol"]))}
    own = tuple(measure.name for measure in measured_in(table) if is_own_name(measure.name))
    places: list[Place] = []
    policies = by_entry(submitted)
    for protocol, letter in letters.items():
        places += _places(table[table["protocol"] == protocol], letter, mode, own, policies)
    return Leaderboard(
        mode=mode,
        protocols=dict(zip(letters.values(), described([*letters]), strict=True)),
        engines={letter: _engine_mark(protocol) for protocol, letter in letters.items()},
        places=tuple(places),
        summaries=tuple(summary for letter in letters.values() for summary in _summaries(places, letter)),
        problems=(
            *_problems(experiments),
            *differing_scenarios(_named(experiments)),
            *(
                line
                for name, results in experiments.items()
                for line in differing_trainings(results.runs, f"{name}: ")
            ),
        ),
        own_metrics=own,
        submitted=tuple(submitted),
    )


def paradigm_of(algorithm: str, is_scripted: bool) -> str:
    """Return an algorithm's paradigm."""
    if is_scripted:
        return SCRIPTED_PARADIGM
    return str(ALGORITHMS[algorithm].paradigm) if algorithm in ALGORITHMS else OTHER_PARADIGM


def _names(roots: Sequence[Path]) -> list[str]:
    """Return a name for each experiment: its folder's, or more of its path where that is another's, too."""
    names = [root.resolve().name for root in roots]
    return [
        name if names.count(name) == 1 else root.resolve().as_posix()
        for name, root in zip(names, roots, strict=True)
    ]


def _labelled(results: Results, name: str) -> Frame:
    parts = []
    for run in results.finished:
        table = run.table
        if table is not None:
            labels = {
                "experiment": name,
                "protocol": protocol_of(run, results),
                "is_scripted": run.is_scripted,
            }
            parts.append(table.assign(**labels, entry=f"{name}\n{run.algorithm}"))
    return pd.concat(parts, ignore_index=True)


def _engine_mark(protocol: str) -> str:
    return engine_mark((json.loads(protocol)["environment"] or {}).get("traffic_engine"))


def _letters(number: int) -> str:
    high, low = divmod(number, 26)
    return (_letters(high - 1) if high else "") + string.ascii_uppercase[low]


def _places(
    table: Frame,
    letter: str,
    mode: str,
    own: Sequence[str],
    submitted: Mapping[Key, Sequence[Submitted]],
) -> list[Place]:
    """Return the places under one protocol."""
    table = table[table["mode"].isin([mode, SCRIPTED])]
    values = by_key(measure_conditions(table.assign(algorithm=table["entry"]), [*RANKED_BY, *own]))
    differing = differences(table, mode, column="entry")
    scripted = set(table.loc[table["is_scripted"], "entry"])
    found: dict[tuple[str, str], dict[str, list[Value]]] = {}
    for entry, task, traffic, acting in dict.fromkeys(key[:4] for key in values):
        row = [values[entry, task, traffic, acting, name] for name in (*RANKED_BY, *own)]
        found.setdefault((task, traffic), {})[entry] = row
    places = []
    for (task, traffic), rows in sorted(found.items()):
        rates = {entry: row[: len(RANKED_BY)] for entry, row in rows.items()}
        known = {entry: submitted.get((*entry.split("\n"), task, traffic), ()) for entry in rows}
        apart = scripted | {entry for entry, policies in known.items() if not may_be_ranked(policies)}
        ranked = [entry for entry in rates if entry not in apart and all(x.is_known for x in rates[entry])]
        standings = ranks(of_condition(differing, task, traffic), ranked) if len(ranked) > 1 else {}
        for entry in sorted(rates, key=lambda each: _order(standings.get(each, UNRANKED), rates[each])):
            experiment, _, algorithm = entry.partition("\n")
            kind = SUBMITTED if known[entry] else paradigm_of(algorithm, entry in scripted)
            standing = standings.get(entry, UNRANKED)
            place = Place(
                *(letter, task, traffic, experiment, algorithm, kind),
                standing,
                *rates[entry],
                own=tuple(rows[entry][len(RANKED_BY) :]),
                status=max((each.status for each in known[entry]), key=STATUSES.index, default=""),
                knows_test=any(each.knows_test for each in known[entry]),
            )
            places.append(place)
    return places


def _order(standing: Standing, figures: Sequence[Value]) -> tuple[float, float, float]:
    completion, collision = (value.value if value.is_known else 0.0 for value in figures)
    return standing.rank or float("inf"), -completion, collision


def _summaries(places: Sequence[Place], letter: str) -> list[Summary]:
    own = [place for place in places if place.protocol == letter and not place.knows_test]
    most = len({(place.task, place.traffic) for place in own})
    entries = dict.fromkeys((place.experiment, place.algorithm, place.paradigm) for place in own)
    found = []
    for experiment, algorithm, paradigm in entries:
        shown = [place for place in own if (place.experiment, place.algorithm) == (experiment, algorithm)]
        means = [
            interquartile_mean([getattr(place, name).value for place in shown])
            for name in ("completion", "collision")
        ]
        found.append(Summary(letter, experiment, algorithm, paradigm, means[0], means[1], len(shown), most))
    return sorted(found, key=lambda each: (-each.completion, each.collision))


def _named(experiments: dict[str, Results]) -> Iterator[tuple[RunResult, str]]:
    for name, results in experiments.items():
        for run in results.runs:
            yield run, f"{name}: {run}"


def _problems(experiments: dict[str, Results]) -> list[str]:
    lines = []
    for name, results in experiments.items():
        if results.unfinished:
            lines.append(f"{name}: {len(results.unfinished)} of {len(results.runs)} runs are not finished")
        lines += [f"{name}: {place}: {reason}" for place, reason in results.problems.items()]
    return lines


def write_leaderboard(roots: Sequence[Path], out: Path, mode: str) -> None:
    """Write the leaderboard of several experiments.

    Raises:
        ResultsError: One is not there, or the page cannot be written.
    """
    page = leaderboard_page(make_leaderboard(roots, mode))
    write_whole(out, lambda file: file.write_text(page, encoding="utf-8"))


def leaderboard_page(board: Leaderboard) -> str:
    """Return a leaderboard as an HTML page."""
    places = board.places
    return fill(
        "leaderboard.html.j2",
        **vars(board),
        compared=COMPARED,
        letters=[(letter, letter) for letter in board.protocols],
        tasks=[(name, task_label(name)) for name in dict.fromkeys(each.task for each in places)],
        traffics=[(name, traffic_label(name)) for name in dict.fromkeys(each.traffic for each in places)],
        paradigms=[(name, name) for name in sorted({each.paradigm for each in places})],
        has_status=any(place.status for place in places),
        rates=[METRICS[name] for name in RANKED_BY],
        metrics=[METRICS[name] for name in (*RANKED_BY, *board.own_metrics)],
    )


class Submitted(Labelled, Verdict):
    """A policy of a submission after its evaluation."""

    experiment: str
    """Folder of its results."""

    @property
    def remarks(self) -> list[str]:
        """What is wrong with the policy, and what cannot be checked."""
        is_open = self.agent.startswith(ADDRESS) or self.algorithm not in ALGORITHMS
        return [*self.reasons, MAY_EXCHANGE] if is_open else [*self.reasons]

    @property
    def rates(self) -> Iterator[tuple[str, str]]:
        """Completion and collision rate, as claimed and as re-derived."""
        for name in RATES:
            given = self.claimed.get(name), self.scores.get(name)
            claimed, derived = ("-" if value is None else f"{value:.3f}" for value in given)
            yield claimed, derived


def read_submitted(root: Path, experiment: str) -> list[Submitted]:
    """Return the policies of a folder that `smarts-bench verify` has written; none of any other folder.

    Args:
        root: The folder.
        experiment: Its name.
    """
    said = read_json(root / VERDICTS)["verdicts"] if (root / VERDICTS).exists() else []
    return [Submitted(**each, experiment=experiment) for each in said]


def by_entry(submitted: Sequence[Submitted]) -> dict[Key, list[Submitted]]:
    """Return the policies of all seeds by experiment, algorithm, task and traffic."""
    found: dict[Key, list[Submitted]] = {}
    for each in submitted:
        found.setdefault(each.key, []).append(each)
    return found


def may_be_ranked(policies: Sequence[Submitted]) -> bool:
    """Return whether a submission may have a rank: seeds that were left out cannot be seen otherwise."""
    return not policies or (len(policies) >= SEEDS and not any(each.knows_test for each in policies))
