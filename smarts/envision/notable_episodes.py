"""The few episodes of a run that show what it can and what it cannot, as pages that play without a server."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from smarts.envision.compact_episode import compact_episode
from smarts.envision.episode_library import Entry, EpisodeLibrary, read_compact
from smarts.envision.viewer_page import MOST_BYTES, Embedded, page_with, room_of_page
from smarts.errors import SmartsError
from smarts.sim.episode_files import RecordedEpisode
from smarts.types.events import Outcome
from smarts.whole_files import written_whole

GOAL = Outcome.GOAL.name.lower()
NO_FAILURE = {each.name.lower() for each in (Outcome.NONE, Outcome.GOAL, Outcome.OTHER, Outcome.LEFT_BUBBLE)}
"""Outcomes that are neither good nor bad, and the goal."""
_SHORTEST = 2.0
"""A long episode is cut to what is before its end, but not shorter than this [s]."""
_MOST_NAMED = 3
"""Damaged episodes in an error."""


@dataclass(frozen=True)
class Notable:
    """An episode, and why it is shown."""

    entry: Entry
    why: str
    """"best", "worst", how an agent failed, or several of these."""

    @property
    def label(self) -> str:
        """What a link to it says."""
        ends = ", ".join(f"{count} {name.replace('_', ' ')}" for name, count in self.entry.outcomes.items())
        return f"{self.why}: {ends} ({self.entry.scenario}, {self.entry.seconds:.0f} s)"


@dataclass(frozen=True)
class Written:
    """What `write_notable` has written."""

    pages: tuple[tuple[Notable, Path], ...]
    """Each episode with its page."""
    left_out: tuple[tuple[Entry, str], ...]
    """Each damaged or too large episode with the reason."""


def notable_episodes(entries: Iterable[Entry]) -> list[Notable]:
    """Return the best episode, the worst one, and one of each further kind of failure, each episode once.

    Best is where most agents reached their goals, then where it took the least time; there is none where
    agents only fail. Worst is where the most failed, then where most collided; where there is no best and all
    ended in the same way, it is named by that way. Invalid, unfinished and damaged episodes are left out.
    """
    whole = [
        each for each in entries if each.complete and not each.invalid and not each.error and each.agents
    ]
    if not whole:
        return []
    best = min(whole, key=lambda each: (-_share(each), each.seconds, each.label))
    worst = min(whole, key=lambda each: (-_failures(each), -_collisions(each), each.seconds, each.label))
    found = [(best, "best")] if _share(best) or not _failures(best) else []
    # Where all end in the same way, none is worse than another.
    if _failures(worst) and (found or any(each.outcomes != worst.outcomes for each in whole)):
        found.append((worst, "worst"))
    shown = {name for entry, why in found if why != "best" for name, count in entry.outcomes.items() if count}
    found += _kinds_of_failure(whole, shown)
    reasons: dict[str, list[str]] = {}
    for entry, why in found:
        reasons.setdefault(entry.id, []).append(why)
    entry_of = {entry.id: entry for entry, _ in found}
    return [Notable(entry_of[number], ", ".join(whys)) for number, whys in reasons.items()]


def _kinds_of_failure(whole: list[Entry], shown: set[str]) -> Iterator[tuple[Entry, str]]:
    """Yield an episode with each kind of failure that is not shown yet, and the kind's name."""
    for name in (outcome.name.lower() for outcome in Outcome):
        of_kind = [each for each in whole if each.outcomes.get(name)]
        if of_kind and name not in NO_FAILURE | shown:
            # Where little else happened, the failure is easiest to see.
            clearest = min(of_kind, key=lambda each: (_failures(each), each.seconds, each.label))
            shown |= {kind for kind, count in clearest.outcomes.items() if count}
            yield clearest, name.replace("_", " ")


def write_notable(library: EpisodeLibrary, out: Path) -> Written:
    """Write the notable episodes of a library into as few pages as their size allows.

    An episode that is too long for a page is cut to its last part. One that is damaged is left out, and the
    choice is made among the others.

    Args:
        library: That has the episodes.
        out: The first page; further ones have a number behind the name.

    Raises:
        SmartsError: No episode can be shown, or a page cannot be written.
    """
    entries = library.entries()
    left_out = [(each, each.error) for each in entries if each.error]
    made: dict[tuple[str, str], Embedded] = {}
    while True:
        damaged = {entry.id for entry, _ in left_out}
        chosen = notable_episodes(each for each in entries if each.id not in damaged)
        missing = next((each for each in chosen if (each.entry.id, each.why) not in made), None)
        if missing is None:
            break
        try:
            made[missing.entry.id, missing.why] = fitting(library, missing)
        except SmartsError as error:
            left_out.append((missing.entry, error.problem))
    if not chosen:
        raise SmartsError(
            f"none of {len(entries)} episodes can be shown"
            + "".join(f"; {entry.label}: {why}" for entry, why in left_out[:_MOST_NAMED]),
            place=str(out),
            remedy="record episodes until they end, or name an unfinished one alone",
        )
    episodes = [(each, made[each.entry.id, each.why]) for each in chosen]
    return Written(tuple(_write_pages(episodes, out)), tuple(left_out))


def _write_pages(episodes: Iterable[tuple[Notable, Embedded]], out: Path) -> list[tuple[Notable, Path]]:
    """Write episodes into as few pages as their size allows; return each with its page."""
    pages: list[list[tuple[Notable, Embedded]]] = [[]]
    for episode in episodes:
        if pages[-1] and room_of_page([each for _, each in (*pages[-1], episode)]) > MOST_BYTES:
            pages.append([])
        pages[-1].append(episode)
    written = []
    for number, page in enumerate(pages):
        path = out if number == 0 else out.with_stem(f"{out.stem}-{number + 1}")
        with written_whole(path) as partial:
            partial.write_text(page_with([embedded for _, embedded in page]), encoding="utf-8")
        written += [(notable, path) for notable, _ in page]
    return written


def fitting(library: EpisodeLibrary, notable: Notable) -> Embedded:
    """Return an episode that fits into a page alone.

    Raises:
        SmartsError: It is damaged, or too large.
    """
    entry = notable.entry
    path = library.path(entry.id)
    assert path is not None
    embedded = Embedded(entry.id, entry.label, read_compact(path), notable.why)
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
        embedded = replace(embedded, label=f"{entry.label}, last {seconds:.0f} s", data=part)
    return embedded


def _share(entry: Entry) -> float:
    return entry.outcomes.get(GOAL, 0) / entry.agents


def _failures(entry: Entry) -> float:
    return sum(count for name, count in entry.outcomes.items() if name not in NO_FAILURE) / entry.agents


def _collisions(entry: Entry) -> float:
    return entry.outcomes.get(Outcome.COLLISION.name.lower(), 0) / entry.agents
