"""Provenance of results: runs with their times and speeds, versions, machines, commands."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from datetime import timedelta
from typing import Any

from benchmark.experiment.runs import OWN_CODE, START
from benchmark.experiment.version import has_settings_of, tuning
from benchmark.metrics.table import COUNTS
from benchmark.report.paper import algorithm_label, task_label
from benchmark.results.plurals import counted, listed
from benchmark.results.reading import NOT_BEGUN, Results, RunResult
from benchmark.results.release import SUBMISSION
from benchmark.results.run_folder import CONTINUED, IMPORTS

RUN_COLUMNS = {
    "algorithm": "Or scripted policy",
    "task": "What is driven",
    "traffic": "Social vehicles on the road",
    "seed": "Of training",
    "status": "Only runs that are finished are in the tables",
    "agent-steps": "Steps of 0.1 s, once for each agent on the road; a decision takes decision_interval",
    "training": "Wall-clock time of training",
    "steps/s": "Agent-steps per second of training, learning included",
    "test": "Wall-clock time of the test",
    "begun": "By the machine's clock",
    "ended": "By the machine's clock",
}
"""Title and meaning of the columns of the table of runs."""


CHANGED = " (+: with changes that were not committed)"
"""What the sign behind a commit means."""


def run_rows(results: Results) -> list[list[str]]:
    """Return a row for each run that has begun, with `RUN_COLUMNS`; `gaps` has the others."""
    return [_row(run) for run in results.runs if run.status != NOT_BEGUN]


def _row(run: RunResult) -> list[str]:
    """Return what is known of a run; empty texts for what is not."""
    steps, training, speed = "", "", ""
    if run.progress is not None:
        last = run.progress.iloc[-1]
        count, seconds = float(last["agent_steps"]), float(last["seconds"])
        steps, training = f"{count:,.0f}", duration(seconds)
        speed = f"{count / seconds:,.0f}" if seconds > 0 else ""
    test = run.facts.get("test_seconds")
    return [
        *(run.algorithm, run.task, run.traffic, "" if run.is_scripted else str(run.seed), run.status),
        *(steps, training, speed, "" if test is None else duration(float(test))),
        *(str(run.facts.get(name, "")) for name in ("begun", "ended")),
    ]


def duration(seconds: float) -> str:
    """Return a time in hours, minutes and seconds."""
    return str(timedelta(seconds=round(seconds)))


def circumstances(results: Results) -> list[tuple[str, list[str]]]:
    """Return name and distinct values of commit, versions, machine and config of the runs."""
    begun = [run.facts for run in results.runs if run.facts]
    facts = [each for run in begun for each in (run, *run.get(CONTINUED, ()))]
    configs = [run.config for run in results.runs]
    learnt = (run for run in results.runs if run.config and not run.is_scripted)
    commits = _values("commit", facts)
    found = {
        "Benchmark version": _distinct(map(_version, results.finished)),
        "Commit" + CHANGED * any(each.endswith("+") for each in commits): commits,
        "Python": _values("python", facts),
        "Versions": _values("versions", facts),
        "Machine (processor, cores, system)": _distinct(map(_machine, facts)),
        "Own code": _distinct(", ".join(config.get(IMPORTS, ())) for config in configs),
        "Digests of own code": _values(OWN_CODE, configs),
        "Environment": _values("environment", configs),
        "Budget": _values("budget", configs),
        "Tuning": _tuning(results),
        "Continued after an interruption, or tested again": _continued(results),
        "Settings": _distinct(f"{run.algorithm}: {_text(run.config.get('settings'))}" for run in learnt),
    }
    return [(name, values) for name, values in found.items() if values]


def _continued(results: Results) -> list[str]:
    """Return which algorithms have runs that were not trained and tested in one go."""
    known = [run for run in results.runs if run.facts]
    runs = Counter(run.algorithm for run in known)
    found = Counter(run.algorithm for run in known if run.facts.get(CONTINUED))
    return [_some_runs(name, count, runs[name]) for name, count in found.items()]


def _tuning(results: Results) -> list[str]:
    """Return which algorithms of a version had how many trials to find their settings.

    A version knows that of its table's settings alone. How submissions were tuned is not known here.
    """
    trained = [run for run in results.finished if not run.is_scripted and SUBMISSION not in run.facts]
    known = next(filter(None, (tuning(run.benchmark_version) for run in trained)), None)
    if known is None:
        return []
    runs = Counter(run.algorithm for run in trained)
    found: dict[str, Counter[str]] = {}
    for run in trained:
        search = known["algorithms"].get(run.algorithm)
        if not _has_settings_of_version(run):
            size = "not known, settings are not the version's"
        elif search is None:
            size = "none that is known"
        else:
            size = f"{search['trials']} trials of {search['agent_steps']:,} agent-steps each"
            size += f" ({known['results']})"
        found.setdefault(size, Counter())[run.algorithm] += 1
    return [
        f"{', '.join(_some_runs(name, count, runs[name]) for name, count in counts.items())}: {size}"
        for size, counts in found.items()
    ]


def _has_settings_of_version(run: RunResult) -> bool:
    settings = run.config.get("settings") or {}
    return has_settings_of(run.benchmark_version, run.algorithm, run.task, run.traffic, settings)


def _some_runs(algorithm: str, count: int, total: int) -> str:
    label = algorithm_label(algorithm)
    return label if count == total else f"{label} in {count} of {counted(total, 'run')}"


def _machine(facts: Mapping[str, Any]) -> str:
    return ", ".join(filter(None, (_text(facts.get(name)) for name in ("processor", "cores", "system"))))


def _version(run: RunResult) -> str:
    return str(run.benchmark_version or "none: an experiment of its own, or made before version 1")


def commands(results: Results) -> list[str]:
    """Return the commands that made the results, and the one that makes the report again."""
    return [*results.commands, f"smarts-bench report {results.root}"]


def beginnings(results: Results) -> list[str]:
    """Return a sentence for each task whose trainings began with weights of another run."""
    found = dict.fromkeys((run.task, run.config[START]) for run in results.runs if START in run.config)
    return [f"{task_label(task)}: trainings began with the weights of {origin}." for task, origin in found]


def totals(results: Results) -> list[str]:
    """Return sentences on finished runs and measured episodes, scripted policies apart from algorithms."""
    counts = results.counts
    runs = results.runs
    algorithms, scripted = ([run for run in runs if run.is_scripted == which] for which in (False, True))
    names = ", ".join(dict.fromkeys(algorithm_label(run.algorithm) for run in algorithms))
    groups = [(names, algorithms), ("Scripted policies", scripted)]
    lines = [_finished(name, of_group) for name, of_group in groups if of_group] or ["There are no runs."]
    lines += beginnings(results)
    discarded = {
        "in which vehicles overlapped at the start": counts["invalid"],
        "cut short": counts["incomplete"],
        "that cannot be read": len(counts["corrupted"]),
    }
    lines += [
        f"{counted(number, 'episode')} {why}: discarded." for why, number in discarded.items() if number
    ]
    return lines


def _finished(name: str, runs: Sequence[RunResult]) -> str:
    tables = [run.table for run in runs if run.table is not None]
    episodes = sum(table.attrs[COUNTS]["measured"] for table in tables)
    finished = f"{len(tables)} of {counted(len(runs), 'run')} finished"
    return f"{name}: {finished}, {counted(episodes, 'test episode')} measured."


def gaps(results: Results) -> list[tuple[str, str]]:
    """Return name and reason of what is missing: runs, files, episodes; a line for a condition's seeds."""
    by_cell: dict[tuple[str, str, str, str], list[int]] = {}
    for run in results.unfinished:
        reason = "not begun" if run.status == NOT_BEGUN else f"not finished: {run.status}"
        seeds = by_cell.setdefault((run.algorithm, reason, run.task, run.traffic), [])
        if not run.is_scripted:
            seeds.append(run.seed)
    tasks: dict[tuple[str, str, str], list[str]] = {}
    for (algorithm, reason, task, traffic), seeds in by_cell.items():
        label = algorithm + (f", {listed('seed', seeds)}" if seeds else "")
        tasks.setdefault((label, traffic, reason), []).append(task)
    runs = [(f"{label}, {', '.join(each)}, {traffic}", why) for (label, traffic, why), each in tasks.items()]
    episodes = [(f"episode {name}", reason) for name, reason in results.counts["corrupted"].items()]
    return [*runs, *results.problems.items(), *episodes]


def _text(value: Any) -> str:
    if isinstance(value, dict):
        return ", ".join(f"{name} {'none' if each is None else _text(each)}" for name, each in value.items())
    return "" if value is None else str(value)


def _values(name: str, contents: Iterable[Mapping[str, Any]]) -> list[str]:
    return _distinct(content.get(name) for content in contents)


def _distinct(values: Iterable[Any]) -> list[str]:
    return [value for value in dict.fromkeys(map(_text, values)) if value]
