"""Evaluates a submission: re-derives its scores from episodes of its own, and compares them with its claims.

No code of a submission runs here: an exported policy is data, and other agents act at an address. Agents are
asked by `BlindAgent`, so that they learn nothing of an episode but what they see.
"""

from __future__ import annotations

import secrets
import shutil
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from benchmark.experiment.config import Evaluation
from benchmark.experiment.runs import TaskSetting
from benchmark.experiment.version import CODE, ENVIRONMENT, versions
from benchmark.metrics import read_table
from benchmark.metrics.results import Frame
from benchmark.results.files import ResultsError, locked, replace_folder, write_json, write_whole
from benchmark.results.release import (
    ADDRESS,
    CONFIRMED,
    MANIFEST,
    MARKED,
    POLICIES,
    REFUSED,
    SUBMISSION,
    VERDICTS,
    Entry,
    Manifest,
    episode_digests,
    file_digest,
    scores_of,
)
from benchmark.results.run_folder import FINISHED, SCENARIOS, RunFolder
from benchmark.running.blind import BlindAgent
from benchmark.running.evaluate_agent import play_agent
from benchmark.running.machine import machine
from benchmark.running.played import scenario_digests
from benchmark.running.submissions import agent_of, check_manifest, task_of
from smarts.agents.hosting.remote import RemoteAgent
from smarts.errors import SmartsError

FRESH_EPISODES = 50
SMALLEST_P = 0.001
"""Below it, a policy does better in the public test than in fresh episodes."""
RESAMPLES = 10_000


@dataclass(frozen=True)
class Verdict:
    """What is known of an entry after its evaluation."""

    entry: Entry
    status: str
    """`CONFIRMED`, `MARKED` or `REFUSED`."""
    reasons: tuple[str, ...]
    """Why it is marked or refused."""
    scores: Mapping[str, float]
    """As re-derived; empty if refused."""
    equal: int
    """Episodes whose digests are those claimed."""
    compared: int
    fresh: Mapping[str, Any]
    """Seed, number and scores of the fresh episodes."""

    def content(self, name: str, author: str) -> dict[str, Any]:
        """Return it as it is written."""
        kept = ("algorithm", "task", "traffic", "seed", "agent")
        return {
            "name": name,
            "author": author,
            **{key: getattr(self.entry, key) for key in kept},
            "status": self.status,
            "reasons": [*self.reasons],
            "claimed": dict(self.entry.scores),
            "scores": dict(self.scores),
            "digests": [self.equal, self.compared],
            "fresh": dict(self.fresh),
        }


def verify(
    manifest: Manifest,
    folder: Path,
    out: Path,
    *,
    episodes: int = 200,
    held_out_episodes: int = 0,
    fresh: int = FRESH_EPISODES,
) -> Iterator[Verdict]:
    """Evaluate a submission, and yield the verdict on each of its policies.

    The results are those of an experiment: `smarts-bench leaderboard` lists them. What is evaluated already
    is not done again.

    Args:
        manifest: Of the submission.
        folder: That holds its policies.
        out: Of the results.
        episodes: Test episodes of each policy.
        held_out_episodes: Of each policy on each held-out variation.
        fresh: Further episodes, of a seed that is drawn now: who does worse in them has learnt the test.

    Raises:
        ResultsError: The submission is refused as a whole; names each reason.
    """
    general = check_manifest(manifest, folder)
    test = Evaluation(episodes=episodes, held_out_episodes=held_out_episodes, modes=("greedy",))
    verdicts = []
    with locked(out):
        for entry in manifest.policies:
            marks = [reason for cell, reason in general if cell in (entry.cell, "")]
            verdict = _known(manifest, entry, out, test) or _evaluated(
                manifest, entry, folder, out, test, fresh, marks
            )
            verdicts.append(verdict.content(manifest.name, manifest.author))
            write_json(
                out / VERDICTS, {"benchmark_version": manifest.benchmark_version, "verdicts": verdicts}
            )
            yield verdict


