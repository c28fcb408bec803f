"""Evaluates a submission: re-derives its scores from episodes of its own, and compares them with its claims.

No code of a submission runs here: an exported policy is data, and other agents act at an address. Agents are
asked by `BlindAgent`, so that they learn nothing of an episode but what they see.

A policy's run.json is written first, so that the folders of other runs are never removed; its status is
"finished" when all policies are played and compared. Fresh episodes are in `fresh/` beside the test's.
"""

from __future__ import annotations

import json
import secrets
import shutil
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import yaml

from benchmark.experiment.config import Evaluation
from benchmark.experiment.runs import TaskSetting
from benchmark.experiment.version import CODE, ENVIRONMENT, versions
from benchmark.metrics import read_table
from benchmark.metrics.results import Frame
from benchmark.results.files import (
    ResultsError,
    locked,
    named_failures,
    previous_of,
    read_mapping,
    replace_folder,
    write_files,
    write_json,
    write_whole,
)
from benchmark.results.release import (
    ADDRESS,
    CONFIRMED,
    FRESH_SEED,
    MANIFEST,
    MARKED,
    POLICIES,
    REFUSED,
    SUBMISSION,
    VERDICTS,
    Entry,
    Manifest,
    Verdict,
    episode_digests,
    scores_of,
)
from benchmark.results.run_folder import FINISHED, SCENARIOS, TESTING, RunFolder
from benchmark.running.blind import BlindAgent
from benchmark.running.evaluate_agent import play_agent
from benchmark.running.judging import differences, equal_digests, memorized
from benchmark.running.machine import machine
from benchmark.running.played import scenario_digests
from benchmark.running.side_by_side import side_by_side
from benchmark.running.submissions import RefusedError, agent_of, check_manifest, files_of, task_of
from benchmark.running.testing import EVALUATION_SEED
from smarts.agents.hosting.options import HostError
from smarts.agents.hosting.remote import RemoteAgent
from smarts.agents.policy import BatchAgent
from smarts.errors import ActionError, OwnCodeError, SmartsError
from smarts_agent_kit.weights import file_digest

FRESH = "fresh"
"""Folder of the fresh episodes, in a policy's."""
OF_AGENTS = (RefusedError, OwnCodeError, HostError, ActionError)
"""Failures of an agent while it plays; others are this program's or its machine's."""


@dataclass(frozen=True)
class _Outcome:
    """What the evaluation of an entry gave."""

    entry: Entry
    table: Frame | None = None
    """None if it is refused."""
    fresh: Frame | None = None
    refused: str = ""


def verify(
    manifest: Manifest,
    folder: Path,
    out: Path,
    *,
    episodes: int = 200,
    held_out_episodes: int = 0,
    fresh: int | None = None,
    parallel: int | None = 1,
) -> Iterator[Verdict]:
    """Evaluate a submission, and yield the verdict on each of its policies.

    The results are those of an experiment: `smarts-bench leaderboard` lists them. Verdicts come when all
    policies are played, since one test compares all seeds of a cell. What is played already is kept.

    Args:
        manifest: Manifest of the submission.
        folder: Folder that holds its policies.
        out: Folder of the results; new, or of an earlier evaluation of the same submission.
        episodes: Test episodes of each policy.
        held_out_episodes: Number of episodes of each policy on each held-out variation.
        fresh: Further episodes, of a seed that is drawn for the submission; by default as many as `episodes`.
        parallel: Exported policies at a time, see `side_by_side`; an address is asked by one at a time.

    Raises:
        ResultsError: The submission is refused as a whole; names each reason. Or `out` holds something else.
        SmartsError: The evaluation fails for a reason that is not the policy's.
    """
    check_manifest(manifest, folder)
    test = Evaluation(episodes=episodes, held_out_episodes=held_out_episodes, modes=("greedy",))
    with locked(out):
        seed = open_evaluation(manifest, out)
        evaluated = _Evaluated(manifest, folder, out, test, episodes if fresh is None else fresh, seed)
        outcomes = evaluated.outcomes(parallel)
        again = {"seed": seed, "episodes": evaluated.fresh}
        verdicts = [*_judged(manifest, outcomes, again)]
        for entry, verdict in zip(manifest.policies, verdicts, strict=True):
            if verdict.status != REFUSED:
                evaluated.keep(entry, verdict)
        write_verdicts(manifest, out, seed, verdicts)
        yield from verdicts


