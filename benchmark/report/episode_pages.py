"""Recorded test episodes that a report's page plays."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from benchmark.experiment.runs import SCRIPTED
from benchmark.results.files import ResultsError
from benchmark.results.reading import Results, RunResult
from benchmark.results.run_folder import RunFolder
from smarts.envision.episode_library import EpisodeLibrary
from smarts.envision.notable_episodes import embedded, notable_episodes
from smarts.envision.viewer_page import page_with
from smarts.errors import SmartsError
from smarts.sstudio.locating import VARIATION_MARK

MOST_SHOWN = 3
"""Most episodes of a page."""


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
    """Return the best, the worst and another failed test episode of a policy's first run that kept some.

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
        chosen = notable_episodes(library.entries())[:MOST_SHOWN]
    except SmartsError:  # none of this way of acting
        return Replays()
    shown, left_out = embedded(library, chosen)
    page = page_with([each for _, each in shown]) if shown else ""
    return Replays(
        tuple((each.why, each.entry.id) for each, _ in shown),
        page.encode(),
        tuple(f"{entry.label}: {why}" for entry, why in left_out),
    )
