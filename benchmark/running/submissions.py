"""Reads submissions, and checks before they are played that they are of one version of the benchmark."""

from __future__ import annotations

import hashlib
import re
import zipfile
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from algorithms.registry import ALGORITHMS
from benchmark.experiment.environment import Environment
from benchmark.experiment.models import Evaluation, TrainingTask
from benchmark.experiment.runs import SCRIPTED, TaskSetting
from benchmark.experiment.version import ENVIRONMENT, SCENARIOS, differences, versions
from benchmark.results.files import ResultsError
from benchmark.results.release import (
    ADDRESS,
    LARGEST,
    LARGEST_FILE,
    MANIFEST,
    SUBMISSION,
    Entry,
    Manifest,
    Training,
    read_manifest,
)
from benchmark.results.versions import unlike_version
from benchmark.running.blind import RefusedError, SeparateAgents
from benchmark.running.evaluating import batch_agent, environment_of
from benchmark.running.played import scenario_digests
from benchmark.running.trained import trained_on
from smarts.agents.hosting.options import HostError
from smarts.agents.interface import AgentInterface
from smarts.agents.policy import BatchAgent
from smarts.config import fitted
from smarts.errors import SmartsError, shown
from smarts.observations.lists import FeatureChoice, feature_list
from smarts.sstudio.locating import VARIATION_MARK
from smarts.zoo.exported import ExportedPolicy, exported_spec
from smarts_agent_kit.exported import TEAM
from smarts_agent_kit.weights import CONTENT, file_digest, weights_files

if TYPE_CHECKING:
    from smarts.agents.hosting.remote import RemoteAgent

UNPACKED = 64_000_000
"""Bytes of a policy's weights in memory."""


def submitted(
    given: str,
    *,
    number: int | None = None,
    scenarios: Sequence[str] = (),
    traffic: Sequence[str] = (),
    addresses: Sequence[str] = (),
) -> tuple[Manifest, Path]:
    """Return the manifest of what is submitted, and the folder that its policies are in.

    Args:
        given: A folder with a manifest, an exported policy, or tcp://HOST:PORT; the last two claim nothing.
        number: Version of the benchmark, of an address; by default the newest.
        scenarios: Scenarios of the version, that an address plays; by default all.
        traffic: Traffic of the version, that an address plays; by default all.
        addresses: Addresses that a manifest may name: nothing is sent to others.

    Raises:
        SmartsError: It is no submission, or names another address.
    """
    folder = Path(given)
    if given.startswith(ADDRESS):
        return _at_address(given, number or max(versions()), scenarios, traffic), folder
    if (folder / MANIFEST).exists():
        manifest = read_manifest(folder)
        named = {entry.agent for entry in manifest.policies if entry.is_remote}
        if foreign := sorted(named - {*addresses}):
            raise ResultsError(
                f"its agents are at {', '.join(foreign)}",
                place=str(folder / MANIFEST),
                remedy="if you know these addresses, name each by --address: nothing is sent to others",
            )
        return manifest, folder
    if (folder / CONTENT).exists():
        entry = Entry(**trained_on(folder).names, agent=folder.name)
        return _claiming_nothing([entry], folder.name), folder.absolute().parent
    raise ResultsError(
        "there is no submission",
        place=given,
        remedy="give a folder that `smarts-bench release` or `export` has written, or tcp://HOST:PORT",
    )


def _claiming_nothing(entries: list[Entry], name: str) -> Manifest:
    return Manifest(name=_label(name), benchmark_version=entries[0].benchmark_version, policies=entries)


def _label(text: str) -> str:
    """Return a text without what cannot be in the name of a folder."""
    return re.sub(r"[^A-Za-z0-9._-]+", "-", text).strip("-._") or "agent"


def _at_address(address: str, version: int, scenarios: Sequence[str], traffic: Sequence[str]) -> Manifest:
    """Return a manifest of an agent that is served: it plays each scenario of a version, once."""
    frozen = versions().get(version, {}).get(SCENARIOS, {})
    there = [(name, each) for each in frozen for name in frozen[each] if VARIATION_MARK not in name]
    wanted = [
        (name, each)
        for name, each in there
        if (not scenarios or name in scenarios) and (not traffic or each in traffic)
    ]
    if not wanted:
        known = "; ".join(f"{name} with {each}" for name, each in there)
        raise ResultsError(
            f"version {version} has no such scenario with such traffic",
            place="--scenario, --traffic",
            remedy=known or f"choose a version of {', '.join(map(str, versions()))}",
        )
    name = address.removeprefix(ADDRESS)
    given = {"algorithm": _label(name), "seed": 0, "benchmark_version": version, "agent": address}
    entries = [Entry(task=task, scenarios=[task], traffic=each, **given) for task, each in wanted]
    return _claiming_nothing(entries, name)