@dataclass(frozen=True)
class _Evaluated:
    """A submission, and how and where it is evaluated."""

    manifest: Manifest
    folder: Path
    out: Path
    test: Evaluation
    fresh: int
    """Number of fresh episodes."""
    seed: int
    """Seed of the fresh episodes."""

    @property
    def tested(self) -> dict[str, Any]:
        """The test, as run.json has it."""
        kept = ("episodes", "held_out_episodes")
        return {"modes": [*self.test.modes], **{name: getattr(self.test, name) for name in kept}}

    def outcomes(self, parallel: int | None) -> list[_Outcome]:
        """Return the outcomes of all entries, played now or known."""
        entries = self.manifest.policies
        outcomes = {k: outcome for k, entry in enumerate(entries) if (outcome := self.known(entry))}
        missing = [k for k in range(len(entries)) if k not in outcomes]
        for is_address, most in ((False, parallel), (True, 1)):
            numbers = [k for k in missing if entries[k].agent.startswith(ADDRESS) == is_address]
            for done, outcome in side_by_side(self.played, [(entries[k],) for k in numbers], most):
                outcomes[numbers[done]] = outcome
                print(f"{len(outcomes)} of {len(entries)}: {outcome.entry}: played", file=sys.stderr)
        return [outcomes[k] for k in range(len(entries))]

    def facts_of(self, entry: Entry) -> dict[str, Any]:
        """Return what tells in run.json whether an entry was played in this way."""
        return {
            "entry": identity(self.manifest, entry, self.folder),
            "fresh_episodes": self.fresh,
            FRESH_SEED: self.seed,
        }

    def known(self, entry: Entry) -> _Outcome | None:
        """Return what an earlier evaluation of the same entry in the same test gave."""
        wanted = self.facts_of(entry)
        with suppress(SmartsError, KeyError, TypeError, AttributeError):
            place = RunFolder(self.out / entry.place)
            facts = place.facts()
            if facts["tested"] == self.tested and wanted.items() <= facts[SUBMISSION].items():
                fresh = read_table(RunFolder(place.path / FRESH).table) if self.fresh else None
                return _Outcome(entry, read_table(place.table), fresh)
        return None

    def played(self, entry: Entry) -> _Outcome:
        """Play an entry's episodes.

        Raises:
            SmartsError: They cannot be played for a reason that is not the agent's.
        """
        place = RunFolder(self.out / entry.place)
        said = self.facts_of(entry)
        setting = replace(task_of(self.manifest, entry), evaluation=self.test)
        try:
            # That nothing answers at its address says nothing of an agent: no verdict.
            agent = agent_of(entry, self.folder, setting.environment)
        except RefusedError as error:
            return _refused(entry, place, error)
        _remove(place.path)
        place.note(status=TESTING, **{SUBMISSION: {}})
        try:
            blind = BlindAgent(agent)
            table = _table(setting, blind, entry, place, EVALUATION_SEED)
            fresh = None
            if self.fresh:
                again = replace(setting, evaluation=Evaluation(episodes=self.fresh))
                fresh = _table(again, blind, entry, RunFolder(place.path / FRESH), self.seed)
        except OF_AGENTS as error:
            return _refused(entry, place, error)
        finally:
            if isinstance(agent, RemoteAgent):
                agent.close()
        content = {"algorithm": entry.algorithm, **setting.content()}
        write_whole(place.config, lambda file: file.write_text(yaml.safe_dump(content, sort_keys=False)))
        facts = {SCENARIOS: scenario_digests(setting), "tested": self.tested, SUBMISSION: said}
        place.note(**machine(), **facts)
        return _Outcome(entry, table, fresh)

    def keep(self, entry: Entry, verdict: Verdict) -> None:
        """Finish the run of an entry."""
        place = RunFolder(self.out / entry.place)
        said = asdict(verdict) | self.facts_of(entry)
        facts = place.facts()
        if facts.get("status") != FINISHED or facts.get(SUBMISSION) != said:
            place.note(status=FINISHED, **{SUBMISSION: said})


def _refused(entry: Entry, place: RunFolder, error: SmartsError) -> _Outcome:
    """Return the outcome of an agent that failed, and remove what it has played."""
    _remove(place.path)
    return _Outcome(entry, refused="; ".join(map(str.strip, str(error).splitlines())))


def _remove(folder: Path) -> None:
    """Remove a run's folder by renaming it first, so that none is left without its run.json."""
    if folder.exists():
        old = previous_of(folder)
        with named_failures(folder):
            shutil.rmtree(old, ignore_errors=True)
            folder.rename(old)
        shutil.rmtree(old, ignore_errors=True)


def _table(setting: TaskSetting, agent: BatchAgent, entry: Entry, folder: RunFolder, seed: int) -> Frame:
    """Play episodes and return their table."""
    labels = {"algorithm": entry.algorithm, "training_seed": entry.seed}
    for _ in play_agent(setting, folder, agent, labels, mode="greedy", seed=seed):
        pass
    return read_table(folder.table)


