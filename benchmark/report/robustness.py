"""Cross-play and robustness in a report: each policy beside its own test, at equal starts."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import pandas as pd

from benchmark.experiment.conditions import AS_TRAINED, conditions
from benchmark.metrics import METRICS, compare, compute
from benchmark.metrics.differences import SIGNIFICANCE
from benchmark.metrics.results import Frame
from benchmark.report.content import Report
from benchmark.report.paper import algorithm_label, condition_label
from benchmark.results.reading import CONDITION
from benchmark.results.release import RATES
from benchmark.results.robustness import PARTNER, Played, read_played, reference_rows
from benchmark.statistics import holm

TITLE = "Cross-play and robustness"
NOTE = (
    "Nothing was trained further: the last checkpoints act greedily in the first test episodes, at equal "
    "starts in equal traffic. An entry is the collision / completion rate of the row's policy alone, with "
    "95% intervals. Below it: what is better or worse than in the policy's own test, paired at equal "
    "starts; p-values are corrected after Holm over tasks, policies and both rates, those of means over "
    "partners (XP) in a family of their own."
)
CROSS_PLAY = (
    "Cross-play: the policy drives every second agent and the column's partner the others, in both "
    "arrangements. Self-play is the policy's own test; XP is the mean over all partners."
)
CONDITIONS = "Other conditions than in training, for all agents: {}."
OWN_KIND = (
    "* acts on messages, observations or draws that agents share: in cross-play it has those of its own "
    "kind only."
)
SELF, XP, TEST = "self-play", "XP", "test"
"""Columns without a partner or a condition; self-play and the test are the same episodes."""
PARTNERS, UNDER = "partner", "condition"
"""Kinds of rows."""
COLUMNS = (
    *("task", "traffic", "policy", "kind", "with", "metric", "value", "low", "high", "n", "episodes"),
    *("difference", "difference_low", "difference_high", "p_value", "corrected", "change", "note"),
)
_PLAYED, _TEST, _NUMBER = "a played", "b test", "_number"


@dataclass(frozen=True)
class Entry:
    """A policy with a partner, or under a condition."""

    figures: str
    intervals: str
    change: str
    """What is better or worse than in the test; "" if nothing is, or it is not known."""


@dataclass(frozen=True)
class Matrix:
    """A table of a task of the experiment."""

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, tuple[Entry | None, ...]], ...]
    """Label and entries of each policy."""


@dataclass(frozen=True)
class Robustness:
    """The section of a report."""

    values: Frame
    """Values in the columns `COLUMNS`."""
    matrices: tuple[Matrix, ...]
    notes: tuple[str, ...]
    left_out: tuple[str, ...]

    @property
    def is_there(self) -> bool:
        """Whether anything was played."""
        return bool(self.matrices or self.left_out)


def robustness_of(report: Report) -> Robustness:
    """Return what was played beside the tests of an experiment."""
    played = read_played(report.results)
    left_out = tuple(f"{place}: {reason}" for place, reason in played.problems.items())
    if played.table is None:
        return Robustness(pd.DataFrame(columns=[*COLUMNS]), (), (), left_out)
    values = _corrected(_values(report, played))[[*COLUMNS]]
    needing = {name for facts in played.facts for name in facts.get("needs_others", ())}
    matrices = tuple(_matrices(report, values, needing))
    return Robustness(values, matrices, tuple(_notes(played, values, needing)), left_out)


def _values(report: Report, played: Played) -> Frame:
    """Return a row for each task, policy, partner or condition, and rate."""
    table: Frame = played.table
    seed = played.facts[0]["training_seed"]
    sides: list[Frame] = []
    names: list[dict[str, Any]] = []
    for (task, traffic), cell in table.groupby(["task", "task_traffic"], sort=True):
        worlds, agents = cell["world"].unique(), cell["agent"].nunique()
        for policy, own in cell.groupby("algorithm", sort=True):
            test = reference_rows(report.results, task, traffic, policy, seed)
            test = None if test is None else test[test["world"].isin(worlds)]
            for kind, name, rows, count in _parts(own, test, agents):
                labels = {_NUMBER: len(names), "training_seed": 0, "mode": ""}
                against = [] if name in (SELF, TEST) or test is None else [test] * count
                sides.append(rows.assign(**labels, _side=_PLAYED))
                sides += [each.assign(**labels, _side=_TEST) for each in against]
                mean = f"mean over {count} partners" if name == XP else ""
                place = {"task": task, "traffic": traffic, "policy": policy}
                names.append({**place, "kind": kind, "with": name, "mean": mean})
    both = pd.concat(sides, ignore_index=True)
    plays: Frame = both[both["_side"] == _PLAYED]
    found = compute(plays, [_NUMBER], RATES).drop(columns="note")
    gaps = compare(both, RATES, [_NUMBER], "_side", family=())
    gaps = gaps.rename(columns={"value": "difference", "low": "difference_low", "high": "difference_high"})
    answer = found.merge(gaps, how="left", on=[_NUMBER, "metric"]).join(pd.DataFrame(names), on=_NUMBER)
    notes = zip(answer["mean"], answer["note"].fillna(""), strict=True)
    return answer.assign(note=["; ".join(filter(None, each)) for each in notes])


def _parts(own: Frame, test: Frame | None, agents: int) -> Iterator[tuple[str, str, Frame, int]]:
    """Yield kind, name, rows, and how often they have each agent-episode, of what one policy played."""
    cross = own[own[CONDITION] == AS_TRAINED]
    whole = [
        (str(partner), rows)
        for partner, rows in cross.groupby(PARTNER, sort=True)
        if rows["agent"].nunique() == agents
    ]  # one arrangement alone is of half the agents
    under = own[own[CONDITION] != AS_TRAINED]
    if whole:
        if test is not None:
            yield PARTNERS, SELF, test, 1
        for partner, rows in whole:
            yield PARTNERS, partner, rows, 1
        yield PARTNERS, XP, pd.concat([rows for _, rows in whole], ignore_index=True), len(whole)
    if len(under):
        if test is not None:
            yield UNDER, TEST, test, 1
        for name, rows in under.groupby(CONDITION, sort=True):
            yield UNDER, str(name), rows, 1


def _corrected(values: Frame) -> Frame:
    """Return the rows with corrected p-values, XP in a family of its own, and what is better or worse."""
    answer = values.assign(corrected=math.nan, change="")
    is_mean = answer["with"] == XP
    for family in (is_mean, ~is_mean):
        answer.loc[family, "corrected"] = holm(answer.loc[family, "p_value"].to_numpy(float))
    answer["change"] = [_change(row) for row in answer.to_dict("records")]
    return answer


def _change(row: dict[Any, Any]) -> str:
    if not row["corrected"] < SIGNIFICANCE:
        return ""
    return "better" if (row["difference"] > 0) == (METRICS[row["metric"]].better == "higher") else "worse"


def _matrices(report: Report, values: Frame, needing: set[str]) -> Iterator[Matrix]:
    order = [name for name, _ in report.names]
    titles = {UNDER: "other conditions", PARTNERS: "partners"}
    there = {*zip(values["task"], values["traffic"], strict=True)}
    cells = [column for column in report.columns if column in there]
    for kind in (PARTNERS, UNDER):
        for task, traffic in cells:
            own = values[(values["task"] == task) & (values["traffic"] == traffic) & (values["kind"] == kind)]
            if not len(own):
                continue
            policies = sorted(own["policy"].unique(), key=lambda name: (_place(order, name), name))
            columns = _columns(kind, own, policies)
            entries = {key: rows for key, rows in own.groupby(["policy", "with"])}
            rows = [
                (
                    algorithm_label(policy) + ("*" if policy in needing else ""),
                    tuple(_entry(entries.get((policy, column))) for column in columns),
                )
                for policy in policies
            ]
            title = f"{condition_label(task, traffic)}: {titles[kind]}"
            yield Matrix(title, tuple(map(_label, columns)), tuple(rows))


def _columns(kind: str, own: Frame, policies: Sequence[str]) -> list[str]:
    there = set(own["with"])
    order = [TEST, *conditions()] if kind == UNDER else [SELF, *policies, XP]
    return [name for name in (*order, *sorted(there - set(order))) if name in there]


def _place(order: Sequence[str], name: str) -> int:
    return order.index(name) if name in order else len(order)


def _label(column: str) -> str:
    if column in conditions():
        return conditions()[column].label
    return column.capitalize() if column in (SELF, TEST) else algorithm_label(column)


def _entry(rows: Frame | None) -> Entry | None:
    if rows is None:
        return None
    found = {row["metric"]: row for row in rows.to_dict("records")}
    both = [found["collision_rate"], found["completion_rate"]]
    known = all(math.isfinite(row["low"]) for row in both)
    intervals = " / ".join(f"[{row['low']:z.2f}, {row['high']:z.2f}]" for row in both)
    changes = [
        f"{row['change']}: {row['metric'].split('_')[0]} {row['difference']:+z.2f}"
        for row in both
        if row["change"]
    ]
    figures = " / ".join(f"{row['value']:z.2f}" for row in both)
    return Entry(figures, intervals if known else "no interval", ", ".join(changes))


def _notes(played: Played, values: Frame, needing: set[str]) -> Iterator[str]:
    yield NOTE
    if (values["kind"] == PARTNERS).any():
        yield CROSS_PLAY
        if needing:
            yield OWN_KIND
        for (task, traffic), cell in values[values["with"] == XP].groupby(["task", "traffic"]):
            counts = dict(zip(map(algorithm_label, cell["policy"]), cell["note"], strict=True))
            if len({*counts.values()}) > 1:
                said = "; ".join(f"{policy}: {note}" for policy, note in counts.items())
                yield f"{condition_label(task, traffic)}: XP is not of equally many partners: {said}."
    there = [each for name, each in conditions().items() if (values["with"] == name).any()]
    if there:
        said = "; ".join(f"{each.label}: {each.meaning[0].lower()}{each.meaning[1:]}" for each in there)
        yield CONDITIONS.format(said)
    seed, counts = played.facts[0]["training_seed"], sorted({facts["episodes"] for facts in played.facts})
    commits = sorted({str(facts.get("commit")) for facts in played.facts})
    yield (
        f"Policies of training seed {seed}; {' or '.join(map(str, counts))} episodes in each task and "
        f"arrangement; played at commit {', '.join(commits)}."
    )