def check_manifest(manifest: Manifest, folder: Path) -> None:
    """Raise if a submission cannot be evaluated.

    Raises:
        ResultsError: The submission is refused, for each reason that is named; or this program is not as the
            version froze it.
    """
    if wrong := [*_wrong(manifest, folder)]:
        raise ResultsError(
            "the submission is refused:\n" + "\n".join(f"  {each}" for each in wrong),
            place=str(folder / MANIFEST),
            remedy="see docs/guide/leaderboard.md",
        )
    number = manifest.benchmark_version
    assert number is not None
    played: dict[str, dict[str, str]] = {}
    for entry in {(each.traffic, each.task): each for each in manifest.policies}.values():
        played.setdefault(entry.traffic, {}).update(scenario_digests(task_of(entry)))
    if changed := differences(number, played, fitted(versions()[number][ENVIRONMENT], Environment)):
        raise ResultsError(
            f"this program is not as version {number} froze it: {'; '.join(changed)}",
            place=str(folder / MANIFEST),
            remedy="git checkout -- .",
        )


def _wrong(manifest: Manifest, folder: Path) -> Iterator[str]:
    """Yield why a submission is refused."""
    number = manifest.benchmark_version
    mixed = {entry.benchmark_version for entry in manifest.policies} | {number}
    if len(mixed) > 1 or number not in versions():
        said = ", ".join("none" if each is None else str(each) for each in sorted(mixed, key=str))
        yield f"its trainings are of version {said} of the benchmark, and known is one of {[*versions()]}"
        return
    for part, digest in manifest.code.items():
        if versions()[number].get(part) != digest:
            yield f"its code of {part} is not that of version {number}"
    for name in unlike_version(number, manifest.scenarios, manifest.environment):
        yield f"its {name} is not that of version {number}"
    for entry in manifest.policies:
        yield from _wrong_names(entry, versions()[number][SCENARIOS])
    for name, count in Counter(map(str, manifest.policies)).items():
        if count > 1:
            yield f"{name} is there twice"
    yield from _wrong_policies(manifest, folder)


def _wrong_names(entry: Entry, scenarios: Mapping[str, Any]) -> Iterator[str]:
    if entry.algorithm in (SCRIPTED, SUBMISSION):
        yield f"{entry}: results need the name {entry.algorithm} for something else"
    if entry.scenarios != [entry.task]:
        yield f"{entry}: plays {', '.join(entry.scenarios)}, which is another task than {entry.task}"
    elif entry.task not in scenarios.get(entry.traffic, {}):
        yield f"{entry}: {entry.task}, {entry.traffic} is no scenario of the version"


def _wrong_policies(manifest: Manifest, folder: Path) -> Iterator[str]:
    """Yield what is wrong with the policies: with each, or that some are too large or are one."""
    seeds: dict[tuple[str, str], int] = {}
    total = 0
    for entry in manifest.policies:
        agent = entry.agent
        if not entry.is_remote:
            if fault := _fault(entry, folder):
                yield f"{entry}: {fault}"
                continue
            place = folder / agent
            agent = _digest_of(ExportedPolicy(place, TEAM))
            total += sum(file.stat().st_size for file in files_of(place))
        other = seeds.setdefault((entry.condition, agent), entry.seed)
        if other != entry.seed:
            yield f"{entry}: its policy is that of seed {other}"
    if total > LARGEST:
        yield f"its policies have {total:,} bytes, of at most {LARGEST:,}"


def _digest_of(policy: ExportedPolicy) -> str:
    """Return the digest of a policy's weights, however they are packed."""
    found = hashlib.blake2b(digest_size=16)
    for array in policy.weights():
        found.update(str(array.shape).encode() + array.tobytes())
    return found.hexdigest()


