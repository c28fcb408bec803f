"""Recorded test episodes beside a report: of each run the best, the worst, each kind of failure."""

from __future__ import annotations

import hashlib
import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd

from benchmark.experiment.runs import SCRIPTED
from benchmark.report.paper import algorithm_label, task_label, traffic_label
from benchmark.results.files import ResultsError, read_json, write_json
from benchmark.results.reading import Results, RunResult
from benchmark.results.run_folder import RunFolder
from smarts.envision.episode_library import EpisodeLibrary
from smarts.envision.notable_episodes import write_notable
from smarts.errors import SmartsError
from smarts.sstudio.locating import VARIATION_MARK

EPISODES = "episodes"
"""Folder of the pages in a report's folder."""
NOT_KEPT = "not kept: give the command of `run` again with `--set evaluation.keep_episodes=true`"


@dataclass(frozen=True)
class EpisodeLinks:
    """The episodes of one run that a report links."""

    names: tuple[str, str, str, str]
    """Algorithm, task, traffic and seed, as the report shows them."""
    links: tuple[tuple[str, str], ...]
    """Text and address, relative to the report's folder."""
    problem: str
    """Reason why there are no links, or which are left out."""


def write_episodes(results: Results, mode: str, folder: Path) -> list[EpisodeLinks]:
    """Write the pages of all finished runs; return what links to them.

    Args:
        results: The results.
        mode: Way of acting whose episodes are shown; scripted policies have one only.
        folder: Folder of the report.
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
        return EpisodeLinks(names, (), NOT_KEPT)
    try:
        return EpisodeLinks(names, *_links(episodes, SCRIPTED if run.is_scripted else mode, folder, run))
    except SmartsError as error:
        return EpisodeLinks(names, (), error.problem)


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


LINKS = "links.json"
"""Name of the file with each run's links, in the folder of the pages."""
OTHER_TEST = "no page is of this test: give `smarts-bench report --episodes`"


def note_links(results: Results, links: Sequence[EpisodeLinks], folder: Path) -> None:
    """Write what later reports need to link the same pages.

    Args:
        results: The results.
        links: Links of each finished run.
        folder: Folder of the report.
    """
    if not any(each.links for each in links):
        return
    content = [
        {"run": run.place, "test": _digest(run), "links": each.links, "problem": each.problem}
        for run, each in zip(results.finished, links, strict=True)
    ]
    write_json(folder / EPISODES / LINKS, content)


def keep_pages(results: Results, before: Path, folder: Path) -> list[EpisodeLinks]:
    """Copy the pages of an earlier report whose tests are as they were; return what links to them.

    Args:
        results: The results.
        before: Folder of the earlier report.
        folder: Folder of the report.
    """
    noted = {each["run"]: each for each in _noted(before)}
    if not noted:
        return []
    found = []
    for run in results.finished:
        there = noted.get(run.place)
        if there is None or there["test"] != _digest(run):
            found.append(EpisodeLinks(names_of(run), (), OTHER_TEST))
            continue
        for name in _pages([there]):
            (folder / EPISODES).mkdir(exist_ok=True)
            shutil.copy2(before / EPISODES / name, folder / EPISODES / name)
        links = tuple((text, address) for text, address in there["links"])
        found.append(EpisodeLinks(names_of(run), links, there["problem"]))
    note_links(results, found, folder)
    return found


def are_pages(folder: Path) -> bool:
    """Return whether a report's folder of pages is there and holds nothing else."""
    pages = folder / EPISODES
    known = {LINKS, *_pages(_noted(folder))}
    return pages.is_dir() and {each.name for each in pages.iterdir()} == known


def _pages(noted: Sequence[dict[str, Any]]) -> set[str]:
    """Return the names of the pages that are linked."""
    return {Path(address.partition("#")[0]).name for each in noted for _, address in each["links"]}


def _noted(folder: Path) -> list[dict[str, Any]]:
    """Return what an earlier report noted; nothing if there is no such note."""
    file = folder / EPISODES / LINKS
    return read_json(file) if file.exists() else []


def _digest(run: RunResult) -> str:
    return hashlib.blake2b(pd.DataFrame(run.table).to_csv().encode(), digest_size=8).hexdigest()
