"""Reads submissions, and checks before they are played that they are of one version of the benchmark."""

from __future__ import annotations

import hashlib
import re
import zipfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from numpy.typing import NDArray

from algorithms.registry import ALGORITHMS
from benchmark.experiment.config import Evaluation, TrainingTask
from benchmark.experiment.environment import Environment
from benchmark.experiment.runs import SCRIPTED, VERSION, TaskSetting
from benchmark.experiment.version import (
    CODE,
    ENVIRONMENT,
    SCENARIOS,
    changed_code,
    changed_scenarios,
    versions,
)
from benchmark.results.commands import COMMAND
from benchmark.results.files import ResultsError
from benchmark.results.reading import REPORT
from benchmark.results.release import (
    ADDRESS,
    LARGEST,
    LARGEST_FILE,
    MANIFEST,
    SUBMISSION,
    VERDICTS,
    Entry,
    Manifest,
    read_manifest,
)
from benchmark.results.robustness import ROBUSTNESS
from benchmark.results.versions import unlike_version
from benchmark.running.blind import SeparateAgents
from benchmark.running.played import scenario_digests
from benchmark.running.trained import trained_on
from smarts.agents.hosting.options import HostError
from smarts.agents.hosting.remote import RemoteAgent
from smarts.agents.interface import AgentInterface
from smarts.agents.policy import ActionBatch, BatchAgent
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
SAME = ("algorithm", "task", "scenarios", "traffic", "seed")
"""What a policy and its entry in the manifest both name."""


class RefusedError(SmartsError):
    """An entry of a submission is not evaluated, or its evaluation has failed."""


class Policy(NamedTuple):
    """What a check of a policy's files has found."""

    size: int
    """Size of the files [bytes]."""
    digest: str
    """Digest of the policy's weights, however they are packed."""
    talks: bool
    """Whether its vehicles act on what others see."""


def check_policy(entry: Entry, folder: Path, number: int) -> Policy:
    """Return what the files of an entry's policy hold.

    Args:
        entry: Entry of the manifest.
        folder: Folder of the manifest.
        number: Version of the benchmark.

    Raises:
        RefusedError: They are not those of the manifest, too large, of another training or version, or hold
            no policy; names what is wrong.
    """
    place = (folder / entry.agent).resolve()
    if not place.is_relative_to(folder.resolve()):
        raise _refused(entry, f"its policy {entry.agent} is outside of the submission")
    files = files_of(place)
    size = sum(_size_of(entry, file) for file in files)
    try:
        _check_training(entry, place, number)
        unpacked = sum(map(_unpacked, files[1:]))
        if unpacked > UNPACKED:
            raise _refused(
                entry, f"{entry.agent}: its weights have {unpacked:,} bytes, of at most {UNPACKED:,}"
            )
        policy = ExportedPolicy(place, TEAM)
    except RefusedError:
        raise
    except SmartsError as error:
        raise _refused(entry, f"{entry.agent}: {error.problem}") from error
    except Exception as error:  # of zip, of numpy or of a value of a wrong type
        raise _refused(
            entry, f"{entry.agent}: not as `smarts-bench export` writes it ({type(error).__name__}: {error})"
        ) from error
    found = hashlib.blake2b(digest_size=16)
    for array in policy.weights():
        found.update(str(array.shape).encode() + array.tobytes())
    return Policy(size, found.hexdigest(), policy.talks)


def files_of(place: Path) -> list[Path]:
    """Return the files of an exported policy: its description, then its weights."""
    return [place / CONTENT, *weights_files(place)]


def _size_of(entry: Entry, file: Path) -> int:
    """Return the bytes of a file that is the one which its manifest describes."""
    name = f"{entry.agent}/{file.name}"
    if not file.is_file() or file.is_symlink():
        raise _refused(entry, f"there is no file {name}")
    size = file.stat().st_size
    if size > LARGEST_FILE:
        raise _refused(entry, f"{name} has more than {LARGEST_FILE:,} bytes")
    claims = entry.files or entry.scores or entry.episodes
    if claims and entry.files.get(file.name) != file_digest(file.read_bytes()):
        raise _refused(entry, f"{name} is not the file that its manifest describes")
    return size


def _check_training(entry: Entry, place: Path, number: int) -> None:
    """Raise if a policy is of another training than its entry says."""
    trained = trained_on(place)
    if trained.benchmark_version != number:
        said = "none" if trained.benchmark_version is None else trained.benchmark_version
        raise _refused(entry, f"mixed versions of the benchmark: its policy was trained under {said}")
    for name in SAME:
        given, found = getattr(entry, name), getattr(trained, name)
        if given != found:
            raise _refused(entry, f"its policy was trained with {name} {shown(found)}, not {shown(given)}")


