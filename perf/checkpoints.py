"""Whether the checkpoint of a run is restored whole.

    python -m perf.checkpoints RUN_FOLDER [RUN_FOLDER ...]

Restores each run's last checkpoint by the code with which `smarts-bench run` continues, saves the algorithm
again without training, and compares all that learners store, value by value: weights of policies, critics,
mixers and target networks; the optimisers' state; random generators; counters; what an algorithm holds
between rollouts; and the replay buffer, where the run saves it (`checkpoint_replay`). As a control, a new
algorithm of the same seed has to differ from the checkpoint. The run's folder is not changed. Exit code 1:
something was not restored, or a new algorithm would have passed.

That what is stored suffices to continue is tested for every algorithm in
tests/unit/algorithms/joint/test_whole_registry.py.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Iterator, Mapping
from concurrent.futures import ProcessPoolExecutor
from dataclasses import fields, is_dataclass
from multiprocessing import get_context
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import ray
import torch
from ray import cloudpickle

from algorithms.errors import AlgorithmError
from benchmark.results.run_folder import RunFolder
from benchmark.running.cluster import start_ray
from benchmark.running.trained_run import read_run
from benchmark.running.training import Training, algorithm_of
from smarts.errors import SmartsError

LEARNER = "learner_group"
OTHERWISE = ("weights_seq_no", "metrics_logger")
"""What differs on purpose: restored weights get a new number, and metrics begin with the process."""


def values_in(checkpoint: Path) -> dict[str, Any]:
    """Return all that learners stored in a checkpoint's folder by its place: arrays and single values.

    Raises:
        FileNotFoundError: It holds nothing of a learner.
        TypeError: It holds an object whose parts are not known, so that it could not be compared.
    """
    found = {}
    for file in sorted((checkpoint / LEARNER).rglob("*state.pkl")):
        with file.open("rb") as opened:
            place = file.relative_to(checkpoint).with_suffix("").as_posix()
            found |= dict(_leaves(cloudpickle.load(opened), place))
    if not found:
        raise FileNotFoundError(f"{checkpoint / LEARNER} holds no state of a learner")
    return found


def _leaves(node: Any, place: str) -> Iterator[tuple[str, Any]]:
    if is_dataclass(node) and not isinstance(node, type):
        node = {each.name: getattr(node, each.name) for each in fields(node)}
    if isinstance(node, torch.Tensor):
        node = node.detach().cpu().numpy()
    if isinstance(node, Mapping):
        yield f"{place}/", sorted(map(repr, node))
        for key, value in node.items():
            if key not in OTHERWISE:
                yield from _leaves(value, f"{place}/{key}")
    elif isinstance(node, list | tuple):
        yield f"{place}/", len(node)
        for number, value in enumerate(node):
            yield from _leaves(value, f"{place}/{number}")
    elif node is None or isinstance(node, np.ndarray | np.generic | bool | int | float | str):
        yield place, node
    else:
        raise TypeError(f"{place}: {type(node).__name__} cannot be compared")


def differing(one: Mapping[str, Any], other: Mapping[str, Any]) -> list[str]:
    """Return the places at which two results of `values_in` differ, or which one of them lacks."""
    return [
        place
        for place in sorted({*one, *other})
        if not (place in one and place in other) or not _is_same(one[place], other[place])
    ]


def _is_same(one: Any, other: Any) -> bool:
    if isinstance(one, np.ndarray) and isinstance(other, np.ndarray):
        alike = one.dtype == other.dtype and one.shape == other.shape
        return alike and one.tobytes() == other.tobytes()
    return type(one) is type(other) and repr(one) == repr(other)


class Restored(NamedTuple):
    """What was compared of a checkpoint and is equal after it was restored."""

    values: int
    """Arrays, single values and names of parts."""
    numbers: int
    """In the arrays."""
    weights: int
    """Arrays and single values of networks, targets included."""
    changed: int
    """Values that a new algorithm has otherwise."""
    changed_weights: int
    """Those of networks among them."""


def check(path: Path) -> Restored:
    """Compare a run's last checkpoint with what is restored from it.

    Raises:
        RuntimeError: Something was not restored, or a new algorithm has the same weights.
        ResultsError: There is no run, no checkpoint, or it is damaged.
    """
    folder = RunFolder(path)
    saved, run = values_in(folder.kept("last")), read_run(folder)
    start_ray(run.resources)
    with tempfile.TemporaryDirectory(prefix="smarts-bench-") as temporary, algorithm_of(run) as algo:
        new, restored = Path(temporary, "new"), Path(temporary, "restored")
        algo.save_to_path(str(new))
        Training(run, folder, algo)
        algo.save_to_path(str(restored))
        control, problems = differing(saved, values_in(new)), differing(saved, values_in(restored))
    if problems:
        raise RuntimeError(f"{len(problems)} of {len(saved)} were not restored, the first is {problems[0]}")
    weights = {place for place in saved if "/rl_module/" in place and not place.endswith("/")}
    moved = weights.intersection(control)
    if not moved:
        raise RuntimeError("the checkpoint has the weights of a new algorithm, so this shows nothing")
    numbers = sum(value.size for value in saved.values() if isinstance(value, np.ndarray))
    return Restored(len(saved), numbers, len(weights), len(control), len(moved))


def check_apart(path: Path) -> Restored:
    """Return what `check` does, in a process with a Ray of its own."""
    with ProcessPoolExecutor(1, get_context("spawn")) as apart:
        return apart.submit(_check_once, path).result()


def _check_once(path: Path) -> Restored:
    try:
        return check(path)
    finally:
        ray.shutdown()


def main() -> int:
    """Check and print; return the exit code."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("runs", nargs="+", type=Path, metavar="RUN_FOLDER")
    code = 0
    for path in parser.parse_args().runs:
        try:
            found = check(path)
        except (RuntimeError, SmartsError, AlgorithmError) as error:
            print(f"{path}: FAILED: {error}", flush=True)
            code = 1
            continue
        print(
            f"{path}: {found.values:,} values ({found.numbers:,} numbers in arrays) are restored; a new "
            f"algorithm differs in {found.changed:,}, {found.changed_weights} of the {found.weights} of "
            "networks among them",
            flush=True,
        )
    return code


if __name__ == "__main__":
    sys.exit(main())
