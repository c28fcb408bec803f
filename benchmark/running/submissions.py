"""Reads submissions, and checks before they are played that they are of one version of the benchmark."""

from __future__ import annotations

import zipfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from benchmark.experiment.config import Evaluation, TrainingTask
from benchmark.experiment.environment import Environment
from benchmark.experiment.runs import VERSION, TaskSetting
from benchmark.experiment.version import (
    CODE,
    ENVIRONMENT,
    SCENARIOS,
    changed_code,
    changed_scenarios,
    changed_settings,
    versions,
)
from benchmark.results.files import ResultsError
from benchmark.results.release import (
    ADDRESS,
    LARGEST,
    LARGEST_FILE,
    MANIFEST,
    SEEDS,
    Entry,
    Manifest,
    file_digest,
    read_manifest,
)
from benchmark.running.evaluate_agent import trained_on
from benchmark.running.played import scenario_digests
from smarts.agents.interface import AgentInterface
from smarts.agents.policy import BatchAgent
from smarts.config import ConfigError, fitted
from smarts.errors import SmartsError
from smarts.observations.lists import FeatureChoice, feature_list
from smarts.zoo import make_agent
from smarts.zoo.exported import ExportedPolicy, exported_spec
from smarts_agent_kit.exported import CONTENT, TEAM, WEIGHTS

UNPACKED = 16 * LARGEST_FILE
"""Bytes of a policy's weights in memory."""
DRIVING = ("vehicle_class", "vehicle_model", "tyre_model", "flat_tyres")
SETTINGS = {"vehicle_class": "vehicle"}
"""Field of an interface -> setting of the environment, where the names differ."""


class RefusedError(SmartsError):
    """An entry of a submission is not evaluated, or its evaluation has failed."""


def submitted(
    given: str, *, number: int | None, scenarios: Sequence[str], traffic: Sequence[str]
) -> tuple[Manifest, Path]:
    """Return the manifest of what is submitted, and the folder that its policies are in.

    Args:
        given: A folder with a manifest, an exported policy, or tcp://HOST:PORT; the last two claim nothing.
        number: Version of the benchmark, of an address; by default the newest.
        scenarios: Of the version, that an address plays; by default all.
        traffic: Of the version, that an address plays; by default all.

    Raises:
        ResultsError: It is none of these.
    """
    folder = Path(given)
    if not given.startswith(ADDRESS) and (folder / MANIFEST).exists():
        return read_manifest(folder), folder
    if not given.startswith(ADDRESS) and (folder / CONTENT).exists():
        trained = trained_on(folder)
        kept = {name: trained[name] for name in ("algorithm", "task", "scenarios", "traffic", "seed")}
        version = trained.get(VERSION)
        entry = fitted({**kept, "benchmark_version": version, "agent": folder.name}, Entry, str(folder))
        manifest = Manifest(name=folder.name, benchmark_version=version, policies=[entry])
        return manifest, folder.absolute().parent
    if not given.startswith(ADDRESS):
        raise ResultsError(
            "there is no submission",
            place=given,
            remedy="give a folder that `smarts-bench release` or `export` has written, or tcp://HOST:PORT",
        )
    version = number or max(versions())
    frozen = versions().get(version, {}).get(SCENARIOS, {})
    label = given.removeprefix(ADDRESS).replace(":", "-")
    entries = [
        Entry(
            algorithm=label,
            task=name,
            scenarios=[name],
            traffic=each,
            seed=0,
            benchmark_version=version,
            agent=given,
        )
        for each, names in frozen.items()
        for name in names
        if "@" not in name and (not scenarios or name in scenarios) and (not traffic or each in traffic)
    ]
    if not entries:
        raise ResultsError(
            f"version {version} has no such scenario with such traffic",
            place="--scenario, --traffic",
            remedy="; ".join(f"with {each}: {', '.join(names)}" for each, names in frozen.items())
            or f"choose a version of {', '.join(map(str, versions()))}",
        )
    return Manifest(name=label, benchmark_version=version, policies=entries), folder


