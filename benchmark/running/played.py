"""What is played in a cell: its scenarios as they were built, and held-out variations of them."""

from __future__ import annotations

from collections.abc import Iterator

from benchmark.experiment.runs import Cell
from smarts.sstudio.build import build_scenario
from smarts.sstudio.built import BuiltScenario
from smarts.sstudio.encoding import digest, encode


def held_out_of(cell: Cell) -> Iterator[str]:
    """Yield held-out variations, as "scenario@variation", that are something else than what is trained on.

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
            if digest_of(build_scenario(name), cell) != digest_of(trained_on, cell):
                yield name


def scenario_digests(cell: Cell) -> dict[str, str]:
    """Return a digest of each scenario that a cell is trained and tested on, those held out too.

    Raises:
        SmartsError: One cannot be built or played.
    """
    names = [*cell.task.scenarios, *held_out_of(cell)]
    return {name: digest_of(build_scenario(name), cell) for name in names}


def digest_of(built: BuiltScenario, cell: Cell) -> str:
    """Return a digest of all that a cell's episodes in a scenario are made of.

    That is less than the digest in the name of the build's folder: other traffic of the same scenario, or a
    program that builds the same in another way, change nothing here.
    """
    files = built.traffic_files(cell.traffic)
    contents = [file.read_text(encoding="utf-8") for file in (files.net, *files.routes, *files.additional)]
    plans = built.with_traffic([cell.traffic]).episodes(cell.environment.agents)
    starts = encode(built.scenario.start_variation)
    return digest([contents, files.warm_up, [encode(plan) for plan in plans], starts], size=8)
