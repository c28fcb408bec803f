"""The benchmark's versions: what a version froze, and in what the present code and scenarios differ from it.

A version freezes, by digest, the scenarios, its tasks' lists for training and tests, the code that makes
observations, rewards and metrics, and the settings of its table's algorithms; and, by value, the settings
of the environment, and the budgets, sharing of parameters and tuning of its table's trainings.
Digests of code are of its syntax tree without docstrings: comments, docstrings and layout are free. The
simulator's own code is not frozen: results name their commit.
"""

from __future__ import annotations

import ast
import hashlib
import json
import re
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import yaml

from benchmark.experiment.environment import Environment
from smarts.config import ConfigError, fitted
from smarts.errors import shown

FILE = Path(__file__).with_name("versions.yaml")
"""Version -> part -> digest; `scenarios` is traffic -> scenario -> digest, with one of all maps of a family's
split, `tasks` task -> digest, `environment` setting -> value."""
SCENARIOS, ENVIRONMENT, TRAINING, TUNING = "scenarios", "environment", "training", "tuning"
TASKS = "tasks"
"""Part with the digests of tasks that are more than one scenario."""
SETTINGS = "settings"
"""Part of `TRAINING`: algorithm -> "task/traffic" -> digest of the settings of the version's table."""
ALL = "all others"
"""Algorithms that a version does not name."""
_ROOT = Path(__file__).parents[2]
CODE = {
    "observation": ("smarts/observations", "smarts/sensors"),
    "reward": ("smarts/rewards",),
    "metrics": ("benchmark/metrics", "benchmark/statistics"),
}
"""Part -> folders of its code."""
MAP = re.compile(r"@(\w+)-\d+")
"""In names of maps: what says which map of a family it is."""
LONGEST = 60
"""Characters of a setting's value that it names."""

Frozen = Mapping[str, Any]
Played = Mapping[str, Mapping[str, str]]
"""Traffic -> scenario -> digest."""


@cache
def versions() -> dict[int, Frozen]:
    """Return what each version froze."""
    return yaml.safe_load(FILE.read_text(encoding="utf-8"))


@cache
def code_digests(root: Path = _ROOT) -> dict[str, str]:
    """Return a digest of each part's code and settings files.

    Args:
        root: The source tree.
    """
    return {part: _digest_of([root / folder for folder in folders]) for part, folders in CODE.items()}


def _digest_of(folders: list[Path]) -> str:
    found = hashlib.blake2b(digest_size=8)
    for folder in folders:
        for file in sorted(folder.rglob("*")):
            if file.suffix in (".py", ".yaml"):
                text = file.read_text(encoding="utf-8")
                meaning = syntax_tree(text) if file.suffix == ".py" else json.dumps(yaml.safe_load(text))
                found.update(f"{file.relative_to(folder).as_posix()}\n{meaning}\n".encode())
    return found.hexdigest()


def syntax_tree(source: str) -> str:
    """Return the syntax tree of a module without texts that stand alone, such as docstrings."""
    tree = ast.parse(source)
    for node in ast.walk(tree):
        body = getattr(node, "body", None)
        if isinstance(body, list):
            node.body = [each for each in body if not _is_text(each)]  # type: ignore[attr-defined]
    return ast.dump(tree)


def _is_text(node: ast.AST) -> bool:
    is_constant = isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
    return is_constant and isinstance(node.value.value, str)  # type: ignore[attr-defined]


def changed_code(version: int) -> list[str]:
    """Return the parts of the present code that differ from a version's."""
    frozen = versions()[version]
    return [part for part, digest in code_digests().items() if frozen.get(part) != digest]


def changed_scenarios(version: int, played: Played) -> list[str]:
    """Return the scenarios that are not as a version froze them, or not part of it, as "scenario, traffic".

    Args:
        version: Version of the benchmark.
        played: Digests of what is played.
    """
    frozen = versions()[version][SCENARIOS]
    return [
        f"{name}, {traffic}"
        for traffic, digests in played.items()
        for name, digest in by_split(digests).items()
        if frozen.get(traffic, {}).get(name) != digest
    ]


def by_split(digests: Mapping[str, str]) -> dict[str, str]:
    """Return digests with one for all maps of a family's split, as "intersections@test-*"."""
    found: dict[str, list[str]] = {}
    for name in sorted(digests):
        found.setdefault(MAP.sub(r"@\1-*", name), []).append(digests[name])
    return {name: settings_digest({"maps": x}) if "*" in name else x[0] for name, x in found.items()}