def _fault(entry: Entry, folder: Path) -> str:
    """Return what is wrong with an entry's policy, "" if nothing is."""
    try:
        return next(_faults(entry, folder), "")
    except SmartsError as error:
        return error.problem
    except Exception as error:  # of zip, of numpy or of a value of a wrong type
        return f"{entry.agent}: not as `smarts-bench export` writes it ({type(error).__name__}: {error})"


def _faults(entry: Entry, folder: Path) -> Iterator[str]:
    """Yield what is wrong with an entry's policy: what stands first is what may be read of it next."""
    place = (folder / entry.agent).resolve()
    if not place.is_relative_to(folder.resolve()):
        yield f"its policy {entry.agent} is outside of the submission"
    files = files_of(place)
    for file in files:
        yield from _faults_of_file(entry, file)
    trained = trained_on(place)
    for name, given in entry.names.items():
        if given != (found := getattr(trained, name)):
            yield f"its policy was trained with {name} {shown(found)}, not {shown(given)}"
    unpacked = sum(map(_unpacked, files[1:]))
    if unpacked > UNPACKED:
        yield f"{entry.agent}: its weights have {unpacked:,} bytes, of at most {UNPACKED:,}"
    is_open = entry.algorithm not in ALGORITHMS or ALGORITHMS[entry.algorithm].communication
    if ExportedPolicy(place, TEAM).talks and not is_open:  # which reads all weights
        yield f"its vehicles act on what others see, which those of {entry.algorithm} do not"


def _faults_of_file(entry: Entry, file: Path) -> Iterator[str]:
    """Yield what is wrong with a file of an entry's policy, before it is read as what it should be."""
    name = f"{entry.agent}/{file.name}"
    if not file.is_file() or file.is_symlink():
        yield f"there is no file {name}"
    if file.stat().st_size > LARGEST_FILE:
        yield f"{name} has more than {LARGEST_FILE:,} bytes"
    claims = entry.files or entry.scores or entry.episodes
    if claims and entry.files.get(file.name) != file_digest(file.read_bytes()):
        yield f"{name} is not the file that its manifest describes"


def files_of(place: Path) -> list[Path]:
    """Return the files of an exported policy: its description, then its weights."""
    return [place / CONTENT, *weights_files(place)]


def _unpacked(file: Path) -> int:
    """Return the bytes of all members by the archive's table: `smarts_agent_kit.weights` reads no more."""
    with zipfile.ZipFile(file) as archive:
        return sum(member.file_size for member in archive.infolist())


def task_of(entry: Training) -> TaskSetting:
    """Return what an entry is tested in: the environment that its version froze."""
    number = entry.benchmark_version
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
    """Return the agent of an entry, which sees of each vehicle what that one sees.

    Raises:
        RefusedError: It observes what the task does not declare, acts in another way, or cannot be made.
        HostError: It cannot be reached, or what it says of itself cannot be.
    """
    try:
        agent, interface = _made(entry, folder)
        differing = [*_differing(agent, interface, environment)]
    except HostError:
        raise
    except SmartsError as error:
        raise RefusedError(error.problem, place=str(entry), remedy=error.remedy) from error
    if differing:
        raise RefusedError("; ".join(differing), place=str(entry))
    return agent


def _made(entry: Entry, folder: Path) -> tuple[BatchAgent, AgentInterface]:
    if entry.is_remote:
        agent, interface = batch_agent(entry.agent)
        return SeparateAgents(cast("RemoteAgent", agent)), interface
    interface = exported_spec(folder / entry.agent, TEAM).interface
    assert interface is not None
    return ExportedPolicy(folder / entry.agent, TEAM), interface


def _differing(agent: BatchAgent, interface: AgentInterface, environment: Environment) -> Iterator[str]:
    """Yield in what an agent observes, decides or drives otherwise than the version."""
    if unseen := undeclared(agent.observation, environment.observation):
        yield f"observes what the task does not declare: {', '.join(unseen)}"
    if agent.period != environment.decision_interval:
        yield f"decides every {agent.period} steps, not every {environment.decision_interval}"
    driven = environment_of(agent, interface, environment.agent_count, None, "the agent")
    for name in ("action", "vehicle", "vehicle_model", "tyre_model", "flat_tyres"):
        if (found := getattr(driven, name)) != getattr(environment, name):
            yield f"drives otherwise than the version: {name} {found}"


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