def _known(manifest: Manifest, entry: Entry, out: Path, test: Evaluation) -> Verdict | None:
    """Return the verdict of an earlier evaluation of the same entry in the same test."""
    with suppress(ResultsError, KeyError, TypeError, ValueError):
        facts = RunFolder(out / entry.place).facts()
        said = facts[SUBMISSION]
        is_same = said["entry"] == _identity(manifest, entry) and facts["tested"] == _tested(test)
        if facts["status"] == FINISHED and is_same:
            equal, compared = said["digests"]
            given = said["status"], tuple(said["reasons"]), said["scores"]
            return Verdict(entry, *given, equal, compared, said["fresh"])
    return None


def _identity(manifest: Manifest, entry: Entry) -> str:
    return file_digest(repr((manifest.name, manifest.author, entry.model_dump())).encode())


def _tested(test: Evaluation) -> dict[str, Any]:
    return {"episodes": test.episodes, "modes": [*test.modes], "held_out_episodes": test.held_out_episodes}


def _evaluated(
    manifest: Manifest,
    entry: Entry,
    folder: Path,
    out: Path,
    test: Evaluation,
    fresh: int,
    marks: Sequence[str],
) -> Verdict:
    """Play an entry's episodes and keep its results, unless it is refused."""
    place = RunFolder(out / entry.place)
    shutil.rmtree(place.path, ignore_errors=True)
    setting = replace(task_of(manifest, entry), evaluation=test)
    try:
        agent = agent_of(entry, folder, setting.environment)
        try:
            table = _played(setting, BlindAgent(agent), entry, place)
            seed = secrets.randbits(31)
            again = _fresh(setting, BlindAgent(agent), entry, fresh, seed)
        finally:
            if isinstance(agent, RemoteAgent):
                agent.close()
    except SmartsError as error:
        shutil.rmtree(place.path, ignore_errors=True)
        return Verdict(entry, REFUSED, (_one_line(error),), {}, 0, 0, {})
    scores = scores_of(table)
    equal, compared = _compared(entry, table)
    reasons = [*marks, *_differences(entry, scores, equal, compared, test)]
    facts: dict[str, Any] = {}
    if again is not None:
        facts = {"seed": seed, "episodes": fresh, "scores": scores_of(again)}
        reasons += _memorized(table, again)
    status = MARKED if reasons else CONFIRMED
    verdict = Verdict(entry, status, tuple(reasons), scores, equal, compared, facts)
    _keep(place, manifest, setting, verdict)
    return verdict


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split())


def _played(setting: TaskSetting, agent: BlindAgent, entry: Entry, folder: RunFolder, **given: Any) -> Frame:
    labels = {"algorithm": entry.algorithm, "training_seed": entry.seed}
    for _ in play_agent(setting, folder, agent, labels, mode="greedy", **given):
        pass
    return read_table(folder.table)


def _fresh(setting: TaskSetting, agent: BlindAgent, entry: Entry, episodes: int, seed: int) -> Frame | None:
    """Return the table of episodes that nobody could know."""
    if not episodes:
        return None
    test = Evaluation(episodes=episodes)
    with tempfile.TemporaryDirectory(prefix="smarts-bench-") as temporary:
        return _played(replace(setting, evaluation=test), agent, entry, RunFolder(Path(temporary)), seed=seed)


def _compared(entry: Entry, table: Frame) -> tuple[int, int]:
    """Return how many of the claimed digests that can be compared are those of the episodes."""
    equal = compared = 0
    for scenario, derived in episode_digests(table).items():
        pairs = [*zip(derived, entry.episodes.get(scenario, ()), strict=False)]
        equal += sum(one == two for one, two in pairs)
        compared += len(pairs)
    return equal, compared


