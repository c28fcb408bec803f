"""The few episodes of a run that show what it can and what it cannot, as pages that play without a server."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

from smarts.envision.episode_library import Entry, EpisodeLibrary, read_compact
from smarts.envision.viewer_page import Embedded, page_with
from smarts.errors import SmartsError
from smarts.types.events import Outcome
from smarts.whole_files import written_whole

GOAL = Outcome.GOAL.name.lower()
NO_FAILURE = {each.name.lower() for each in (Outcome.NONE, Outcome.GOAL, Outcome.OTHER, Outcome.LEFT_BUBBLE)}
"""Outcomes that are neither good nor bad, and the goal."""
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


LeftOut = list[tuple[Entry, str]]
"""Episodes that cannot be shown, each with the reason."""


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


def embedded(
    library: EpisodeLibrary, chosen: Iterable[Notable]
) -> tuple[list[tuple[Notable, Embedded]], LeftOut]:
    """Return readable episodes in the form in which a page embeds them, and the damaged ones."""
    shown: list[tuple[Notable, Embedded]] = []
    left_out: LeftOut = []
    for each in chosen:
        entry, path = each.entry, library.path(each.entry.id)
        assert path is not None
        try:
            shown.append((each, Embedded(entry.id, entry.label, read_compact(path), each.why)))
        except SmartsError as error:
            left_out.append((entry, error.problem))
    return shown, left_out


def write_notable(library: EpisodeLibrary, out: Path) -> tuple[list[Notable], LeftOut]:
    """Write a page with a library's notable episodes; return these episodes, and the damaged ones.

    Raises:
        SmartsError: No episode can be shown, or the page cannot be written.
    """
    entries = library.entries()
    shown, left_out = embedded(library, notable_episodes(entries))
    left_out += [(each, each.error) for each in entries if each.error]
    if not shown:
        raise SmartsError(
            f"none of {len(entries)} episodes can be shown"
            + "".join(f"; {entry.label}: {why}" for entry, why in left_out[:_MOST_NAMED]),
            place=str(out),
            remedy="record episodes until they end, or name an unfinished one alone",
        )
    with written_whole(out) as partial:
        partial.write_text(page_with([each for _, each in shown]), encoding="utf-8")
    return [each for each, _ in shown], left_out


def _share(entry: Entry) -> float:
    return entry.outcomes.get(GOAL, 0) / entry.agents


def _failures(entry: Entry) -> float:
    return sum(count for name, count in entry.outcomes.items() if name not in NO_FAILURE) / entry.agents


def _collisions(entry: Entry) -> float:
    return entry.outcomes.get(Outcome.COLLISION.name.lower(), 0) / entry.agents