def check_manifest(manifest: Manifest, folder: Path) -> list[tuple[str, str]]:
    """Return marks of a submission, each with the algorithm and cell that it concerns.

    Raises:
        ResultsError: The submission is refused; names each reason.
    """
    if wrong := [*_wrong(manifest, folder)]:
        raise ResultsError(
            "the submission is refused:\n" + "\n".join(f"  {each}" for each in wrong),
            place=str(folder / MANIFEST),
            remedy="see docs/leaderboard.md for what a submission has to be",
        )
    marks = [("", f"misses, by its own manifest: {each}") for each in manifest.missing]
    seeds: dict[str, list[int]] = {}
    for entry in manifest.policies:
        seeds.setdefault(entry.cell, []).append(entry.seed)
    for cell, found in seeds.items():
        if len(found) < SEEDS:
            marks.append((cell, f"missing seeds: {len(found)} of at least {SEEDS}"))
    return marks


def _wrong(manifest: Manifest, folder: Path) -> Iterator[str]:
    """Yield why a submission is refused."""
    number = manifest.benchmark_version
    mixed = {entry.benchmark_version for entry in manifest.policies} | {number}
    if len(mixed) > 1:
        said = ", ".join("none" if each is None else str(each) for each in sorted(mixed, key=str))
        yield f"mixed versions of the benchmark: {said}"
        return
    if number not in versions():
        known = ", ".join(map(str, versions()))
        yield f"benchmark version {number or 'none'}: only {known} can be compared"
        return
    for part in changed_code(number):
        yield f"this program's code of {part} ({', '.join(CODE[part])}) is not that of version {number}"
    frozen = versions()[number]
    for part, digest in manifest.code.items():
        if frozen.get(part) != digest:
            yield f"its code of {part} is not that of version {number}"
    for name in changed_scenarios(number, manifest.scenarios):
        yield f"its scenario {name} is not that of version {number}"
    for name in _changed_settings(number, manifest.environment):
        yield f"its environment.{name} is not that of version {number}"
    yield from _wrong_entries(manifest, folder, number)


def _changed_settings(number: int, environment: dict[str, Any]) -> list[str]:
    try:
        return changed_settings(number, fitted(environment, Environment)) if environment else []
    except ConfigError:
        return ["(unreadable)"]


def _wrong_entries(manifest: Manifest, folder: Path, number: int) -> Iterator[str]:
    seen: set[Path] = set()
    played: dict[tuple[str, str], str] = {}
    total = 0
    for entry in manifest.policies:
        if entry.place in seen:
            yield f"{entry} is there twice"
        seen.add(entry.place)
        frozen = versions()[number][SCENARIOS].get(entry.traffic, {})
        foreign = [name for name in entry.scenarios if name not in frozen]
        for name in foreign:
            yield f"{entry}: {name}, {entry.traffic} is no scenario of version {number}"
        if not foreign and (entry.task, entry.traffic) not in played:
            digests = scenario_digests(task_of(manifest, entry))
            changed = changed_scenarios(number, {entry.traffic: digests})
            played[entry.task, entry.traffic] = "; ".join(changed)
            for name in changed:
                yield f"this program's scenario {name} is not that of version {number}"
        if not entry.agent.startswith(ADDRESS):
            wrong, size = _wrong_files(entry, folder, number)
            total += size
            if wrong:
                yield f"{entry}: {wrong}"
    if total > LARGEST:
        yield f"its policies have {total:,} bytes, of at most {LARGEST:,}"


