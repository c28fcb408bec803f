"""Loggers by name."""

from __future__ import annotations

from smarts.registry import Registry

LOGGERS = Registry(
    "logger",
    {
        "tensorboard": "benchmark.running.loggers.for_tensorboard:TensorBoard",
        "wandb": "benchmark.running.loggers.for_wandb:WandB",
        "mlflow": "benchmark.running.loggers.for_mlflow:MLflow",
    },
    lambda name, found: found,
)
"""Name -> class that is made of a `Logged` and lines of progress.csv; `add` gets each further line."""
