"""A run's progress for Weights & Biases; `WANDB_MODE=offline` writes into the run's folder alone."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import wandb  # pyright: ignore[reportMissingImports]

from benchmark.running.loggers import Logged, numbers_of


class WandB:
    """Logs the columns of progress.csv to a run in the experiment's project.

    A line that the run has already, since training continues before its last one, is not logged again: steps
    of a run only grow.

    Args:
        logged: The training.
        lines: Lines of the progress so far.
    """

    def __init__(self, logged: Logged, lines: Iterable[Mapping[Any, Any]]) -> None:
        self._run = wandb.init(
            project=logged.experiment,
            name=logged.name,
            id=logged.id,
            resume="allow",
            reinit="create_new",  # several trainings at a time
            dir=str(logged.folder),
            config=dict(logged.config),
            settings=wandb.Settings(silent=True, console="off"),
        )
        self._run.define_metric("*", step_metric="agent_steps")
        for line in lines:
            self.add(line)

    def add(self, line: Mapping[Any, Any]) -> None:
        """Log a line."""
        step = int(line["iteration"])
        self._run.log({"agent_steps": int(line["agent_steps"]), **dict(numbers_of(line))}, step=step)

    def close(self) -> None:
        """Send what is left, and end the run."""
        self._run.finish()