def _wrong_files(entry: Entry, folder: Path, number: int) -> tuple[str, int]:
    """Return what is wrong with the files of a policy, and their size in bytes."""
    place = (folder / entry.agent).resolve()
    if not place.is_relative_to(folder.resolve()):
        return f"its policy {entry.agent} is outside of the submission", 0
    size = 0
    for name in (CONTENT, WEIGHTS):
        file = place / name
        if not file.is_file() or file.is_symlink():
            return f"there is no file {entry.agent}/{name}", size
        if file.stat().st_size > LARGEST_FILE:
            return f"{entry.agent}/{name} has more than {LARGEST_FILE:,} bytes", size
        content = file.read_bytes()
        size += len(content)
        if entry.files and entry.files.get(name) != file_digest(content):
            return f"{entry.agent}/{name} is not the file that its manifest describes", size
    try:
        with zipfile.ZipFile(place / WEIGHTS) as archive:
            if sum(each.file_size for each in archive.infolist()) > UNPACKED:
                return f"{entry.agent}/{WEIGHTS} is larger than {UNPACKED:,} bytes when it is unpacked", size
        trained = trained_on(place).get(VERSION)
    except (zipfile.BadZipFile, SmartsError) as error:
        return f"{entry.agent}: {error}", size
    if trained != number:
        said = "none" if trained is None else trained
        return f"mixed versions of the benchmark: its policy was trained under {said}", size
    return "", size


def task_of(manifest: Manifest, entry: Entry) -> TaskSetting:
    """Return what an entry is tested in: the environment that its version froze."""
    number = manifest.benchmark_version
    assert number is not None
    return TaskSetting(
        fitted({"name": entry.task, "scenarios": [*entry.scenarios]}, TrainingTask, str(entry)),
        entry.traffic,
        fitted(versions()[number][ENVIRONMENT], Environment),
        Evaluation(held_out_episodes=1),
        num_envs=1,
        benchmark_version=number,
    )


def agent_of(entry: Entry, folder: Path, environment: Environment) -> BatchAgent:
    """Return the agent of an entry.

    Raises:
        RefusedError: It observes what the task does not declare, acts in another way, or cannot be made.
    """
    try:
        agent, interface = _made(entry, folder)
    except SmartsError:
        raise
    except Exception as error:
        raise RefusedError(f"cannot be made: {type(error).__name__}: {error}", place=str(entry)) from error
    if not isinstance(agent, BatchAgent):
        raise RefusedError(
            "acts on Observation objects", place=str(entry), remedy="derive it from BatchAgent"
        )
    if unseen := undeclared(agent.observation, environment.observation):
        raise RefusedError(
            f"observes what the task does not declare: {', '.join(unseen)}",
            place=str(entry),
            remedy=f"observe no more than {environment.observation!r}",
        )
    if agent.period != environment.decision_interval:
        raise RefusedError(
            f"decides every {agent.period} steps, not every {environment.decision_interval}", place=str(entry)
        )
    action = interface.action.name if interface.action is not None else None
    differing = [] if action == environment.action else [f"action {action}"]
    for name in DRIVING:
        wanted, has = getattr(environment, SETTINGS.get(name, name)), getattr(interface, name)
        if [*has] != [*wanted]:  # texts, or sequences of wheels
            differing.append(f"{name} {has}")
    if differing:
        raise RefusedError(f"drives otherwise than the version: {', '.join(differing)}", place=str(entry))
    return agent


def _made(entry: Entry, folder: Path) -> tuple[Any, AgentInterface]:
    if entry.agent.startswith(ADDRESS):
        return make_agent(entry.agent)
    interface = exported_spec(folder / entry.agent, TEAM).interface
    assert interface is not None
    return ExportedPolicy(folder / entry.agent, TEAM), interface


def undeclared(observation: Any, declared: Any) -> list[str]:
    """Return the features of an observation that are not among those declared, or kept for longer."""
    asked, allowed = feature_list(observation), feature_list(declared)
    stacked = [_key(each) for each in allowed.stacked]
    every = [*stacked, *map(_key, allowed.features)]
    found = [each.name for each in asked.features if _key(each) not in every]
    found += [each.name for each in asked.stacked if _key(each) not in stacked]
    if asked.stacked and asked.frames > allowed.frames:
        found.append(f"{asked.frames} frames")
    return found


def _key(choice: FeatureChoice) -> tuple[str, str]:
    return choice.name, repr(sorted(choice.options.items()))
