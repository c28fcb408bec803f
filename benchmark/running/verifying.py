"""Evaluates a submission: re-derives its scores from episodes of its own, and compares them with its claims.

No code of a submission runs here: an exported policy is data, and other agents act at an address. Agents are
asked by `BlindAgent`, so that they learn nothing of an episode but what they see. Fresh episodes are in
`fresh/` beside the test's; a policy's run.json says "finished" when all policies are played and compared.
"""

from __future__ import annotations

import json
import secrets
import shutil
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import yaml

from benchmark.experiment.models import Evaluation
from benchmark.experiment.version import CODE, ENVIRONMENT, versions
from benchmark.metrics import read_table
from benchmark.metrics.results import Frame
from benchmark.results.files import (
    ResultsError,
    locked,
    read_json,
    replaced_folder,
    write_files,
    write_json,
    write_whole,
)
from benchmark.results.release import (
    CONFIRMED,
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
from benchmark.running.blind import BlindAgent, RefusedError
from benchmark.running.evaluating import play_agent
from benchmark.running.machine import machine
from benchmark.running.played import scenario_digests
from benchmark.running.side_by_side import side_by_side
from benchmark.running.submissions import agent_of, check_manifest, files_of, task_of
from benchmark.running.testing import EVALUATION_SEED
from benchmark.statistics import holm
from smarts.agents.hosting.options import HostError
from smarts.agents.hosting.remote import RemoteAgent
from smarts.errors import ActionError, OwnCodeError
from smarts_agent_kit.weights import file_digest

Digests = Mapping[str, Sequence[str]]

TOLERATED = 0.01
"""Share of a policy's episodes that may differ from those claimed: it was tested in 32 bits and is played in
64, so that once in a while another of two nearly equal actions is chosen."""
ROUNDED = 1e-5
"""Scores of equal episodes differ by less."""
MOST_P = 0.01
"""Chance that one policy of an honest submission is found to know the test."""
RESAMPLES = 100_000
FRESH = "fresh"
"""Folder of the fresh episodes, in a policy's."""
SEED = "fresh_seed"
"""Key of verdicts.json: seed of the fresh episodes, equal for all policies of a submission."""
OF_AGENTS = (RefusedError, OwnCodeError, HostError, ActionError)
"""Failures of an agent while it plays; others are this program's or its machine's."""


def verify(
    manifest: Manifest,
    folder: Path,
    out: Path,
    *,
    episodes: int = 200,
    fresh: int | None = None,
    parallel: int | None = 1,
) -> list[Verdict]:
    """Evaluate a submission, and return the verdict on each of its policies.

    The results are those of an experiment: `smarts-bench leaderboard` lists them. Verdicts come when all
    policies are played, since one test compares all seeds of a condition. What is played already is kept. A
    submission that claims nothing gets its claims, in `out`/submission: its policies and nothing else.

    Args:
        manifest: Manifest of the submission.
        folder: Folder that holds its policies.
        out: Folder of the results; new, or of an earlier evaluation of the same submission.
        episodes: Test episodes of each policy.
        fresh: Further episodes, of a seed that is drawn for the submission; by default as many as `episodes`.
        parallel: Exported policies at a time, see `side_by_side`; an address is asked by one at a time.

    Raises:
        ResultsError: The submission is refused as a whole; names each reason. Or `out` holds something else.
        SmartsError: The evaluation fails for a reason that is not the policy's.
    """
    check_manifest(manifest, folder)
    test = Evaluation(episodes=episodes, modes=("greedy",))
    with locked(out):
        seed = _open(manifest, out)
        evaluated = _Evaluated(manifest, folder, out, test, episodes if fresh is None else fresh, seed)
        refused = evaluated.play_missing(parallel)
        verdicts = [*evaluated.verdicts(refused)]
        _write_verdicts(manifest, out, seed, verdicts)
        for entry in manifest.policies:
            if entry.place not in refused:
                RunFolder(out / entry.place).note(status=FINISHED)
        if not refused and not any(entry.episodes for entry in manifest.policies):
            with replaced_folder(out / SUBMISSION) as partial:
                evaluated.write_claims(partial)
        return verdicts


def _open(manifest: Manifest, out: Path) -> int:
    """Begin or resume an evaluation, and return the seed of its fresh episodes.

    Raises:
        ResultsError: The folder holds anything but an evaluation of the same submission.
    """
    file, another = out / VERDICTS, "choose another --out"
    others = sorted(each.name for each in out.glob("[!.]*") if each != file)
    said = read_json(file, remedy=another) if file.exists() else {}
    if said.get(SUBMISSION) == _digest_of(manifest):
        return said[SEED]
    if others or said.get("verdicts"):  # without both, a wrong address may have been given
        told = "the evaluation of another submission" if said else f"something else: {', '.join(others[:5])}"
        raise ResultsError(f"holds {told}", place=str(out), remedy=another)
    seed = secrets.randbits(31)
    _write_verdicts(manifest, out, seed, [])
    return seed


def _write_verdicts(manifest: Manifest, out: Path, seed: int, verdicts: list[Verdict]) -> None:
    content = {SUBMISSION: _digest_of(manifest), SEED: seed}
    write_json(out / VERDICTS, {**content, "verdicts": [each.model_dump() for each in verdicts]})


def _digest_of(manifest: Manifest) -> str:
    return file_digest(json.dumps(manifest.content(), sort_keys=True).encode())


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

    def play_missing(self, parallel: int | None) -> dict[Path, str]:
        """Play what is not there; returns why entries are refused, by their place."""
        entries = self.manifest.policies
        missing = [entry for entry in entries if not self.is_played(entry)]
        count, refused = len(entries) - len(missing), {}
        for is_remote, most in ((False, parallel), (True, 1)):
            asked = [entry for entry in missing if entry.is_remote == is_remote]
            for number, problem in side_by_side(self.play, [(entry,) for entry in asked], most):
                count += 1
                print(f"{count} of {len(entries)}: {asked[number]}: played", file=sys.stderr)
                if problem:
                    refused[asked[number].place] = problem
        return refused

    def facts_of(self, entry: Entry) -> dict[str, Any]:
        """Return what tells in run.json whether an entry was played in this way."""
        files = {} if entry.is_remote else {name: file_digest(each) for name, each in self.files(entry)}
        played = repr((_digest_of(self.manifest), entry.model_dump(), files, self.fresh, self.seed))
        kept = ("episodes", "held_out_episodes")
        tested = {"modes": [*self.test.modes], **{name: getattr(self.test, name) for name in kept}}
        return {"tested": tested, SUBMISSION: file_digest(played.encode())}

    def files(self, entry: Entry) -> Iterator[tuple[str, bytes]]:
        """Yield name and content of each file of an entry's policy."""
        for file in files_of(self.folder / entry.agent):
            yield file.name, file.read_bytes()

    def is_played(self, entry: Entry) -> bool:
        """Return whether the same entry was played in the same test."""
        place = RunFolder(self.out / entry.place)
        is_same = self.facts_of(entry).items() <= place.facts().items() and place.has_table
        return is_same and (not self.fresh or RunFolder(place.path / FRESH).has_table)

    def play(self, entry: Entry) -> str:
        """Play an entry's episodes; returns why it is refused, or "".

        Raises:
            SmartsError: They cannot be played for a reason that is not the agent's.
        """
        place, setting = RunFolder(self.out / entry.place), replace(task_of(entry), evaluation=self.test)
        shutil.rmtree(place.path, ignore_errors=True)
        plays = [(place, self.test, EVALUATION_SEED)]
        if self.fresh:
            plays.append((RunFolder(place.path / FRESH), Evaluation(episodes=self.fresh), self.seed))
        labels = {"algorithm": entry.algorithm, "training_seed": entry.seed}
        agent = None
        try:
            agent = agent_of(entry, self.folder, setting.environment)
            blind = BlindAgent(agent)
            for folder, test, seed in plays:
                task = replace(setting, evaluation=test)
                for _ in play_agent(task, folder, blind, labels, mode="greedy", seed=seed):
                    pass
        except OF_AGENTS as error:
            if agent is None and isinstance(error, HostError):
                raise  # that nothing answers at its address says nothing of an agent
            shutil.rmtree(place.path, ignore_errors=True)
            return "; ".join(map(str.strip, str(error).splitlines()))
        finally:
            if isinstance(agent, RemoteAgent):
                agent.close()
        content = {"algorithm": entry.algorithm, **setting.content()}
        write_whole(place.config, lambda file: file.write_text(yaml.safe_dump(content, sort_keys=False)))
        facts = {"status": TESTING, SCENARIOS: scenario_digests(setting), **self.facts_of(entry)}
        place.note(**machine(), **facts)
        return ""

    def table(self, entry: Entry) -> Frame:
        """Return the agent-episodes of an entry's test."""
        return read_table(RunFolder(self.out / entry.place).table)

    def verdicts(self, refused: Mapping[Path, str]) -> Iterator[Verdict]:
        """Yield the verdicts on all entries; `refused` says why some were not played, by their place."""
        played = [entry for entry in self.manifest.policies if entry.place not in refused]
        fresh: dict[Path, Frame] = {}
        conditions: dict[str, list[tuple[Frame, Frame]]] = {}
        for entry in played if self.fresh else ():
            fresh[entry.place] = read_table(RunFolder(self.out / entry.place / FRESH).table)
            conditions.setdefault(entry.condition, []).append((self.table(entry), fresh[entry.place]))
        learnt = memorized(conditions)
        for entry in self.manifest.policies:
            given: dict[str, Any] = {"status": REFUSED, "reasons": [refused.get(entry.place, "")]}
            if entry.place not in refused:
                table, known = self.table(entry), learnt.get(entry.condition, [])
                scores, digests = scores_of(table), episode_digests(table)
                reasons = [*differences(entry, scores, digests), *known]
                given = {"status": MARKED if reasons else CONFIRMED, "reasons": reasons, "scores": scores}
                given |= {"digests": [*compared_digests(entry, digests)], "knows_test": bool(known)}
            if entry.place in fresh:
                given["fresh"] = scores_of(fresh[entry.place])
            given |= {"name": self.manifest.name, "author": self.manifest.author, "agent": entry.agent}
            yield Verdict(**entry.names, **given, claimed=entry.scores)

    def write_claims(self, folder: Path) -> None:
        """Write a submission of the same policies that claims what they have played here."""
        number = self.manifest.benchmark_version
        assert number is not None
        entries: list[Entry] = []
        scenarios: dict[str, dict[str, str]] = {}
        for entry in self.manifest.policies:
            table = self.table(entry)
            given: dict[str, Any] = {"scores": scores_of(table), "episodes": episode_digests(table)}
            if not entry.is_remote:
                files = dict(self.files(entry))
                name = f"{entry.algorithm}_{entry.task}_{entry.traffic}_{entry.seed}"
                given["agent"] = f"{POLICIES}/{name}"
                given["files"] = {name: file_digest(content) for name, content in files.items()}
                write_files(folder / given["agent"], files)
            entries.append(entry.model_copy(update=given))
            there = RunFolder(self.out / entry.place).facts()[SCENARIOS]
            scenarios.setdefault(entry.traffic, {}).update(there)
        frozen = versions()[number]
        given = {"code": {part: frozen[part] for part in CODE}, "environment": frozen[ENVIRONMENT]}
        claimed = self.manifest.model_copy(update={**given, "scenarios": scenarios, "policies": entries})
        write_json(folder / MANIFEST, claimed.content())


def compared_digests(entry: Entry, played: Digests) -> tuple[int, int]:
    """Return how many claimed digests are those of the episodes, and how many were compared.

    A digest is of one episode's index, too, so the order does not matter: an episode that could not be
    measured, on either side, is one that differs, and not all behind it.

    Args:
        entry: Entry whose claims are compared.
        played: Scenario -> digest of each episode; see `episode_digests`.
    """
    pairs = [(derived, entry.episodes.get(scenario, ())) for scenario, derived in played.items()]
    equal = sum(len({*derived} & {*claimed}) for derived, claimed in pairs)
    return equal, sum(min(len(derived), len(claimed)) for derived, claimed in pairs)


def differences(entry: Entry, scores: Mapping[str, float], digests: Digests) -> Iterator[str]:
    """Yield in what an entry's claims are not what its episodes gave.

    Args:
        entry: Entry whose claims are compared.
        scores: Scores of the test.
        digests: Scenario -> digest of each episode; see `episode_digests`.
    """
    if not entry.episodes:
        yield "claims no episodes"
        return
    equal, compared = compared_digests(entry, digests)
    differing = compared - equal
    tolerated = compared and differing <= TOLERATED * compared
    if not tolerated:
        yield f"other episodes than claimed: {differing} of {compared} digests differ"
    foreign = [name for name in entry.episodes if name.partition("@")[0] not in entry.scenarios]
    if foreign:
        yield f"claims episodes of {', '.join(foreign)}, which it does not play"
    claimed, played = (
        sum(len(each) for name, each in given.items() if "@" not in name)
        for given in (entry.episodes, digests)
    )
    if claimed != played:
        yield f"claims {claimed} test episodes, {played} were played: its scores are not compared"
        return
    # All agents of the differing episodes may have ended otherwise.
    most = ROUNDED + (differing / compared if tolerated else 0.0)
    for name, value in entry.scores.items():
        if name not in scores:
            yield f"claims {name} {value:.3f}, which its episodes do not give"
        elif abs(value - scores[name]) > most:
            yield f"claims {name} {value:.3f}; its episodes give {scores[name]:.3f}"


def memorized(conditions: Mapping[str, Sequence[tuple[Frame, Frame]]]) -> dict[str, list[str]]:
    """Return by condition the rates that are better in the public test than in fresh episodes.

    There is a test for each condition and rate. All policies of a condition play the same public and the same
    fresh episodes, some of which are easier than others, so the unit is an episode, with the mean over the
    policies. P-values are corrected after Holm over all conditions and rates.

    Args:
        conditions: Condition -> tables of the public test and of the fresh episodes of each of its policies.
    """
    tests = [
        (condition, label, *(_by_episode([pair[part] for pair in pairs], outcome) for part in (0, 1)), sign)
        for condition, pairs in conditions.items()
        for label, outcome, sign in (("completion", "goal", 1.0), ("collision", "collision", -1.0))
    ]
    p_values = holm([p_value(sign * public, sign * fresh) for _, _, public, fresh, sign in tests])
    found: dict[str, list[str]] = {}
    for (condition, label, public, fresh, _), corrected in zip(tests, p_values, strict=True):
        if corrected < MOST_P:
            found.setdefault(condition, []).append(
                f"{label} rate {public.mean():.3f} in the public test, {fresh.mean():.3f} in fresh episodes "
                f"(corrected p < {MOST_P:g}): it knows the test"
            )
    return found


def _by_episode(tables: Sequence[Frame], outcome: str) -> np.ndarray:
    """Return the share of each valid episode's agents that ended in a way: the mean over tables."""
    shares = []
    for table in tables:
        rows = table[(table["split"] != "held_out") & ~table["is_invalid"] & (table["agents"] > 0)]
        shares.append((rows["outcome"] == outcome).groupby([rows["scenario"], rows["world"]]).mean())
    return np.asarray(pd.concat(shares).groupby(level=[0, 1]).mean(), float)


def p_value(larger: np.ndarray, smaller: np.ndarray) -> float:
    """Return the one-sided p-value of a permutation test of means; 1 where there is nothing to compare."""
    if not len(larger) or not len(smaller) or larger.mean() <= smaller.mean():
        return 1.0
    both = np.round(np.concatenate([larger, smaller]), 9)
    values, counts = np.unique(both, return_counts=True)
    rng = np.random.Generator(np.random.Philox(0))
    drawn = rng.multivariate_hypergeometric(counts, len(larger), size=RESAMPLES) @ values
    reached = int((drawn >= both[: len(larger)].sum() - 1e-6).sum())
    return (1 + reached) / (RESAMPLES + 1)
