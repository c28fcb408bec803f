"""Checks of the section `cells` of experiment files: what differs in the trainings of single cells."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator

from benchmark.experiment.environment_checks import Values, section, strings
from benchmark.experiment.values import name_of
from smarts.config import Fault
from smarts.errors import nearest_names
from smarts.sstudio.locating import suite

TRAINING, SETTINGS = "training", "settings"
STANDARD = ("no_social_vehicles", "random_social_vehicles")
"""Traffic variations of every scenario of the suite."""


def check_cells(values: Values, check: Callable[[Values], Iterable[Fault]]) -> Iterator[Fault]:
    """Yield names of cells that no experiment has, and settings that algorithms cannot take in a cell.

    Args:
        values: Of the experiment.
        check: Finds faults of the sections `training` and `settings` of an experiment's values.
    """
    given = section(values, "cells")
    known = [*_names(values)] if given else []
    for name in given:
        if name not in known:
            yield Fault(("cells", name), "there is no such cell", nearest_names(name, known))
            continue
        task, is_one = name.partition("/")[:2]
        around = _laid_over(values, [section(given, task)] if is_one else [])
        known_faults = {(fault.key, fault.text) for fault in check(around)}
        for fault in check(_laid_over(around, [section(given, name)])):
            if (fault.key, fault.text) not in known_faults:
                yield Fault(("cells", name, *fault.key), fault.text, fault.remedy)


def _names(values: Values) -> Iterator[str]:
    """Yield names of the experiment's cells, and of the suite's, which `--set tasks` may leave out."""
    tasks, traffic = values.get("tasks"), [*STANDARD, *strings(values.get("traffic"))]
    own = [
        str(each.get("name")) if isinstance(each, dict) else name_of([str(each)])
        for each in (tasks if isinstance(tasks, list) else ())
    ]
    for task in dict.fromkeys([*own, *suite()]):
        yield task
        yield from (f"{task}/{each}" for each in dict.fromkeys(traffic))


def _laid_over(values: Values, cells: Iterable[Values]) -> Values:
    """Return an experiment's values with the settings of cells laid over its own."""
    training, own = dict(section(values, TRAINING)), dict(section(values, SETTINGS))
    for cell in cells:
        training |= section(cell, TRAINING)
        settings = section(cell, SETTINGS)
        own |= {name: {**section(own, name), **section(settings, name)} for name in settings}
    return {**values, TRAINING: training, SETTINGS: own}
