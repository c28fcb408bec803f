"""Experiments: train, test, compare, report.

`run(Experiment(name=..., algorithms=[...], tasks=[...]))` trains and tests as `smarts-bench run` does;
`load_policy(folder).act(observations, infos)` plays a trained policy.
"""

from __future__ import annotations

import importlib
import importlib.util
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from benchmark.experiment.models import Experiment
    from benchmark.running.experiment import run
    from benchmark.running.policy import Policy, load_policy

__all__ = ["Experiment", "Policy", "load_policy", "run"]

# Imported when asked for: not every command needs torch and Ray.
_PLACES = {
    "Experiment": "benchmark.experiment.models",
    "Policy": "benchmark.running.policy",
    "load_policy": "benchmark.running.policy",
    "run": "benchmark.running.experiment",
}
_SIBLINGS = ("algorithms", "smarts")
"""Packages that this one imports, and that lie beside it."""


def _check_siblings() -> None:
    """Raise if a folder of the user's hides one of the packages, as one beside a script does.

    Raises:
        ImportError: Names both places and what to do.
    """
    root = Path(__file__).resolve().parents[1]
    for name in _SIBLINGS:
        spec = importlib.util.find_spec(name)
        places = [] if spec is None else [*(spec.submodule_search_locations or ()), spec.origin]
        found = [Path(place) for place in places if place and place != "namespace"]
        if any(place.resolve().is_relative_to(root / name) for place in found):
            continue
        there = str(found[0]) if found else "nowhere"
        raise ImportError(
            f"`import {name}` finds {there}, not {root / name}, which `benchmark` needs: rename that file or "
            "folder, or start Python where it is not on the path (sys.path)",
            name=name,
            path=there,
        )


_check_siblings()


def __getattr__(name: str) -> Any:
    if name not in _PLACES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(_PLACES[name]), name)
