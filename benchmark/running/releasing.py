"""Writes a release: the last checkpoints of an experiment, exported, with what is claimed of them."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from importlib.metadata import version
from pathlib import Path

from benchmark.experiment.runs import run_from
from benchmark.experiment.version import code_digests
from benchmark.results.files import ResultsError, check_free, replaced_folder, write_json
from benchmark.results.plurals import listed
from benchmark.results.reading import Results, RunResult, read_results
from benchmark.results.release import (
    MANIFEST,
    POLICIES,
    SEEDS,
    Entry,
    Manifest,
    episode_digests,
    scores_of,
)
from benchmark.results.run_folder import RunFolder
from benchmark.results.versions import check_one_version, commits_of, unlike_version
from benchmark.running.exporting import export_policy
from smarts_agent_kit.weights import file_digest


def write_release(
    root: Path, out: Path, *, author: str = "", is_partial: bool = False, imports: Sequence[str | Path] = ()
) -> Manifest:
    """Write the release of an experiment and return its manifest.

    Args:
        root: The experiment's results, tested with greedy acting.
        out: Folder of the release, new or empty.
        author: Shown on the leaderboard.
        is_partial: Whether runs and seeds may be missing; the manifest then names them.
        imports: Files and folders of own code, by default the ones of the training.

    Raises:
        ResultsError: Runs are of several versions of the benchmark or several commits, or not as the version
            froze it, or are missing; names each. Or their tests have conditions, or the folder holds
            something.
        SmartsError: A policy cannot be exported.
    """
    check_free(out)
    results = read_results(root)
    finished = [run for run in results.finished if not run.is_scripted]
    if conditioned := [run for run in finished if run.test]:
        raise ResultsError(
            f"the test of {conditioned[0]} is of conditions of its own, which `verify` does not play",
            place=str(root),
            remedy="give policies that `smarts-bench export` writes to `smarts-bench evaluate`",
        )
    runs = [run for run in finished if RunFolder(root / run.place).checkpoint.exists()]
    check_one_version(results.runs, str(root))
    scenarios: dict[str, dict[str, str]] = {}
    wrong = [*_wrong(finished, scenarios)] if finished else ["no trained run is finished"]
    if wrong:
        raise ResultsError(
            f"not to be released: {'; '.join(wrong)}", place=str(root), remedy="train these runs, or again"
        )
    missing = [f"{run} has no last checkpoint here" for run in finished if run not in runs]
    missing += _missing(results, runs)
    if missing and not (is_partial and runs):
        raise ResultsError(
            f"incomplete: {'; '.join(missing)}",
            place=str(root),
            remedy="finish the experiment, or give --partial: the manifest then names what is missing",
        )
    with replaced_folder(out) as folder:
        manifest = Manifest(
            name=results.name,
            author=author,
            benchmark_version=runs[0].benchmark_version,
            program=version("smarts-bench"),
            code=code_digests(),
            environment=dict(runs[0].config["environment"]),
            scenarios=scenarios,
            missing=missing,
            policies=[_entry(root, run, folder, imports) for run in runs],
        )
        write_json(folder / MANIFEST, manifest.content())
    return manifest


def _wrong(runs: Sequence[RunResult], scenarios: dict[str, dict[str, str]]) -> Iterator[str]:
    """Yield what forbids a release, and fill the digests of its scenarios by traffic."""
    number = runs[0].benchmark_version
    commits = {commit for run in runs for commit in commits_of(run)}
    if number is not None and (len(commits) > 1 or any(commit.endswith("+") for commit in commits)):
        yield f"runs are not of one clean commit, but of {', '.join(sorted(commits))}"
    for run in runs:
        known = scenarios.setdefault(run.traffic, {})
        for scenario, digest in run.scenarios.items():
            if known.setdefault(scenario, digest) != digest:
                yield f"{run}: the scenario {scenario} is another than that of other runs"
        if number is None:
            continue
        for name in unlike_version(number, {run.traffic: run.scenarios}, run.config["environment"]):
            yield f"{run}: {name} is not as version {number} froze it"


def _missing(results: Results, runs: Sequence[RunResult]) -> Iterator[str]:
    """Yield runs that are not finished, not tested with greedy acting, or too few, by condition."""
    unfinished: dict[tuple[str, str], list[int]] = {}
    planned: dict[str, list[int]] = {}
    for run in results.unfinished:
        if not run.is_scripted:
            unfinished.setdefault((_condition(run), run.status), []).append(run.seed)
            planned.setdefault(_condition(run), []).append(run.seed)
    for (condition, status), seeds in unfinished.items():
        yield f"{condition}, {listed('seed', seeds)}: {status}"
    for run in runs:
        assert run.table is not None
        if "greedy" not in set(run.table["mode"]):
            yield f"{run} was not tested with greedy acting"
        planned.setdefault(_condition(run), []).append(run.seed)
    for condition, seeds in planned.items():
        if len(seeds) < SEEDS:
            yield f"{condition} has {listed('seed', seeds)} alone, of at least {SEEDS}"


def _condition(run: RunResult) -> str:
    return f"{run.algorithm}, {run.task}, {run.traffic}"


def _entry(root: Path, run: RunResult, folder: Path, imports: Sequence[str | Path]) -> Entry:
    """Export a run's policy into a release, and return what is claimed of it."""
    path = root / run.place
    name = re.sub(r"[^a-z0-9]+", "-", f"{run.algorithm}-{run.task}-{run.traffic}-{run.seed}".lower())
    name = name.strip("-") if name[:1].isalpha() else f"policy-{name.strip('-')}"
    policy = export_policy(path, name, folder / POLICIES, checkpoint="last", imports=imports)
    return Entry(
        algorithm=run.algorithm,
        task=run.task,
        scenarios=[*run_from(RunFolder(path).read_config()).task_setting.task.trained_on],
        traffic=run.traffic,
        seed=run.seed,
        benchmark_version=run.benchmark_version,
        agent=policy.relative_to(folder).as_posix(),
        commit=commits_of(run)[-1],
        files={each.name: file_digest(each.read_bytes()) for each in sorted(policy.iterdir())},
        scores=scores_of(run.table),
        episodes=episode_digests(run.table),
    )
