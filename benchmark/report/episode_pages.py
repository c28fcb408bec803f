"""Recorded test episodes that a report's page plays."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from benchmark.experiment.runs import SCRIPTED
from benchmark.results.files import ResultsError
from benchmark.results.reading import Results, RunResult
from benchmark.results.run_folder import RunFolder
from smarts.envision.episode_library import Entry, EpisodeLibrary
from smarts.envision.notable_episodes import NO_FAILURE, Notable, embedded, notable_episodes
from smarts.envision.viewer_page import page_with
from smarts.errors import SmartsError
from smarts.sstudio.locating import VARIATION_MARK


def _tested(episodes: Path, mode: str, run: RunResult) -> EpisodeLibrary:
    """Return the episodes of a run's test in the variations of its training.

    Raises:
        ResultsError: None were kept.
    """
    trained_on = f"{mode}-{'-'.join(Path(each).name for each in run.config.get('scenarios', ()))}"
    parts = [
        part
        for part in sorted(episodes.glob(f"{mode}-*"))
        if part.is_dir() and (VARIATION_MARK not in part.name or f"{part.name}-".startswith(f"{trained_on}-"))
    ]  # the others are of variations that are held out
    if not parts:
        raise ResultsError("no episodes of these tests were kept", place=str(episodes))
    return EpisodeLibrary(parts)


@dataclass(frozen=True)
class Replays:
    """Episodes that a report's page plays."""

    episodes: tuple[tuple[str, str], ...] = ()
    """Why each is shown, and its id in the page."""
    page: bytes = b""
    """The viewer with the episodes inside."""
    left_out: tuple[str, ...] = ()
    """Each further one with the reason why it is not shown."""


def replays(results: Results, mode: str, name: str) -> Replays:
    """Return the best, the worst and a typical failed test episode of a policy's first run that kept some.

    Args:
        results: The results.
        mode: Way of acting whose episodes are shown; scripted policies have one only.
        name: Algorithm or scripted policy.
    """
    runs = (run for run in results.finished if run.algorithm == name)
    run = next((run for run in runs if RunFolder(results.root / run.place).episodes.is_dir()), None)
    if run is None:
        return Replays()
    try:
        episodes = RunFolder(results.root / run.place).episodes
        library = _tested(episodes, SCRIPTED if run.is_scripted else mode, run)
        chosen = [
            each
            for each in notable_episodes(library.entries())
            if {*each.why.split(", ")} & {"best", "worst"}
        ]
        chosen += _typical_failure(library.entries(), chosen)
    except SmartsError:  # none of this way of acting
        return Replays()
    shown, left_out = embedded(library, chosen)
    page = page_with([each for _, each in shown]) if shown else ""
    return Replays(
        tuple((each.why, each.entry.id) for each, _ in shown),
        page.encode(),
        tuple(f"{entry.label}: {why}" for entry, why in left_out),
    )


def _typical_failure(entries: Sequence[Entry], shown: Sequence[Notable]) -> list[Notable]:
    """Return an episode, none of those shown, with as many of the most frequent failure as is usual."""
    there = {each.entry.id for each in shown}
    whole = [each for each in entries if each.complete and not each.invalid and not each.error]
    counts: Counter[str] = Counter()
    for each in whole:
        counts.update({name: count for name, count in each.outcomes.items() if name not in NO_FAILURE})
    for kind, total in counts.most_common():
        failed = [each for each in whole if each.outcomes.get(kind)]
        usual = total / len(failed)
        failed.sort(key=lambda each: (abs(each.outcomes[kind] - usual), each.seconds, each.label))
        for each in failed:
            if each.id not in there:
                return [Notable(each, f"typical failure: {kind.replace('_', ' ')}")]
    return []