def _judged(manifest: Manifest, outcomes: Sequence[_Outcome], again: Mapping[str, Any]) -> Iterator[Verdict]:
    """Yield the verdicts on the entries of a submission.

    Args:
        manifest: Manifest of the submission.
        outcomes: Outcomes of all its entries.
        again: Seed and number of the fresh episodes.
    """
    pairs: dict[str, list[tuple[Frame, Frame]]] = {}
    for each in outcomes:
        if each.table is not None and each.fresh is not None:
            pairs.setdefault(each.entry.cell, []).append((each.table, each.fresh))
    learnt = memorized(pairs)
    for each in outcomes:
        entry = each.entry
        known = learnt.get(entry.cell, [])
        status, reasons, equal = REFUSED, [each.refused], [0, 0]
        scores: dict[str, float] = {}
        fresh: dict[str, Any] = {}
        if each.table is not None:
            scores, digests = scores_of(each.table), episode_digests(each.table)
            reasons = [*differences(entry, each.table, scores, digests), *known]
            status = MARKED if reasons else CONFIRMED
            same = equal_digests(entry, digests).values()
            equal = [sum(pair[part] for pair in same) for part in (0, 1)]
        if each.fresh is not None:
            fresh = {**again, "scores": scores_of(each.fresh)}
        yield Verdict(
            manifest.name,
            manifest.author,
            **{name: getattr(entry, name) for name in ("algorithm", "task", "traffic", "seed", "agent")},
            status=status,
            reasons=reasons,
            claimed=entry.scores,
            scores=scores,
            digests=equal,
            fresh=fresh,
            knows_test=bool(known) and status != REFUSED,
        )


def open_evaluation(manifest: Manifest, out: Path) -> int:
    """Begin or resume an evaluation, and return the seed of its fresh episodes.

    Raises:
        ResultsError: The folder holds anything but an evaluation of the same submission.
    """
    file, another = out / VERDICTS, "choose another --out"
    others = sorted(each.name for each in out.glob("[!.]*") if each != file)
    said = read_mapping(file, remedy=another) if file.exists() else {}
    if said.get(SUBMISSION) == _digest_of(manifest):
        return said[FRESH_SEED]
    # Where nothing was played, a wrong address may have been given.
    if others or said.get("verdicts"):
        told = "the evaluation of another submission" if said else f"something else: {', '.join(others[:5])}"
        raise ResultsError(f"holds {told}", place=str(out), remedy=another)
    seed = secrets.randbits(31)
    write_verdicts(manifest, out, seed, ())
    return seed


def _digest_of(manifest: Manifest) -> str:
    return file_digest(json.dumps(manifest.content(), sort_keys=True).encode())


def write_verdicts(manifest: Manifest, out: Path, seed: int, verdicts: Sequence[Verdict]) -> None:
    """Write verdicts.json.

    Args:
        manifest: Manifest of the submission.
        out: The folder.
        seed: Seed of the fresh episodes.
        verdicts: Verdicts of its policies.
    """
    content = {
        "benchmark_version": manifest.benchmark_version,
        SUBMISSION: _digest_of(manifest),
        FRESH_SEED: seed,
        "verdicts": [asdict(each) for each in verdicts],
    }
    write_json(out / VERDICTS, content)


def identity(manifest: Manifest, entry: Entry, folder: Path) -> str:
    """Return a digest of an entry and of the files of its policy as they are now."""
    files = {}
    if not entry.agent.startswith(ADDRESS):
        files = {file.name: file_digest(file.read_bytes()) for file in files_of(folder / entry.agent)}
    return file_digest(repr((_digest_of(manifest), entry.model_dump(), files)).encode())


def write_claims(manifest: Manifest, folder: Path, out: Path) -> Path | None:
    """Write a submission that claims what an evaluation of one without claims gave, and return its folder.

    It holds the policies that were evaluated, and nothing else of their folders.

    Returns:
        None if the submission claims something itself, or a policy was refused or has changed since.

    Raises:
        ResultsError: The folder is in use, or cannot be written to.
    """
    if any(entry.episodes for entry in manifest.policies):
        return None
    target = out / SUBMISSION
    with locked(out):
        for entry in manifest.policies:
            facts = RunFolder(out / entry.place).facts()
            if facts.get("status") != FINISHED:
                return None
            if facts[SUBMISSION]["entry"] != identity(manifest, entry, folder):
                return None
        replace_folder(target, lambda partial: _write_claims(manifest, folder, out, partial))
    return target


def _write_claims(manifest: Manifest, folder: Path, out: Path, partial: Path) -> None:
    number = manifest.benchmark_version
    assert number is not None
    frozen = versions()[number]
    entries: list[Entry] = []
    played: dict[str, dict[str, str]] = {}
    for entry in manifest.policies:
        place = RunFolder(out / entry.place)
        table = read_table(place.table)
        given: dict[str, Any] = {"scores": scores_of(table), "episodes": episode_digests(table)}
        if not entry.agent.startswith(ADDRESS):
            name = f"{POLICIES}/{'_'.join((entry.algorithm, entry.task, entry.traffic, str(entry.seed)))}"
            files = {file.name: file.read_bytes() for file in files_of(folder / entry.agent)}
            write_files(partial / name, files)
            given["agent"] = name
            given["files"] = {each: file_digest(content) for each, content in files.items()}
        entries.append(entry.model_copy(update=given))
        played.setdefault(entry.traffic, {}).update(place.facts()[SCENARIOS])
    claimed = manifest.model_copy(
        update={
            "code": {part: frozen[part] for part in CODE},
            "environment": frozen[ENVIRONMENT],
            "scenarios": played,
            "policies": entries,
        }
    )
    write_json(partial / MANIFEST, claimed.content())