def changed_task(version: int, name: str, scenarios: Sequence[str], lists: Mapping[str, Any]) -> str:
    """Return in what a task is not of a version, "" if it is; the scenarios' own digests are compared apart.

    Args:
        version: Version of the benchmark.
        name: The task's name.
        scenarios: All that it plays.
        lists: Its scenarios, weights, traffic and conditions.
    """
    frozen = versions()[version].get(TASKS, {}).get(name)
    if frozen is None and scenarios != [name]:
        return f"task {name!r} plays {shown(scenarios, LONGEST)}, not the one scenario of its name"
    if frozen is not None and frozen != settings_digest(lists):
        return f"task {name!r}: other scenarios, weights, traffic or conditions: restore its lists"
    return ""


def changed_settings(version: int, environment: Environment) -> list[str]:
    """Return the settings of the environment that are not as a version froze them.

    Args:
        version: Version of the benchmark.
        environment: Environment of an experiment or a run; newer settings than the version have defaults.
    """
    try:
        frozen = fitted(versions()[version][ENVIRONMENT], Environment).content()
    except (KeyError, ConfigError):  # frozen without them, or with settings that are gone
        return [f"all of {ENVIRONMENT}"]
    present = environment.content()
    return sorted(name for name in {*frozen, *present} if frozen.get(name) != present.get(name))


def differences(version: int, played: Played, environment: Environment) -> list[str]:
    """Return what differs from a version, a line for each kind: what, where, and how it is restored.

    Args:
        version: Version of the benchmark.
        played: Digests of what is played.
        environment: Its settings.
    """
    lines = []
    if scenarios := changed_scenarios(version, played):
        lines.append(f"scenarios: {'; '.join(scenarios)}: restore their folders, or play the version's")
    for part in changed_code(version):
        lines.append(f"code of {part}: in {' and '.join(CODE[part])}: restore what is there")
    if settings := changed_settings(version, environment):
        frozen, present = versions()[version].get(ENVIRONMENT, {}), environment.content()
        named = [
            f"{name} is {shown(present[name], LONGEST)}, in the version {shown(frozen.get(name), LONGEST)}"
            if name in present
            else name
            for name in settings
        ]
        lines.append(f"settings: in environment: {'; '.join(named)}: set them back")
    return lines


def prescribed(version: int | None, algorithm: str, task: str, traffic: str) -> dict[str, Any]:
    """Return the budget and the sharing of parameters that a version prescribes for a training.

    Args:
        version: Version of the benchmark; without one nothing is prescribed.
        algorithm: Its name; one that is not in the version's table shares parameters as most of the table.
        task: Its name.
        traffic: Its name.
    """
    training = versions().get(version, {}).get(TRAINING) if version is not None else None
    if training is None:
        return {}
    sharing = training["sharing"]
    return {
        "budget": training["budget"].get(f"{task}/{traffic}"),
        "sharing": sharing.get(algorithm, sharing[ALL]),
    }


def settings_digest(settings: Mapping[str, Any]) -> str:
    """Return the digest of an algorithm's settings."""
    text = json.dumps(settings, sort_keys=True, default=str)
    return hashlib.blake2b(text.encode(), digest_size=8).hexdigest()


def has_settings_of(
    version: int | None, algorithm: str, task: str, traffic: str, settings: Mapping[str, Any]
) -> bool:
    """Return whether a training's settings are those of a version's table; False where these are not known.

    Args:
        version: Version of the benchmark.
        algorithm: Its name.
        task: Its name.
        traffic: Its name.
        settings: Settings of the algorithm, where they differ from its defaults.
    """
    frozen = versions().get(version, {}) if version is not None else {}
    wanted = frozen.get(TRAINING, {}).get(SETTINGS, {}).get(algorithm, {}).get(f"{task}/{traffic}")
    return wanted == settings_digest(settings)


def tuning(version: int | None) -> dict[str, Any]:
    """Return how a version's settings were searched; empty where that is not known.

    Args:
        version: Version of the benchmark.

    Returns:
        "results" of the sweep; and "algorithms": name -> number of "trials", and "agent_steps" of each.
    """
    frozen = versions().get(version, {}) if version is not None else {}
    return frozen.get(TRAINING, {}).get(TUNING, {})