def _differences(
    entry: Entry, scores: Mapping[str, float], equal: int, compared: int, test: Evaluation
) -> Iterator[str]:
    """Yield in what an entry's claims are not what its episodes gave."""
    if not entry.episodes:
        yield "claims no episodes"
    elif equal < compared or not compared:
        yield f"other episodes than claimed: {compared - equal} of {compared} digests differ"
    claimed = sum(len(each) for name, each in entry.episodes.items() if "@" not in name)
    if claimed and claimed < test.episodes:
        yield f"claims {claimed} test episodes of {test.episodes}"
    if claimed != test.episodes:
        return
    for name, value in entry.scores.items():
        if name in scores and abs(value - scores[name]) > 1e-5:
            yield f"claims {name} {value:.3f}; its episodes give {scores[name]:.3f}"


def _memorized(table: Frame, again: Frame) -> Iterator[str]:
    """Yield rates that are better in the public test than in fresh episodes."""
    for label, outcome, sign in (("completion", "goal", 1.0), ("collision", "collision", -1.0)):
        public, fresh = (sign * _by_episode(each, outcome) for each in (table, again))
        if _p_value(public, fresh) < SMALLEST_P:
            yield (
                f"{label} rate {abs(public.mean()):.3f} in the public test, {abs(fresh.mean()):.3f} in fresh "
                f"episodes (p < {SMALLEST_P:g}): it knows the test"
            )


def _by_episode(table: Frame, outcome: str) -> np.ndarray:
    """Return the share of each valid episode's agents that ended in a way."""
    rows = table[(table["split"] == "train") & ~table["is_invalid"] & (table["agents"] > 0)]
    return (rows["outcome"] == outcome).groupby([rows["scenario"], rows["world"]]).mean().to_numpy(float)


def _p_value(larger: np.ndarray, smaller: np.ndarray) -> float:
    """Return the one-sided p-value of a permutation test of means; 1 where there is nothing to compare."""
    if not len(larger) or not len(smaller):
        return 1.0
    both, rng = np.concatenate([larger, smaller]), np.random.Generator(np.random.Philox(0))
    observed = larger.mean() - smaller.mean()
    drawn = rng.permuted(np.tile(both, (RESAMPLES, 1)), axis=1)
    gaps = drawn[:, : len(larger)].mean(axis=1) - drawn[:, len(larger) :].mean(axis=1)
    return float((1 + (gaps >= observed - 1e-12).sum()) / (RESAMPLES + 1))


def _keep(place: RunFolder, manifest: Manifest, setting: TaskSetting, verdict: Verdict) -> None:
    """Write a run's files around an evaluated table."""
    content = {"algorithm": verdict.entry.algorithm, **setting.content()}
    write_whole(place.config, lambda file: file.write_text(yaml.safe_dump(content, sort_keys=False)))
    said = verdict.content(manifest.name, manifest.author) | {"entry": _identity(manifest, verdict.entry)}
    facts = {SCENARIOS: scenario_digests(setting), "tested": _tested(setting.evaluation), SUBMISSION: said}
    place.note(**machine(), **facts, status=FINISHED)


def write_claims(manifest: Manifest, folder: Path, out: Path) -> Path | None:
    """Write a submission that claims what an evaluation of one without claims gave, and return its folder.

    Returns:
        None if the submission claims something itself, or a policy was refused.
    """
    if any(entry.episodes for entry in manifest.policies):
        return None
    number = manifest.benchmark_version
    assert number is not None
    frozen = versions()[number]
    entries, played = [], {}
    target = out / SUBMISSION

    def fill(partial: Path) -> None:
        for entry in manifest.policies:
            place = RunFolder(out / entry.place)
            table = read_table(place.table)
            given: dict[str, Any] = {"scores": scores_of(table), "episodes": episode_digests(table)}
            if not entry.agent.startswith(ADDRESS):
                given["agent"] = f"{POLICIES}/{Path(entry.agent).name}"
                copied = partial / given["agent"]
                shutil.copytree(folder / entry.agent, copied, ignore=shutil.ignore_patterns("__pycache__"))
                given["files"] = {each.name: file_digest(each.read_bytes()) for each in copied.iterdir()}
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

    if not all((out / entry.place / "episodes.parquet").exists() for entry in manifest.policies):
        return None
    replace_folder(target, fill)
    return target
