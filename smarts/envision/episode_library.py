"""The episodes that a viewer may open: found in folders, listed, and turned into compact episodes."""

from __future__ import annotations

import hashlib
import json
import math
import os
import threading
import time
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from smarts.envision.compact_episode import compact_episode
from smarts.errors import SmartsError
from smarts.sim.episode_files import RecordedEpisode
from smarts.types.episode_schema import EPISODE
from smarts.types.events import Outcome

MOST_CACHED = 32
"""Compact episodes that are kept, the last ones that were asked for."""
_ID_DIGITS = 12
_EPISODES = "episodes"
_FOLDERS_TO_RUN = 3
"""Levels from an episode up to its run's folder, with the part of the test and `episodes` between."""


@dataclass(frozen=True)
class Entry:
    """A line of the list of episodes."""

    id: str
    label: str
    run: str
    """The folders above the episode, from the one that was given."""
    policy: str = ""
    scenario: str = ""
    traffic: str = ""
    episode: int = 0
    seed: int = 0
    world: int = 0
    """Index of the simulation within its run."""
    steps: int = 0
    seconds: float = 0.0
    agents: int = 0
    """Number of agents in the episode, without social agents."""
    outcomes: Mapping[str, int] = field(default_factory=dict)
    """How many of these agents ended in which way."""
    complete: bool = False
    invalid: bool = False
    pair: str = ""
    """The same for episodes with the same scenario, traffic and starts, whatever drove."""
    error: str = ""
    """Why the episode cannot be opened."""
    unread: bool = False
    """Whether its files have not been read yet."""


class EpisodeLibrary:
    """Recorded episodes below some folders.

    Ids depend on an episode's path alone, so that links stay valid until it is moved; no path ever comes from
    a caller.

    Args:
        roots: Folders of runs or of episodes, single episodes.

    Raises:
        SmartsError: A path does not exist, or has no episode.
    """

    def __init__(self, roots: Sequence[Path]) -> None:
        self._roots = [Path(root) for root in roots]
        for root in self._roots:
            if next(_episodes_below(root), None) is None:
                raise SmartsError(
                    "there is no recorded episode" if root.exists() else "there is no such file or folder",
                    place=str(root),
                    remedy="name a folder recorded with simulation=Options(record=FOLDER), a run's with "
                    "keep_episodes: true, or one of the episodes",
                )
        self._lock = threading.Lock()
        self._paths: dict[str, Path] = {}
        self._entries: dict[Path, tuple[int, Entry]] = {}
        """Entries of the episodes that were read, each with the time of its file's last change."""
        self._making = threading.Lock()
        self._made = lru_cache(MOST_CACHED)(lambda path, changed: read_compact(path))
        self._find()

    def entries(self, seconds: float = math.inf) -> list[Entry]:
        """Return what is there now, damaged episodes included; what has not changed is not read again.

        Args:
            seconds: Time for reading; the episodes for which it does not suffice are `unread`.
        """
        with self._lock:
            roots, until = self._find(), time.monotonic() + seconds
            return [self._entry(number, root, until) for number, root in roots.items()]

    def _find(self) -> dict[str, Path]:
        """Bring the paths up to date; return the folder that was given of each."""
        paths: dict[str, Path] = {}
        roots: dict[str, Path] = {}
        for root in self._roots:
            for path in sorted(_episodes_below(root)):
                number = _id(path)
                if number not in paths:
                    paths[number], roots[number] = path, root
        self._paths = paths
        return roots

    def path(self, number: str) -> Path | None:
        """Return the place of an episode, None if there is no such id."""
        return self._paths.get(number)

    def compact(self, number: str) -> bytes | None:
        """Return a compact episode, None if there is no such id; two callers that ask for one share the work.

        Raises:
            SmartsError: The episode is damaged.
        """
        path = self.path(number)
        if path is None:
            return None
        with self._making:
            return self._made(path, _changed(path))

    def _entry(self, number: str, root: Path, until: float) -> Entry:
        path = self._paths[number]
        try:
            changed, (known, entry) = _changed(path), self._entries.get(path, (0, None))
            # What a damaged one lacks may be brought back.
            if entry is None or known != changed or entry.error:
                if time.monotonic() >= until:
                    return Entry(number, path.name, _run(path, root), unread=True)
                entry = _entry_of(number, path, root)
                self._entries[path] = changed, entry
            return entry
        except OSError as error:
            return Entry(number, path.name, _run(path, root), error=str(error.strerror or error))


