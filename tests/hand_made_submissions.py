"""Writes submissions of policies that always act alike, and freezes a version that they are of."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from benchmark.experiment import version
from benchmark.experiment.environment import Environment
from benchmark.experiment.models import Evaluation, TrainingTask
from benchmark.experiment.runs import TaskSetting
from benchmark.experiment.version import code_digests
from benchmark.results.files import write_json
from benchmark.results.release import MANIFEST
from benchmark.running.played import scenario_digests
from benchmark.running.submissions import submitted
from benchmark.running.verifying import verify
from smarts_agent_kit.weights import file_digest
from tests.hand_made_results import ALONE, script

ENVIRONMENT = Environment(agents=2, reward="v1", time_limit=2.0)


def task_setting(held_out=0):
    """Return the setting of `loop` without traffic."""
    task = TrainingTask(name="loop", scenarios=("loop",))
    test = Evaluation(episodes=2, held_out_episodes=held_out)
    return TaskSetting(task, ALONE, ENVIRONMENT, test, num_envs=1)


def freeze(tmp_path_factory, monkeypatch):
    """Make version 1 the present code, and `loop` without traffic; a fixture that yields its file."""
    file = tmp_path_factory.mktemp("version") / "versions.yaml"
    monkeypatch.setattr(version, "FILE", file)
    version.versions.cache_clear()
    file.write_text(
        script("freeze_version").frozen_text(
            1, {ALONE: scenario_digests(task_setting(held_out=1))}, ENVIRONMENT
        )
    )
    yield file
    version.versions.cache_clear()


def write_policy(folder: Path, *, seed=1, action=0, features=("speed",), number=1, layers=None, **trained):
    """Write an exported policy that always takes one action, by the weights of its seed, or has other layers.

    Args:
        folder: Of the policy.
        seed: Of its training.
        action: Lane action.
        features: What it observes.
        number: Version of the benchmark.
        layers: Kind and arrays of each.
        trained: Further keys of what it was trained on.
    """
    if layers is None:
        biases = (1.0 + seed) * np.eye(4, dtype=np.float32)[action]
        layers = [("linear", np.zeros((1, 4), np.float32), biases)]
    driving = {"vehicle": "generic_sedan", "vehicle_model": "bullet", "tyre_model": "pacejka"}
    agents = [{"group": "all", "place": k, "number": k, "flat_tyres": []} | driving for k in range(2)]
    content = {
        **{"format": 1, "run": "by hand", "index": None, "leaves": ["observation"], "period": 5},
        "observation": {"frames": 3, "stacked": [], "features": [*features]},
        **{"action": "Lane", "head": "best", "bounds": {"masked": False, "start": 0}},
        "agents": {f"agent-{k}": each for k, each in enumerate(agents)},
        "groups": {"all": {"places": 0, "memory": 0, "layers": [kind for kind, *_ in layers]}},
        "trained": {
            **{"algorithm": "mine", "task": "loop", "scenarios": ["loop"], "traffic": ALONE, "seed": seed},
            **{"environment": ENVIRONMENT.content(), "benchmark_version": number},
            **trained,
        },
    }
    folder.mkdir(parents=True)
    (folder / "policy.json").write_text(json.dumps(content))
    weights = {f"all/{k}/{n}": each for k, layer in enumerate(layers) for n, each in enumerate(layer[1:])}
    np.savez(folder / "policy.npz", allow_pickle=False, **weights)
    return folder


def write_submission(root: Path, seeds: Sequence[int] = (1,), *, claims=None, name="theirs", **given):
    """Write a submission of a policy for each seed, and return its folder.

    Args:
        root: The folder.
        seeds: Of the trainings.
        claims: Scores and episodes of each entry; None: it claims nothing.
        name: Of the submission.
        given: Of `write_policy`.
    """
    algorithm = given.get("algorithm", "mine")
    entries = []
    for seed in seeds:
        folder = write_policy(root / f"{seed}" / "mine", seed=seed, **given)
        files = {each.name: file_digest(each.read_bytes()) for each in folder.iterdir()}
        entry = {
            **{"algorithm": algorithm, "task": "loop", "scenarios": ["loop"], "traffic": ALONE, "seed": seed},
            **{"benchmark_version": 1, "agent": f"{seed}/mine"},
        }
        entries.append(entry | ({"files": files, **claims} if claims is not None else {}))
    manifest = {
        **{"format": 1, "name": name, "author": "A. Author", "benchmark_version": 1},
        **{"code": code_digests(), "environment": ENVIRONMENT.content()},
        "scenarios": {ALONE: scenario_digests(task_setting())},
        "policies": entries,
    }
    write_json(root / MANIFEST, manifest)
    return root


def changed(root: Path, change):
    """Change the manifest of a submission, and return its folder."""
    manifest = json.loads((root / MANIFEST).read_text())
    change(manifest)
    write_json(root / MANIFEST, manifest)
    return root


def verified(root: Path, out: Path, **given):
    """Return the verdicts on a submission."""
    manifest, folder = submitted(str(root))
    return verify(manifest, folder, out, **{"episodes": 1, "fresh": 0} | given)
