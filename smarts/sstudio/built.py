"""A built scenario: its artefacts on disk and their content."""

from __future__ import annotations

import json
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any

from smarts.errors import ScenarioError, nearest_names
from smarts.roads.lane_graph import LaneGraph
from smarts.sstudio.cache import MANIFEST, note_use
from smarts.sstudio.decoding import decode
from smarts.sstudio.episodes import EpisodePlan, episode_plans
from smarts.sstudio.sstypes.scenario import Scenario
from smarts.types.recorded import RecordedTraffic
from smarts.types.traffic import TrafficFiles

SCENARIO, NET, LANES = "scenario.json", "map.net.xml", "lanes.npz"


@dataclass(frozen=True)
class BuiltScenario:
    """A scenario ready to run. Artefacts never change; a changed scenario gets new ones."""

    name: str
    """Its name with the variation, as in "intersection@dense"."""
    source: Path
    """The folder of its sources."""
    directory: Path
    """The folder of its artefacts."""
    chosen_traffic: tuple[str, ...] | None = None
    """The variations of the traffic that are played; None: all of them."""

    @cached_property
    def _manifest(self) -> dict[str, Any]:
        return _load_json(self.directory / MANIFEST)

    @cached_property
    def scenario(self) -> Scenario:
        """The scenario, read from the artefacts."""
        return _load_scenario(self.directory / SCENARIO)

    @property
    def net_file(self) -> Path:
        """The compiled SUMO network."""
        return self.directory / NET

    @property
    def notes(self) -> tuple[str, ...]:
        """Remarks for the user, such as those of a map converter."""
        return tuple(self._manifest["map_notes"] + self._manifest["notes"])

    @property
    def warnings(self) -> tuple[str, ...]:
        """Differences between the scenario's files and the simulation, such as dropped links."""
        return tuple(self._manifest["map_warnings"] + self._manifest["warnings"])

    @property
    def seed(self) -> int:
        """The seed of random routes and sampled drivers."""
        return self._manifest["seed"]

    @property
    def held_out(self) -> tuple[str, ...]:
        """Names of the variations for measuring generalization, to be built as "name@variation"."""
        return tuple(self._manifest["held_out"])

    @cached_property
    def traffic(self) -> dict[str, TrafficFiles]:
        """The variations of the traffic, by name."""
        return {
            name: TrafficFiles(
                net=self.net_file,
                routes=tuple(self.directory / file for file in files["routes"]),
                additional=tuple(self.directory / file for file in files["additional"]),
                warm_up=files["warm_up"],
                options=tuple(files["options"].items()),
                reaction_time=files["reaction_time"],
                recording=self._recording(files.get("recording")),
            )
            for name, files in self._manifest["traffic"].items()
        }

    def _recording(self, found: dict[str, Any] | None) -> RecordedTraffic | None:
        if found is None:
            return None
        return RecordedTraffic(self.directory / found["log"], found["mode"], found["begin"], found["latest"])

    @property
    def most_recorded(self) -> int:
        """The most vehicles at a time in the recordings of its traffic."""
        recordings = (files.get("recording") for files in self._manifest["traffic"].values())
        return max((each["vehicles"] for each in recordings if each), default=0)

    def traffic_files(self, name: str | None) -> TrafficFiles:
        """Return one variation of the traffic, or the empty roads for None, and note that it is used.

        Raises:
            ScenarioError: There is no such variation.
        """
        note_use(self.directory)
        if name is None:
            return TrafficFiles(net=self.net_file)
        self._require_traffic(name, self.traffic)
        return self.traffic[name]

    def roads(self) -> LaneGraph:
        """Return the map; equal artefacts share one in memory."""
        return _load_roads(self.directory / LANES)

    def episodes(self, egos: int) -> tuple[EpisodePlan, ...]:
        """Return what an environment with `egos` learning agents cycles through; see `episode_plans`."""
        return episode_plans(self.scenario, egos, traffic=self.chosen_traffic, place=self.name)

    def with_traffic(self, names: Sequence[str]) -> BuiltScenario:
        """Return the scenario with only these variations of its traffic.

        Raises:
            ScenarioError: It has no such variation.
        """
        for name in names:
            self._require_traffic(name, self.scenario.traffic or {})
        return replace(self, chosen_traffic=tuple(names))

    def _require_traffic(self, name: str, known: Collection[str]) -> None:
        if name not in known:
            remedy = nearest_names(name, known)
            if not known:
                remedy = "it has no traffic: write a scenario.py with missions and traffic for its map"
            raise ScenarioError(f"there is no traffic {name!r}", place=self.name, remedy=remedy)


def _load_json(file: Path) -> Any:
    return json.loads(file.read_text(encoding="utf-8"))


@lru_cache(maxsize=1024)
def _load_scenario(file: Path) -> Scenario:
    """Read a scenario, or return one that was read before: an experiment asks often, of hundreds."""
    return decode(_load_json(file))


_load_roads = lru_cache(maxsize=1024)(LaneGraph.load)
"""Reads a map, or returns one that was read lately."""
