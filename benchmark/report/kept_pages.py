"""Pages with recorded episodes that a report keeps from the one before it, and what links to them."""

from __future__ import annotations

import hashlib
import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from benchmark.report.episode_pages import EPISODES, EpisodeLinks, names_of
from benchmark.results.files import read_json, write_json
from benchmark.results.reading import Results, RunResult

LINKS = "links.json"
"""In the folder of the pages: what each run's links are."""
OTHER_TEST = "no page is of this test: give `smarts-bench report --episodes`"


def note_links(results: Results, links: Sequence[EpisodeLinks], folder: Path) -> None:
    """Write what later reports need to link the same pages.

    Args:
        results: The results.
        links: Of each finished run.
        folder: Of the report.
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
        folder: Of the report.
    """
    noted = {each["run"]: each for each in _noted(before)}
    if not noted:
        return []
    found = []
    for run in results.finished:
        there = noted.get(run.place)
        if there is None or there["test"] != _digest(run):
            found.append(EpisodeLinks(*names_of(run), (), OTHER_TEST))
            continue
        for name in _pages([there]):
            (folder / EPISODES).mkdir(exist_ok=True)
            shutil.copy2(before / EPISODES / name, folder / EPISODES / name)
        links = tuple((text, address) for text, address in there["links"])
        found.append(EpisodeLinks(*names_of(run), links, there["problem"]))
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
