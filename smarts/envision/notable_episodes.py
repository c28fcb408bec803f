"""The few episodes of a run that show what it can and what it cannot, as pages that play without a server."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from smarts.envision.compact_episode import compact_episode
from smarts.envision.episode_library import Entry, EpisodeLibrary, read_compact
from smarts.envision.viewer_page import MOST_BYTES, Embedded, page_with, room_of_page
from smarts.errors import SmartsError
from smarts.sim.episode_files import RecordedEpisode
from smarts.types.events import Outcome

GOAL = Outcome.GOAL.name.lower()
_NO_FAILURE = {each.name.lower() for each in (Outcome.NONE, Outcome.GOAL, Outcome.OTHER, Outcome.LEFT_BUBBLE)}
_SHORTEST = 2.0
"""A long episode is cut to what is before its end, but not shorter than this [s]."""


@dataclass(frozen=True)
class Notable:
    """An episode, and why it is shown."""

    entry: Entry
    why: str
    """"best", "worst", or how an agent failed."""

    @property
    def label(self) -> str:
        """What the page calls it."""
        ends = ", ".join(f"{count} {name.replace('_', ' ')}" for name, count in self.entry.outcomes.items())
        return f"{self.why}: {ends} ({self.entry.scenario}, {self.entry.seconds:.0f} s)"


def notable_episodes(entries: Iterable[Entry]) -> list[Notable]:
    """Return the best episode, the worst one, and one of each further kind of failure.

    Best is where most agents reached their goals, then where it took the least time; worst where the most
    failed, then where most collided. Invalid, unfinished and damaged episodes are left out.
    """
    whole = [
        each for each in entries if each.complete and not each.invalid and not each.error and each.agents
    ]
    if not whole:
        return []
    best = min(whole, key=lambda each: (-_share(each), each.seconds, each.label))
    worst = min(whole, key=lambda each: (-_failures(each), -_collisions(each), each.seconds, each.label))
    found = [Notable(best, "best")]
    if _failures(worst):
        found.append(Notable(worst, "worst"))
    for outcome in Outcome:
        name = outcome.name.lower()
        of_kind = [each for each in whole if name not in _NO_FAILURE and each.outcomes.get(name)]
        if of_kind and not any(each.entry.outcomes.get(name) for each in found[1:]):
            # Where little else happened, the failure is easiest to see.
            clearest = min(of_kind, key=lambda each: (_failures(each), each.seconds, each.label))
            found.append(Notable(clearest, name.replace("_", " ")))
    return found


def write_pages(
    library: EpisodeLibrary, chosen: Sequence[Notable], out: Path
) -> Iterator[tuple[Notable, Path]]:
    """Write episodes into as few pages as their size allows; yield each with its page.

    An episode that is too long for a page is cut to its last part.

    Args:
        library: That has the episodes.
        chosen: Which.
        out: The first page; further ones have a number behind the name.

    Raises:
        SmartsError: An episode is damaged, or a page cannot be written.
    """
    pages: list[list[tuple[Notable, Embedded]]] = []
    left = 0
    for each in chosen:
        embedded = _fitting(library, each)
        size = room_of_page([embedded])
        if not pages or size > left:
            pages.append([])
            left = MOST_BYTES - room_of_page([])
        pages[-1].append((each, embedded))
        left -= size - room_of_page([])
    for number, page in enumerate(pages):
        path = out if number == 0 else out.with_stem(f"{out.stem}-{number + 1}")
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(page_with([embedded for _, embedded in page]), encoding="utf-8")
        for each, _ in page:
            yield each, path


def _fitting(library: EpisodeLibrary, notable: Notable) -> Embedded:
    """Return an episode that fits into a page alone."""
    entry = notable.entry
    path = library.path(entry.id)
    assert path is not None
    embedded = Embedded(entry.id, notable.label, read_compact(path))
    seconds = entry.seconds
    while room_of_page([embedded]) > MOST_BYTES:
        seconds /= 1.5
        if path.is_file() or seconds < _SHORTEST:
            raise SmartsError(
                f"{len(embedded.data) / 1e6:.1f} MB, too much for a page of {MOST_BYTES / 1e6:.0f} MB",
                place=str(path),
                remedy="open it with `smarts-bench view`, which has no limit",
            )
        part = compact_episode(RecordedEpisode(path), entry.seconds - seconds, policy=entry.policy)
        embedded = replace(embedded, label=f"{notable.label}, last {seconds:.0f} s", data=part)
    return embedded


def _share(entry: Entry) -> float:
    return entry.outcomes.get(GOAL, 0) / entry.agents


def _failures(entry: Entry) -> float:
    return sum(count for name, count in entry.outcomes.items() if name not in _NO_FAILURE) / entry.agents


def _collisions(entry: Entry) -> float:
    return entry.outcomes.get(Outcome.COLLISION.name.lower(), 0) / entry.agents
