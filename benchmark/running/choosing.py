"""Chooses settings after a search in several conditions; writes them as a file that experiments extend."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pandas as pd
import yaml

from benchmark.experiment.algorithm_settings import setting_names
from benchmark.experiment.models import Experiment, Tune
from benchmark.results.files import write_whole
from smarts.errors import SmartsError

TRIALS, CHOSEN = "trials.csv", "chosen.yaml"
"""Files of a search: what each trial reached; the settings that are best on average over conditions."""


class SweepError(SmartsError):
    """A search cannot be made."""


def write_chosen(
    experiment: Experiment, section: Tune, tables: Sequence[tuple[str, Path]], root: Path
) -> None:
    """Write chosen.yaml, whose `settings` are each algorithm's best on average over conditions.

    It is an experiment file: `extends: chosen.yaml` takes the settings. The averages of all trials are
    written to trials.csv and printed.

    Args:
        experiment: The experiment that was searched.
        section: Its section `tune`.
        tables: Algorithm and table of trials of each search.
        root: Folder of both files.
    """
    chosen, averages = {}, []
    for algorithm in experiment.algorithms:
        names = [name for name in section.parameters if name in setting_names(algorithm)]
        conditions = [_read(file, names, section.metric) for name, file in tables if name == algorithm]
        mean = mean_over_conditions(conditions, names, section.metric)
        chosen[algorithm] = {name: json.loads(mean[name].tolist()[0]) for name in names}
        averages.append(mean.assign(algorithm=algorithm, cells=len(conditions)))
    table = pd.concat(averages, ignore_index=True)
    write_whole(root / TRIALS, lambda file: table.to_csv(file, index=False))
    print(table.to_string(index=False))
    content = {
        "description": f"Chosen by {experiment.name}: the best {section.metric} on average over conditions.",
        "algorithms": [*experiment.algorithms],
        "tasks": [task.model_dump(mode="json") for task in experiment.tasks],
        "settings": chosen,
    }
    text = yaml.safe_dump(content, sort_keys=False)
    write_whole(root / CHOSEN, lambda file: file.write_text(text, encoding="utf-8"))
    print(f"chosen settings: {root / CHOSEN}")


def _read(file: Path, names: Sequence[str], metric: str) -> pd.DataFrame:
    """Return a table of trials with settings as texts: pandas makes NaN of null, and floats beside it."""
    missing = {metric: ["", "nan"]}
    return pd.read_csv(file, dtype=dict.fromkeys(names, str), keep_default_na=False, na_values=missing)


def mean_over_conditions(
    conditions: Sequence[pd.DataFrame], names: Sequence[str], metric: str
) -> pd.DataFrame:
    """Return each choice of settings with its mean metric, the best first.

    Args:
        conditions: Trials in each condition: columns of settings and metrics.
        names: Names of the settings.
        metric: Its name; repeated trials of one choice are averaged in each condition first.
    """
    keyed = [table.set_index(table[[*names]].astype(str).agg("; ".join, axis=1)) for table in conditions]
    choices = keyed[0].loc[~keyed[0].index.duplicated(), [*names]]
    means = {number: each.groupby(level=0)[metric].mean() for number, each in enumerate(keyed)}
    table = choices.assign(**{metric: pd.DataFrame(means).mean(axis=1)})
    return table.sort_values(metric, ascending=False, kind="stable", ignore_index=True)


def text_of(setting: Any) -> str:
    """Return a setting as tables hold it, in JSON."""
    return json.dumps(setting, default=lambda number: number.item())
