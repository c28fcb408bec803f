"""The environments of a run: for training, validation and test."""

from __future__ import annotations

from collections.abc import Sequence
from inspect import signature
from pathlib import Path
from typing import Any

from benchmark.experiment.runs import Cell
from smarts.env.adapters import ADAPTERS
from smarts.env.vector import VectorHiWayEnv
from smarts.sim.assembly import Options

NAME = "smarts-bench"
"""Of the training environment among RLlib's."""


def environment(
    cell: Cell,
    *,
    copies: int | None = None,
    scenarios: Sequence[str] = (),
    record: Path | None = None,
    discount: float | None = None,
) -> Any:
    """Return a cell's environment, a `VectorHiWayEnv`; the learners know it by its shape, not its type.

    Args:
        cell: What is played.
        copies: Simulations side by side, by default the cell's.
        scenarios: Others than the cell's, such as held-out variations.
        record: Where episodes are written to.
        discount: Of the learner, which shaped rewards have to agree with; by default that of the weights.

    Raises:
        SmartsError: A scenario cannot be built, or an option is wrong.
    """
    given = cell.environment
    return VectorHiWayEnv(
        copies or cell.copies,
        list(scenarios or cell.task.scenarios),
        agents=given.agents,
        decision_interval=given.decision_interval,
        adapter=given.adapter,
        adapter_options={**_discounted(given.adapter, discount), **given.options},
        simulation=Options(record=record),
        traffic=[cell.traffic],
    )


def _discounted(adapter: str, discount: float | None) -> dict[str, float]:
    """Return the option that tells an adapter the learner's discount, if it wants to know."""
    takes_it = "discount" in signature(ADAPTERS[adapter]).parameters
    return {} if discount is None or not takes_it else {"discount": discount}


def create(config: Any) -> Any:
    """Return the training environment that RLlib asks for: `config["cell"]`, for a learner's `"discount"`."""
    return environment(config["cell"], copies=config["num_envs"], discount=config["discount"])
