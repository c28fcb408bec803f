"""What must be alike for results to be compared: environment, budget and sharing of parameters."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from benchmark.experiment.environment import engine_mark
from benchmark.experiment.own_code import code_names
from benchmark.experiment.runs import OWN_CODE, START, VERSION, known_inputs, with_defaults
from benchmark.experiment.version import prescribed
from benchmark.results.reading import Results, RunResult
from benchmark.results.release import SUBMISSION
from benchmark.results.run_folder import IMPORTS, comparable, differing_values, flat_values, with_own_defaults

COMPARED = ("environment", "budget", VERSION)
"""Keys of config.yaml. The environment holds agents, decision interval, observation, action, reward, vehicle,
friction and traffic engine; the horizon and the starts are the scenario's, by whose name results are kept
apart anyway."""
SUBMITTED = "as submitted"
"""Budget and sharing of evaluated submissions, which are ranked among each other."""
PRESCRIBED = "of the version"
"""Budget and sharing as the version prescribes them, which may differ by condition and algorithm."""
OWN_SHARING = "each algorithm's own"
"""Sharing of parameters between agents where the settings do not say which."""
SEEDS_DIFFER, SCENARIOS_DIFFER = "seeds were not trained alike", "scenarios differ between runs"
"""Why a condition of the main table does not count."""


def protocol_of(run: RunResult, results: Results) -> str:
    """Return what a run was made under, as a text that is equal if and only if the protocol is.

    A scripted policy is tested in the environment of the experiment's runs in the same condition. It has
    neither budget nor parameters, so without such runs these are as the version prescribes them.
    """
    config = run.config
    if SUBMISSION in run.facts:  # how it was trained is not known here
        kept = with_defaults({name: config[name] for name in ("environment", VERSION) if name in config})
        return json.dumps(dict.fromkeys(COMPARED) | kept | {"sharing": SUBMITTED}, sort_keys=True)
    like = run
    if run.is_scripted:
        beside = (each for each in results.runs if _cell(each) == _cell(run) and not each.is_scripted)
        like = next((each for each in beside if each.config), run)
    # Keys that an earlier version did not have are their defaults.
    config = with_defaults(
        {name: like.config[name] for name in (*COMPARED, "settings") if name in like.config}
    )
    settings = config.pop("settings", None) or {}
    content = dict.fromkeys(COMPARED) | config | {"sharing": settings.get("sharing", OWN_SHARING)}
    if START in like.config:
        content[START] = known_inputs(like.facts).get(START, like.config[START])
    if code := _code_of_environment(like):
        content[OWN_CODE] = code
    for name, value in prescribed(content[VERSION], like.algorithm, run.task, run.traffic).items():
        if value is not None and (like.is_scripted or content[name] == value):
            content[name] = PRESCRIBED
    return json.dumps(content, sort_keys=True)


def differing_scenarios(runs: Iterable[tuple[RunResult, str]]) -> list[str]:
    """Return a sentence for each scenario that was not the same in all finished runs of a condition.

    Runs that have not recorded what theirs were are left out.

    Args:
        runs: Each with its name.
    """
    return [
        f"The scenario {name} was not the same in all runs of {task}, {traffic}, which must not be compared: "
        + "; ".join(f"{digest} in {', '.join(names)}" for digest, names in versions.items())
        + "."
        for (name, task, traffic), versions in sorted(_scenario_versions(runs).items())
    ]


def _scenario_versions(
    runs: Iterable[tuple[RunResult, str]],
) -> dict[tuple[str, str, str], dict[str, list[str]]]:
    """Return the runs by digest of each scenario, task and traffic that have several digests."""
    found: dict[tuple[str, str, str], dict[str, list[str]]] = {}
    for run, called in runs:
        digests = run.scenarios if run.table is not None else {}
        for name, digest in zip(_without_places([*digests]), digests.values(), strict=True):
            found.setdefault((name, *_cell(run)), {}).setdefault(digest, []).append(called)
    return {place: versions for place, versions in found.items() if len(versions) > 1}


def _without_places(scenarios: Sequence[str]) -> list[str]:
    """Return the names of scenarios without the paths of their folders, if these tell no two apart."""
    names = [Path(each).name for each in scenarios]
    return names if len({*names}) == len(names) else [*scenarios]


def differing_trainings(runs: Iterable[RunResult], place: str = "") -> list[str]:
    """Return a sentence for each seed of an experiment that was not trained like the first of its condition.

    Args:
        runs: Runs of one experiment; unfinished ones are ignored.
        place: Before each run's name.
    """
    return [
        f"{place}{other} was not trained like seed {first.seed}, and must not be averaged with "
        f"it: {differing}."
        for first, other, differing in _differing_seeds(runs)
    ]


def _differing_seeds(runs: Iterable[RunResult]) -> Iterator[tuple[RunResult, RunResult, str]]:
    """Yield the first run of a condition, one that was not trained like it, and what differs."""
    cells: dict[tuple[str, str, str], list[RunResult]] = {}
    for run in runs:
        if run.table is not None and run.config and not run.is_scripted and SUBMISSION not in run.facts:
            cells.setdefault((run.algorithm, *_cell(run)), []).append(run)
    for first, *others in (sorted(each, key=lambda run: run.seed) for each in cells.values()):
        for other in others:
            one, two = (_training(run) for run in (first, other))
            if differing := differing_values(comparable(one, two), comparable(two, one)):
                yield first, other, differing


def _training(run: RunResult) -> dict[str, Any]:
    """Return all that a run's training depends on but its seed and where own code and scenarios are.

    What scenarios hold is for `differing_scenarios`.
    """
    config = {name: x for name, x in run.config.items() if name not in ("seed", IMPORTS)}
    content = with_own_defaults(config, run.facts)
    return content | {"scenarios": _without_places(content.get("scenarios", []))}


def unlike_runs(runs: Sequence[RunResult]) -> dict[tuple[str, str, str], str]:
    """Return why runs must not be averaged or compared, by algorithm, task and traffic; see the above.

    Of runs in different scenarios, those in the one of most runs may be; of runs that were tested on
    different traffic engines, those on SUMO.
    """
    found = {(run.algorithm, *_cell(run)): SEEDS_DIFFER for _, run, _ in _differing_seeds(runs)}
    finished = [run for run in runs if run.table is not None]
    for (_, *cell), versions in _scenario_versions((run, run.place) for run in finished).items():
        usual = _largest(versions.values())
        outside = [run for run in finished if _cell(run) == (*cell,) and run.place not in usual]
        found |= {(run.algorithm, *_cell(run)): SCENARIOS_DIFFER for run in outside}
    marks = engine_marks(finished)
    on_sumo = {_cell(run) for run in finished if (run.algorithm, *_cell(run)) not in marks}
    return found | {place: mark for place, mark in marks.items() if place[1:] in on_sumo}


def engine_marks(runs: Iterable[RunResult]) -> dict[tuple[str, str, str], str]:
    """Return the marks of runs that were tested on another engine than SUMO; see `engine_mark`."""
    marks = {
        (run.algorithm, *_cell(run)): engine_mark((run.config.get("environment") or {}).get("traffic_engine"))
        for run in runs
    }
    return {place: mark for place, mark in marks.items() if mark}


def _largest(groups: Iterable[list[str]]) -> list[str]:
    """Return the group that is larger than all others, empty if none is."""
    first, *others = sorted(groups, key=len, reverse=True)
    return first if all(len(each) < len(first) for each in others) else []


def _code_of_environment(run: RunResult) -> dict[str, str]:
    """Return the digests of the own code that a run's environment names, as far as they are known."""
    known = run.config.get(OWN_CODE) or {}
    return {name: known[name] for name in code_names(run.config.get("environment")) if name in known}


def _cell(run: RunResult) -> tuple[str, str]:
    return run.task, run.traffic


def described(protocols: Sequence[str]) -> list[str]:
    """Return what each protocol says; with several, only what is not the same in all."""
    flat = [flat_values(json.loads(each)) for each in protocols]
    flat = [{name: "none" if value is None else str(value) for name, value in each.items()} for each in flat]
    names = sorted({name for each in flat for name in each})
    if len(flat) > 1:
        names = [name for name in names if len({each.get(name) for each in flat}) > 1]
    return [
        ", ".join(f"{name} {each.get(name, 'not given')}" for name in names if not _is_in_parts(name, each))
        for each in flat
    ]


def _is_in_parts(name: str, given: Mapping[str, str]) -> bool:
    """Return whether a value is given by its parts, or as a whole of which the name is a part."""
    return name not in given and any(
        each.startswith(f"{name}.") or name.startswith(f"{each}.") for each in given
    )