def _unpacked(file: Path) -> int:
    """Return the bytes of all members by the archive's table: `smarts_agent_kit.weights` reads no more."""
    with zipfile.ZipFile(file) as archive:
        return sum(member.file_size for member in archive.infolist())


def _refused(entry: Entry, problem: str) -> RefusedError:
    return RefusedError(problem, place=str(entry), remedy="submit what `smarts-bench release` has written")


RESERVED = (SCRIPTED, SUBMISSION, ROBUSTNESS, MANIFEST, VERDICTS, REPORT, COMMAND)
"""Names in a folder of results that no algorithm can have."""
DRIVING = ("vehicle_class", "vehicle_model", "tyre_model", "flat_tyres")
OWN = "this program's"
"""Begins what is wrong with the program that verifies, not with what is submitted."""
SETTINGS = {"vehicle_class": "vehicle"}
"""Field of an interface -> setting of the environment, where the names differ."""


def submitted(
    given: str,
    *,
    number: int | None,
    scenarios: Sequence[str],
    traffic: Sequence[str],
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
        ResultsError: It is no submission, or names another address; or a folder is given a version, scenarios
            or traffic, which it names itself.
    """
    folder = Path(given)
    if given.startswith(ADDRESS):
        number = max(versions()) if number is None else number
        return _at_address(given, number, scenarios, traffic), folder
    if number is not None or scenarios or traffic:
        raise ResultsError(
            "--benchmark-version, --scenario and --traffic are for an address: a folder names its own",
            place=given,
            remedy="leave it out",
        )
    if (folder / MANIFEST).exists():
        manifest = read_manifest(folder)
        named = {entry.agent for entry in manifest.policies if entry.agent.startswith(ADDRESS)}
        if foreign := sorted(named - {*addresses}):
            raise ResultsError(
                f"its agents are at {', '.join(foreign)}",
                place=str(folder / MANIFEST),
                remedy="if you know these addresses, name each by --address: nothing is sent to others",
            )
        return manifest, folder
    if (folder / CONTENT).exists():
        trained = trained_on(folder)
        kept = {name: getattr(trained, name) for name in (*SAME, VERSION)}
        entry = fitted({**kept, "agent": folder.name}, Entry, str(folder))
        manifest = Manifest(
            name=_name_of(folder.name), benchmark_version=trained.benchmark_version, policies=[entry]
        )
        return manifest, folder.absolute().parent
    raise ResultsError(
        "there is no submission",
        place=given,
        remedy="give a folder that `smarts-bench release` or `export` has written, or tcp://HOST:PORT",
    )


def _at_address(address: str, version: int, scenarios: Sequence[str], traffic: Sequence[str]) -> Manifest:
    """Return a manifest of an agent that is served: it plays each cell of a version, once."""
    frozen = versions().get(version, {}).get(SCENARIOS, {})
    label = _name_of(address.removeprefix(ADDRESS))
    entries = [
        Entry(
            algorithm=label,
            task=name,
            scenarios=[name],
            traffic=each,
            seed=0,
            benchmark_version=version,
            agent=address,
        )
        for each, names in frozen.items()
        for name in names
        if VARIATION_MARK not in name
        and (not scenarios or name in scenarios)
        and (not traffic or each in traffic)
    ]
    if not entries:
        raise ResultsError(
            f"version {version} has no such scenario with such traffic",
            place="--scenario, --traffic",
            remedy="; ".join(
                f"with {each}: {', '.join(name for name in names if VARIATION_MARK not in name)}"
                for each, names in frozen.items()
            )
            or f"choose a version of {', '.join(map(str, versions()))}",
        )
    return Manifest(name=label, benchmark_version=version, policies=entries)


def _name_of(text: str) -> str:
    """Return a text without what cannot be in the name of a folder."""
    return re.sub(r"[^A-Za-z0-9._-]+", "-", text).strip("-._") or "agent"


def check_manifest(manifest: Manifest, folder: Path) -> None:
    """Raise if a submission cannot be evaluated.

    Raises:
        ResultsError: The submission is refused; names each reason.
    """
    if wrong := [*_wrong(manifest, folder)]:
        raise ResultsError(
            "the submission is refused:\n" + "\n".join(f"  {each}" for each in wrong),
            place=str(folder / MANIFEST),
            remedy="see docs/guide/leaderboard.md; what is this program's is restored by `git checkout -- .`",
        )


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
        found = "no version" if number is None else f"version {number}"
        yield f"its trainings are of {found} of the benchmark; those of version {known} can be compared"
        return
    for part in changed_code(number):
        yield f"{OWN} code of {part} ({', '.join(CODE[part])}) is not that of version {number}"
    frozen = versions()[number]
    for part, digest in manifest.code.items():
        if frozen.get(part) != digest:
            yield f"its code of {part} is not that of version {number}"
    for name in changed_scenarios(number, manifest.scenarios):
        yield f"its scenario {name} is not that of version {number}"
    for name in unlike_version(number, manifest.environment):
        yield f"its environment.{name} is not that of version {number}"
    yield from _wrong_entries(manifest, folder, number)


def _wrong_entries(manifest: Manifest, folder: Path, number: int) -> Iterator[str]:
    seen: set[Path] = set()
    played: set[tuple[str, str]] = set()
    for entry in manifest.policies:
        if entry.place in seen:
            yield f"{entry} is there twice"
        seen.add(entry.place)
        if entry.algorithm in RESERVED:
            yield f"{entry}: results need the name {entry.algorithm} for something else"
        if entry.scenarios != [entry.task]:
            yield f"{entry}: plays {', '.join(entry.scenarios)}, which is another task than {entry.task}"
        elif entry.task not in versions()[number][SCENARIOS].get(entry.traffic, {}):
            yield f"{entry}: {entry.task}, {entry.traffic} is no scenario of version {number}"
        elif (entry.task, entry.traffic) not in played:
            played.add((entry.task, entry.traffic))
            digests = scenario_digests(task_of(manifest, entry))
            for name in changed_scenarios(number, {entry.traffic: digests}):
                yield f"{OWN} scenario {name} is not that of version {number}"
    yield from _wrong_policies(manifest, folder, number)


def _wrong_policies(manifest: Manifest, folder: Path, number: int) -> Iterator[str]:
    """Yield what is wrong with the policies: with each, or that some are too large or are one."""
    agents: dict[tuple[str, str], int] = {}
    total = 0
    for entry in manifest.policies:
        agent = entry.agent
        if not agent.startswith(ADDRESS):
            try:
                policy = check_policy(entry, folder, number)
            except RefusedError as error:
                yield f"{entry}: {error.problem}"
                continue
            agent, total = policy.digest, total + policy.size
            is_known = entry.algorithm in ALGORITHMS  # others may exchange messages
            if policy.talks and is_known and not ALGORITHMS[entry.algorithm].communication:
                yield f"{entry}: its vehicles act on what others see, which those of {entry.algorithm} do not"
        other = agents.setdefault((entry.cell, agent), entry.seed)
        if other != entry.seed:
            yield f"{entry}: its policy is that of seed {other}"
    if total > LARGEST:
        yield f"its policies have {total:,} bytes, of at most {LARGEST:,}"


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
    except Exception as error:
        raise RefusedError(f"cannot be made: {type(error).__name__}: {error}", place=str(entry)) from error
    if differing:
        raise RefusedError("; ".join(differing), place=str(entry))
    return agent


def _differing(agent: BatchAgent, interface: AgentInterface, environment: Environment) -> Iterator[str]:
    """Yield in what an agent observes, decides or drives otherwise than the version."""
    if unseen := undeclared(agent.observation, environment.observation):
        yield f"observes what the task does not declare: {', '.join(unseen)}"
    if agent.period != environment.decision_interval:
        yield f"decides every {agent.period} steps, not every {environment.decision_interval}"
    action = interface.action.name if interface.action is not None else None
    if action != environment.action:
        yield f"drives otherwise than the version: action {action}"
    for name in DRIVING:
        wanted, has = getattr(environment, SETTINGS.get(name, name)), getattr(interface, name)
        if [*has] != [*wanted]:  # texts, or sequences of wheels
            yield f"drives otherwise than the version: {name} {has}"


def _made(entry: Entry, folder: Path) -> tuple[BatchAgent, AgentInterface]:
    if entry.agent.startswith(ADDRESS):
        agent, interface = make_agent(entry.agent)
        if not isinstance(agent, RemoteAgent):
            raise RefusedError("acts on Observation objects", remedy="derive it from BatchAgent")
        return SeparateAgents(agent), interface
    interface = exported_spec(folder / entry.agent, TEAM).interface
    assert interface is not None
    return _Exported(folder / entry.agent, TEAM), interface


class _Exported(ExportedPolicy):
    """Refuses what fails while it acts, such as an observation that it lacks."""

    def act(self, obs: ActionBatch) -> NDArray:
        try:
            return super().act(obs)
        except Exception as error:
            raise RefusedError(f"cannot act: {type(error).__name__}: {error}") from error


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
