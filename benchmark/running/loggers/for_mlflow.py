"""A run's progress for MLflow, at MLFLOW_TRACKING_URI, which may be a folder or a file."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from mlflow import MlflowClient  # pyright: ignore[reportMissingImports]
from mlflow.entities import Metric, Param  # pyright: ignore[reportMissingImports]

from benchmark.results.run_folder import flat_values
from benchmark.running.loggers import Logged, numbers_of

TAG = "smarts_bench"
"""Tag by which a training that continues finds its run."""


class MLflow:
    """Logs the columns of progress.csv to a run in the MLflow experiment of the experiment's name.

    Args:
        logged: The training.
        lines: Lines of the progress so far; at the same time and step as before, so that they are there once.
    """

    def __init__(self, logged: Logged, lines: Iterable[Mapping[Any, Any]]) -> None:
        self._client = client = MlflowClient()
        known = client.get_experiment_by_name(logged.experiment)
        place = known.experiment_id if known else client.create_experiment(logged.experiment)
        runs = client.search_runs([place], f"tags.{TAG} = '{logged.id}'")
        run = runs[0] if runs else client.create_run(place, run_name=logged.name, tags={TAG: logged.id})
        self._id, self._begun = run.info.run_id, run.info.start_time
        if not runs:
            values = flat_values(logged.config).items()
            client.log_batch(self._id, params=[Param(name, str(value)) for name, value in values])
        for line in lines:
            self.add(line)

    def add(self, line: Mapping[Any, Any]) -> None:
        """Log a line."""
        step, at = int(line["agent_steps"]), self._begun + round(1000 * float(line["seconds"]))
        metrics = [Metric(name, value, at, step) for name, value in numbers_of(line)]
        self._client.log_batch(self._id, metrics=metrics)

    def close(self) -> None:
        """End the run."""
        self._client.set_terminated(self._id)
