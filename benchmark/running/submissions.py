"""Reads submissions, and checks before they are played that they are of one version of the benchmark."""

from __future__ import annotations

import hashlib
import re
import zipfile
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from algorithms.registry import ALGORITHMS
from benchmark.experiment.environment import Environment
from benchmark.experiment.models import Evaluation, TrainingTask
from benchmark.experiment.runs import SCRIPTED, TaskSetting
from benchmark.experiment.version import ENVIRONMENT, SCENARIOS, changed_scenarios, differences, versions
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
from benchmark.running.played import scenario_digests
from benchmark.running.trained import trained_on
from smarts.agents.hosting.options import HostError
from smarts.agents.hosting.remote import RemoteAgent
from smarts.agents.interface import AgentInterface
from smarts.agents.policy import BatchAgent
from smarts.config import fitted
from smarts.errors import SmartsError, shown
from smarts.observations.lists import FeatureChoice, feature_list
from smarts.sstudio.locating import VARIATION_MARK
from smarts.zoo import make_agent
from smarts.zoo.exported import ExportedPolicy, exported_spec
from smarts_agent_kit.exported import TEAM
from smarts_agent_kit.weights import CONTENT, file_digest, weights_files

UNPACKED = 64_000_000
"""Bytes of a policy's weights in memory."""
DRIVING = {
    "vehicle_class": "vehicle",
    **{name: name for name in ("vehicle_model", "tyre_model", "flat_tyres")},
}
"""Field of an agent's interface -> setting of the environment."""


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
        SmartsError: It is no submission, or names another address; or a folder is given a version, scenarios
            or traffic, which it names itself.
    """
    folder = Path(given)
    if given.startswith(ADDRESS):
        return _at_address(given, number or max(versions()), scenarios, traffic), folder
    if number is not None or scenarios or traffic:
        raise ResultsError(
            "--benchmark-version, --scenario and --traffic are for an address: a folder names its own",
            place=given,
            remedy="leave it out",
        )
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
    for name in changed_scenarios(number, manifest.scenarios):
        yield f"its scenario {name} is not that of version {number}"
    for name in unlike_version(number, manifest.environment):
        yield f"its environment.{name} is not that of version {number}"
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
            try:
                policy = check_policy(entry, folder)
            except SmartsError as error:
                yield f"{entry}: {error.problem}"
                continue
            except Exception as error:  # of zip, of numpy or of a value of a wrong type
                kind = type(error).__name__
                yield f"{entry}: {agent}: not as `smarts-bench export` writes it ({kind}: {error})"
                continue
            agent, total = policy.digest, total + policy.size
        other = seeds.setdefault((entry.condition, agent), entry.seed)
        if other != entry.seed:
            yield f"{entry}: its policy is that of seed {other}"
    if total > LARGEST:
        yield f"its policies have {total:,} bytes, of at most {LARGEST:,}"


class Policy(NamedTuple):
    """What a check of a policy's files has found."""

    size: int
    """Size of the files [bytes]."""
    digest: str
    """Digest of the policy's weights, however they are packed."""


def check_policy(entry: Entry, folder: Path) -> Policy:
    """Return what the files of an entry's policy hold.

    Args:
        entry: Entry of the manifest.
        folder: Folder of the manifest.

    Raises:
        SmartsError: They are not those of the manifest, too large, of another training or version, or act on
            what they may not see.
        Exception: They hold no policy.
    """
    place = (folder / entry.agent).resolve()
    if not place.is_relative_to(folder.resolve()):
        raise RefusedError(f"its policy {entry.agent} is outside of the submission")
    files = files_of(place)
    size = sum(_size_of(entry, file) for file in files)
    trained = trained_on(place)
    for name, given in entry.names.items():
        if given != (found := getattr(trained, name)):
            raise RefusedError(f"its policy was trained with {name} {shown(found)}, not {shown(given)}")
    unpacked = sum(map(_unpacked, files[1:]))
    if unpacked > UNPACKED:
        raise RefusedError(f"{entry.agent}: its weights have {unpacked:,} bytes, of at most {UNPACKED:,}")
    policy = ExportedPolicy(place, TEAM)
    if policy.talks and entry.algorithm in ALGORITHMS and not ALGORITHMS[entry.algorithm].communication:
        raise RefusedError(f"its vehicles act on what others see, which those of {entry.algorithm} do not")
    found = hashlib.blake2b(digest_size=16)
    for array in policy.weights():
        found.update(str(array.shape).encode() + array.tobytes())
    return Policy(size, found.hexdigest())


def files_of(place: Path) -> list[Path]:
    """Return the files of an exported policy: its description, then its weights."""
    return [place / CONTENT, *weights_files(place)]


def _size_of(entry: Entry, file: Path) -> int:
    """Return the bytes of a file that is the one which its manifest describes."""
    name = f"{entry.agent}/{file.name}"
    if not file.is_file() or file.is_symlink():
        raise RefusedError(f"there is no file {name}")
    size = file.stat().st_size
    if size > LARGEST_FILE:
        raise RefusedError(f"{name} has more than {LARGEST_FILE:,} bytes")
    claims = entry.files or entry.scores or entry.episodes
    if claims and entry.files.get(file.name) != file_digest(file.read_bytes()):
        raise RefusedError(f"{name} is not the file that its manifest describes")
    return size


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
    except HostError:
        raise
    except SmartsError as error:
        raise RefusedError(error.problem, place=str(entry), remedy=error.remedy) from error
    if differing := [*_differing(agent, interface, environment)]:
        raise RefusedError("; ".join(differing), place=str(entry))
    return agent


def _made(entry: Entry, folder: Path) -> tuple[BatchAgent, AgentInterface]:
    if entry.is_remote:
        agent, interface = make_agent(entry.agent)
        if not isinstance(agent, RemoteAgent):
            raise RefusedError("acts on Observation objects", remedy="derive it from BatchAgent")
        return SeparateAgents(agent), interface
    interface = exported_spec(folder / entry.agent, TEAM).interface
    assert interface is not None
    return ExportedPolicy(folder / entry.agent, TEAM), interface


def _differing(agent: BatchAgent, interface: AgentInterface, environment: Environment) -> Iterator[str]:
    """Yield in what an agent observes, decides or drives otherwise than the version."""
    if unseen := undeclared(agent.observation, environment.observation):
        yield f"observes what the task does not declare: {', '.join(unseen)}"
    if agent.period != environment.decision_interval:
        yield f"decides every {agent.period} steps, not every {environment.decision_interval}"
    action = interface.action.name if interface.action is not None else None
    if action != environment.action:
        yield f"drives otherwise than the version: action {action}"
    for name, setting in DRIVING.items():
        wanted, has = getattr(environment, setting), getattr(interface, name)
        if [*has] != [*wanted]:  # texts, or sequences of wheels
            yield f"drives otherwise than the version: {name} {has}"


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