def read_compact(path: Path) -> bytes:
    """Return an episode as a compact episode.

    Raises:
        SmartsError: It is damaged.
    """
    return compact_episode(RecordedEpisode(path), policy=policy_of_run(path))


def policy_of_run(episode: Path) -> str:
    """Return what drove the egos in an episode of a run, "" if it is of none.

    That is the algorithm or the scripted policy in `run.json`, of a run's folder above the episode.
    """
    for folder in [*episode.absolute().parents][:_FOLDERS_TO_RUN]:
        try:
            facts = json.loads((folder / "run.json").read_bytes())
        except (OSError, ValueError):
            continue
        named = facts.get("run") if isinstance(facts, dict) else None
        return named.partition(",")[0] if isinstance(named, str) else ""
    return ""


def outcomes_of(agents: Mapping[str, Any]) -> dict[str, int]:
    """Return how many agents ended in which way, from the table `agents`; social agents do not count."""
    outcomes = np.asarray(agents["outcome"])[np.asarray(agents["interface"]) < 0].tolist()
    names = {int(outcome): outcome.name.lower() for outcome in Outcome}
    return dict(Counter(names.get(outcome, str(outcome)) for outcome in outcomes))


def _episodes_below(root: Path) -> Iterator[Path]:
    """Yield episodes: folders that have the table `episode`."""
    for folder, inside, files in os.walk(root):
        if f"{EPISODE.name}.parquet" in files:
            inside.clear()
            yield Path(folder)
        # Names with a dot are of what is being written.
        inside[:] = (name for name in inside if not name.startswith("."))


def _id(path: Path) -> str:
    return hashlib.sha256(os.fsencode(path.resolve())).hexdigest()[:_ID_DIGITS]


def _changed(path: Path) -> int:
    """Return when an episode was changed last [ns]."""
    return (path / f"{EPISODE.name}.parquet").stat().st_mtime_ns


def _run(path: Path, root: Path) -> str:
    """Return the folders above an episode, from the one that was given."""
    place, above = path.resolve(), root.resolve().parent
    parts = place.parent.parts[len(above.parts) :] or (place.parent.name,)
    return "/".join(part for part in parts if part != _EPISODES)


def _entry_of(number: str, path: Path, root: Path) -> Entry:
    label, run = path.name, _run(path, root)
    try:
        episode = RecordedEpisode(path)
        episode.check_files()
        facts, agents = episode.facts, episode.table("agents")
        is_ego = np.asarray(agents["interface"]) < 0
        return Entry(
            id=number,
            label=label,
            run=run,
            policy=policy_of_run(path),
            scenario=str(facts["scenario"]),
            traffic=str(facts["traffic"]),
            episode=int(facts["episode"]),
            seed=int(facts["seed"]),
            world=int(facts["world"]),
            steps=int(facts["steps"]),
            seconds=_finite(float(facts["steps"]) * float(facts["dt"])),
            agents=int(np.count_nonzero(is_ego)),
            outcomes=outcomes_of(agents),
            complete=bool(facts["is_complete"]),
            invalid=bool(facts["is_invalid"]),
            pair=_pair(facts, agents, is_ego),
        )
    except SmartsError as error:
        return Entry(number, label, run, error=error.problem)
    except (LookupError, TypeError, ValueError, ArithmeticError) as error:
        return Entry(number, label, run, error=f"its tables do not fit together: {error!r}")


def _pair(facts: Mapping[str, Any], agents: Mapping[str, Any], is_ego: Any) -> str:
    starts = np.stack([np.asarray(agents[name], float)[is_ego] for name in ("start_x", "start_y")], -1)
    same = [str(facts[name]) for name in ("scenario", "traffic", "traffic_seed")]
    return hashlib.sha256(repr((same, np.rint(starts * 100).tolist())).encode()).hexdigest()[:_ID_DIGITS]


def _finite(value: float) -> float:
    # JSON has no other numbers.
    return value if math.isfinite(value) else 0.0


def as_json(entries: Sequence[Entry]) -> list[dict[str, Any]]:
    """Return entries as JSON can hold them."""
    return [asdict(entry) for entry in entries]
