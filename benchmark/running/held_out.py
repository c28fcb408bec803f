"""Which held-out variations of a cell's scenarios are played to measure generalization."""

from __future__ import annotations

from collections.abc import Iterator

from benchmark.experiment.runs import Cell
from smarts.sstudio.build import build_scenario
from smarts.sstudio.built import BuiltScenario


def held_out_of(cell: Cell) -> Iterator[str]:
    """Yield the variations, as "scenario@variation", that are something else than what was trained on.

    Many variations are of the traffic alone: without traffic they are the training once more.

    Raises:
        SmartsError: One cannot be built or played.
    """
    if not cell.evaluation.held_out_episodes:
        return
    for scenario in cell.task.scenarios:
        trained_on = build_scenario(scenario)
        for variation in trained_on.held_out:
            name = f"{scenario}@{variation}"
            if _played(build_scenario(name), cell) != _played(trained_on, cell):
                yield name


def _played(built: BuiltScenario, cell: Cell) -> tuple[object, ...]:
    """Return all that a cell's episodes in a scenario are made of."""
    files = built.traffic_files(cell.traffic)
    contents = [file.read_bytes() for file in (files.net, *files.routes, *files.additional)]
    plans = built.with_traffic([cell.traffic]).episodes(cell.environment.agents)
    return contents, files.warm_up, plans, built.scenario.start_variation
