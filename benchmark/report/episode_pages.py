"""Recorded test episodes beside a report: of each run the best, the worst, each kind of failure."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from benchmark.experiment.runs import SCRIPTED
from benchmark.report.paper import algorithm_label, task_label, traffic_label
from benchmark.results.files import ResultsError
from benchmark.results.reading import Results, RunResult
from benchmark.results.run_folder import RunFolder
from smarts.envision.episode_library import EpisodeLibrary
from smarts.envision.notable_episodes import write_notable
from smarts.errors import SmartsError
from smarts.sstudio.locating import VARIATION_MARK

EPISODES = "episodes"
"""Folder of the pages in a report's folder."""


@dataclass(frozen=True)
class EpisodeLinks:
    """The episodes of one run that a report links."""

    algorithm: str
    task: str
    traffic: str
    seed: str
    links: tuple[tuple[str, str], ...]
    """Text and address, relative to the report's folder."""
    problem: str = ""
    """Why there are none, or which are left out."""

    @property
    def names(self) -> tuple[str, str, str, str]:
        """Of the run."""
        return self.algorithm, self.task, self.traffic, self.seed


def write_episodes(results: Results, mode: str, folder: Path) -> list[EpisodeLinks]:
    """Write the pages of all finished runs; return what links to them.

    Args:
        results: The results.
        mode: Way of acting whose episodes are shown; scripted policies have one only.
        folder: Of the report.
    """
    return [_of_run(run, results.root, mode, folder) for run in results.finished]


def names_of(run: RunResult) -> tuple[str, str, str, str]:
    """Return algorithm, task, traffic and seed as a report shows them."""
    seed = "scripted" if run.is_scripted else str(run.seed)
    return algorithm_label(run.algorithm), task_label(run.task), traffic_label(run.traffic), seed


def _of_run(run: RunResult, root: Path, mode: str, folder: Path) -> EpisodeLinks:
    names = names_of(run)
    episodes = RunFolder(root / run.place).episodes
    if not episodes.is_dir():
        return EpisodeLinks(
            *names, (), "not kept: give the command of `run` again with `--set evaluation.keep_episodes=true`"
        )
    try:
        return EpisodeLinks(*names, *_links(episodes, SCRIPTED if run.is_scripted else mode, folder, run))
    except SmartsError as error:
        return EpisodeLinks(*names, (), error.problem)


def _links(
    episodes: Path, mode: str, folder: Path, run: RunResult
) -> tuple[tuple[tuple[str, str], ...], str]:
    """Return the links, and which episodes are left out."""
    trained_on = f"{mode}-{'-'.join(Path(each).name for each in run.config.get('scenarios', ()))}"
    parts = [
        part
        for part in sorted(episodes.glob(f"{mode}-*"))
        if part.is_dir() and (VARIATION_MARK not in part.name or f"{part.name}-".startswith(f"{trained_on}-"))
    ]  # the others are of variations that are held out
    if not parts:
        raise ResultsError("no episodes of these tests were kept", place=str(episodes))
    page_name = f"{run.place.replace('/', '-')}.html"
    written = write_notable(EpisodeLibrary(parts), folder / EPISODES / page_name)
    links = tuple(
        (notable.label, f"{page.relative_to(folder).as_posix()}#e={notable.entry.id}")
        for notable, page in written.pages
    )
    return links, "; ".join(f"{entry.label} is left out: {why}" for entry, why in written.left_out)
