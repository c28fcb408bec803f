"""The functions that a scenario file ends with; they hand over the scenario.

While a scenario is being built they contribute to it. Called by hand they build at once:

- by `python scenario.py`, the whole file is built, as by `build_scenario`;
- from a notebook or another program, everything given for a folder so far is built; a later call of the same
  kind replaces an earlier one.

Arguments that had a meaning in the original and have none here, since builds are implicit, are accepted
and ignored: `overwrite`, `ovewrite` (sic), `output_dir` beside a scenario's folder.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from smarts.sstudio import sstypes as t
from smarts.sstudio.collecting import Collection, current_collection
from smarts.sstudio.families import SPLITS, draw_map
from smarts.sstudio.sstypes.drawing import DEFAULT_SEED

if TYPE_CHECKING:
    from numpy.random import Generator

Actors = t.SocialAgentActor | Sequence[t.SocialAgentActor]

DEFAULT_TRAFFIC_NAME = "routes"


def gen_scenario(
    scenario: t.Scenario,
    output_dir: str | Path,
    seed: int = DEFAULT_SEED,
    overwrite: bool = False,
    *,
    ovewrite: bool = False,
) -> None:
    """Hand over a whole scenario.

    Args:
        scenario: The scenario.
        output_dir: Its folder.
        seed: For what is drawn when the scenario is built, such as random routes.
        overwrite: Ignored.
        ovewrite: Ignored.

    Raises:
        ScenarioError: A scenario file calls it twice.
    """
    _contribute(output_dir, "scenario", scenario, seed, is_whole=True)


def gen_family(
    draw: Callable[[Generator], t.Scenario], output_dir: str | Path, maps: Mapping[str, int] = SPLITS
) -> None:
    """Hand over a family of maps, of which each is a scenario named as a variation: "intersections@train-07".

    The family's own name means its first map. No two maps of a family are equal, whatever their splits.

    Args:
        draw: Returns the scenario on a map drawn with the generator, with the map as `MapSpec.plain`.
        output_dir: The family's folder.
        maps: How many maps each split has.

    Raises:
        ScenarioError: The draws do not differ.
    """
    collection = current_collection()
    names = [f"{split}-{number:02}" for split, count in maps.items() for number in range(count)]
    if collection is not None and collection.wanted in names:
        collection.is_wanted = True
        scenario = draw_map(draw, names, collection.wanted)
    else:
        scenario = draw_map(draw, names, names[0])
        descriptions = {name: t.Variation(f"Map {name} of the family.") for name in names}
        scenario = replace(scenario, held_out=None if collection is None else descriptions)
    gen_scenario(scenario, output_dir)


def gen_traffic(
    scenario: str | Path,
    traffic: t.Traffic,
    name: str | None = None,
    output_dir: str | Path | None = None,
    seed: int = DEFAULT_SEED,
    overwrite: bool = False,
    map_spec: t.MapSpec | None = None,
) -> None:
    """Hand over one variation of the traffic.

    Args:
        scenario: The scenario's folder.
        traffic: The traffic.
        name: The variation's name.
        output_dir: Ignored.
        seed: For what is drawn of this traffic when it is built.
        overwrite: Ignored.
        map_spec: The map, if it is not the one in the folder.
    """
    name = name or DEFAULT_TRAFFIC_NAME
    if seed != DEFAULT_SEED:
        traffic = replace(traffic, seed=int(seed))
    _contribute(scenario, f"traffic {name}", t.Scenario(traffic={name: traffic}, map_spec=map_spec))


def gen_missions(
    scenario: str | Path,
    missions: Sequence[t.AnyMission],
    seed: int = DEFAULT_SEED,
    overwrite: bool = False,
    *,
    actors: Sequence[t.Actor] | None = None,
    name: str = "missions",
    output_dir: str | Path | None = None,
    map_spec: t.MapSpec | None = None,
) -> None:
    """Hand over the missions of the learning agents, or of social agents where `actors` are such.

    Args:
        scenario: The scenario's folder.
        missions: The missions.
        seed: For what is drawn when the scenario is built.
        overwrite: Ignored.
        actors: Social agents, or None for the learning agents.
        name: The group's name, for social agents.
        output_dir: Ignored.
        map_spec: The map, if it is not the one in the folder.
    """
    social = [actor for actor in actors or () if isinstance(actor, t.SocialAgentActor)]
    if social:
        gen_social_agent_missions(scenario, missions, social, name, seed, overwrite, map_spec)
    else:
        part = t.Scenario(ego_missions=tuple(missions), map_spec=map_spec)
        _contribute(scenario, "missions", part, seed)


def gen_agent_missions(
    scenario: str | Path,
    missions: Sequence[t.AnyMission],
    map_spec: t.MapSpec | None = None,
) -> None:
    """Hand over the missions of the learning agents.

    Args:
        scenario: The scenario's folder.
        missions: The missions.
        map_spec: The map, if it is not the one in the folder.
    """
    gen_missions(scenario, missions, map_spec=map_spec)


def gen_group_laps(
    scenario: str | Path,
    begin: tuple[str, int, Any],
    end: tuple[str, int, Any],
    grid_offset: float,
    used_lanes: int,
    vehicle_count: int,
    entry_tactic: t.EntryTactic | None = None,
    num_laps: int = 3,
    seed: int = DEFAULT_SEED,
    overwrite: bool = False,
    map_spec: t.MapSpec | None = None,
) -> None:
    """Hand over lap missions of learning agents that start staggered on a grid; see `GroupedLapMission`.

    Args:
        scenario: The scenario's folder.
        begin: Edge, lane and offset of the first start; the lane counts modulo `used_lanes`.
        end: Edge, lane and offset of the first finish.
        grid_offset: Distance from each start to the one ahead [m].
        used_lanes: Number of lanes of the grid.
        vehicle_count: How many agents.
        entry_tactic: How they get their vehicles.
        num_laps: How many laps.
        seed: For what is drawn when the scenario is built.
        overwrite: Ignored.
        map_spec: The map, if it is not the one in the folder.
    """
    laps = t.GroupedLapMission(
        t.Route(begin=begin, end=end),
        offset=grid_offset,
        lanes=used_lanes,
        actor_count=vehicle_count,
        num_laps=num_laps,
        entry_tactic=entry_tactic,
    )
    _contribute(scenario, "group laps", t.Scenario(ego_missions=(laps,), map_spec=map_spec), seed)


def gen_social_agent_missions(
    scenario: str | Path,
    missions: Sequence[t.AnyMission],
    social_agent_actor: Actors,
    name: str,
    seed: int = DEFAULT_SEED,
    overwrite: bool = False,
    map_spec: t.MapSpec | None = None,
) -> None:
    """Hand over a group of social agents and their missions.

    Args:
        scenario: The scenario's folder.
        missions: The missions.
        social_agent_actor: One social agent or several.
        name: The group's name.
        seed: For what is drawn when the scenario is built.
        overwrite: Ignored.
        map_spec: The map, if it is not the one in the folder.
    """
    actors = (
        [social_agent_actor] if isinstance(social_agent_actor, t.SocialAgentActor) else social_agent_actor
    )
    part = t.Scenario(social_agent_missions={name: (tuple(actors), tuple(missions))}, map_spec=map_spec)
    _contribute(scenario, f"social agents {name}", part, seed)


def gen_bubbles(scenario: str | Path, bubbles: Sequence[t.Bubble]) -> None:
    """Hand over bubbles."""
    _contribute(scenario, "bubbles", t.Scenario(bubbles=tuple(bubbles)))


def gen_friction_map(scenario: str | Path, surface_patches: Sequence[t.RoadSurfacePatch]) -> None:
    """Hand over patches of other friction."""
    _contribute(scenario, "friction map", t.Scenario(friction_maps=tuple(surface_patches)))


def gen_traffic_histories(
    scenario: str | Path,
    histories_datasets: Sequence[t.TrafficHistoryDataset | str],
    overwrite: bool = False,
    map_spec: t.MapSpec | None = None,
) -> None:
    """Hand over recorded traffic.

    Args:
        scenario: The scenario's folder.
        histories_datasets: The data sets.
        overwrite: Ignored.
        map_spec: The map, if it is not the one in the folder.
    """
    part = t.Scenario(traffic_histories=tuple(histories_datasets), map_spec=map_spec)
    _contribute(scenario, "traffic histories", part)


def gen_metadata(scenario: str | Path, scenario_metadata: t.ScenarioMetadata) -> None:
    """Hand over facts that do not change what happens."""
    _contribute(scenario, "metadata", t.Scenario(scenario_metadata=scenario_metadata))


_given: dict[Path, dict[str, tuple[t.Scenario, int | None]]] = {}
"""Parts handed over outside of builds in this process, each with its seed, by folder and kind."""


def _contribute(
    folder: str | Path,
    kind: str,
    part: t.Scenario,
    seed: int = DEFAULT_SEED,
    is_whole: bool = False,
) -> None:
    collection = current_collection()
    # A file's own seed counts only where it differs from what it would get anyway.
    own_seed = None if seed == DEFAULT_SEED else int(seed)
    if collection is not None:
        collection.add(part, own_seed, is_whole)
        return
    # Local: building needs the map's libraries, and a scenario file that is being built never gets here.
    from smarts.sstudio.build import build_described, build_scenario

    directory = Path(folder).resolve()
    script = getattr(sys.modules.get("__main__"), "__file__", None)
    if script is not None and Path(script).resolve() == directory / "scenario.py":
        build_scenario(directory)
        return
    others = {name: given for name, given in _given.get(directory, {}).items() if name != kind}
    parts, together = {**others, kind: (part, own_seed)}, Collection()
    for each in parts.values():
        together.add(*each)
    build_described(
        directory, together.scenario or part, DEFAULT_SEED if together.seed is None else together.seed
    )
    _given[directory] = parts
