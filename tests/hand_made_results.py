"""Writes results folders with given outcomes, in the format of `smarts-bench run`."""

from __future__ import annotations

import importlib.util
from collections.abc import Sequence
from pathlib import Path

import pandas as pd
import yaml

from benchmark.experiment.runs import runs_of
from benchmark.metrics import METRICS, join_tables, write_table
from benchmark.report.against_paper import DEGENERATE
from benchmark.results.files import write_versioned
from benchmark.results.progress import COLUMNS as PROGRESS_COLUMNS
from benchmark.results.run_folder import FINISHED, RunFolder
from benchmark.scripted import SCRIPTED_POLICIES

SCRIPTS = Path(__file__).parents[1] / "results"
ALONE, SOCIAL = "no_social_vehicles", "random_social_vehicles"
OUTCOME_COLUMN = {"collision": "collisions", "goal": "goals"}
ENVIRONMENT = {"agents": 2, "decision_interval": 5, "observation": "benchmark"}
BUDGET = {"agent_steps": 1000, "minutes": None}

Outcomes = Sequence[Sequence[str]]
"""Outcomes by episode and agent; "invalid" makes the episode invalid."""


def agent_episodes(outcomes: Outcomes, *, split="train", variation="", starts_vary=True, **labels):
    """Return a table with a row for each agent-episode; columns of metrics other than outcomes are 0.

    Args:
        outcomes: Outcomes of the episodes.
        split: "train" or "held_out".
        variation: Name of the scenario's variation.
        starts_vary: Whether each episode has another start.
        labels: algorithm, training_seed, task, task_traffic, mode, and columns of metrics.
    """
    columns = sorted({name for metric in METRICS.values() for name in metric.columns})
    rows = []
    for number, ends in enumerate(outcomes):
        for agent, end in enumerate(ends):
            own = {
                OUTCOME_COLUMN.get(end, f"ended_{end}"): 1.0,
                f"{split}_agents": 1.0,
                f"{split}_goals": float(end == "goal"),
                f"{split}_collisions": float(end == "collision"),
            }
            rows.append(
                {
                    "split": split,
                    "scenario": labels.get("task", "intersection"),
                    "variation": variation,
                    "traffic": labels.get("task_traffic", ALONE),
                    **{"seed": 42, "world": 2_000_000 + number, "episode": 0},
                    **{"agent": f"agent_{agent}", "outcome": end, "is_invalid": end == "invalid"},
                    **{"start_x": float(number * starts_vary), "start_y": 0.0},
                    **{"start_heading": 0.0, "start_speed": float(agent), "agents": float(end != "invalid")},
                    **dict.fromkeys(columns, 0.0),
                    **{name: value for name, value in own.items() if name in columns},
                    **labels,
                }
            )
    table = pd.DataFrame(rows)
    invalid = sum("invalid" in ends for ends in outcomes)
    table.attrs["episodes"] = {
        **{"measured": len(outcomes) - invalid, "invalid": invalid, "incomplete": 0, "corrupted": {}}
    }
    return table


def write_experiment(root: Path, **keys) -> None:
    """Write command.json, by default of PPO at the intersection without social vehicles."""
    content = {
        **{"name": root.name, "description": "Made by hand.", "algorithms": ["ppo"]},
        **{"tasks": ["intersection"], "traffic": [ALONE], "seeds": [1]},
    }
    root.mkdir(parents=True, exist_ok=True)
    line = "smarts-bench run hand.yaml"
    write_versioned(
        root / "command.json", {"command": line, "parts": [{"command": line, "experiment": content | keys}]}
    )


def write_run(
    root: Path,
    algorithm: str,
    tables: Sequence[pd.DataFrame] | None,
    *,
    task="intersection",
    traffic=ALONE,
    seed=1,
    progress: Sequence[Sequence[object]] = (),
    environment=ENVIRONMENT,
    budget=BUDGET,
    settings=None,
    scenarios=None,
) -> Path:
    """Write a run's folder and return it.

    Args:
        root: The experiment's folder.
        algorithm: Name of the algorithm, or of a scripted policy if `seed` is -1.
        tables: Results of `agent_episodes`, to which the run's labels are added; None for a run in training.
        task: Name of the task.
        traffic: Name of the traffic variation.
        seed: The training seed.
        progress: Lines of progress.csv; by default the last line of a finished run.
        environment: Section of config.yaml.
        budget: Section of config.yaml.
        settings: Section of config.yaml.
        scenarios: Scenario name -> digest, for run.json.
    """
    cell = Path(task, traffic)
    folder = root / ("scripted" / Path(algorithm) / cell if seed < 0 else algorithm / cell / f"seed_{seed}")
    folder.mkdir(parents=True)
    facts = {
        **{"status": "training" if tables is None else "finished"},
        **{"commit": "0123456789ab", "python": "3.11.7", "versions": {"numpy": "2.0"}, "cores": 2},
        **{"processor": "abacus", "begun": "2026-01-01T00:00:00+0000", "ended": "2026-01-01T01:00:00+0000"},
        **{"test_seconds": 61.0},
    }
    if scenarios is not None:
        facts["scenarios"] = scenarios
    write_versioned(folder / "run.json", facts)
    config = {
        "algorithm": algorithm,
        "environment": environment,
        "budget": budget,
        "settings": settings or {},
    }
    if seed < 0:
        config = {"policy": algorithm}
    (folder / "config.yaml").write_text(yaml.safe_dump(config))
    if tables is not None and seed > 0 and not progress:
        progress = [[1, budget["agent_steps"], 10.0, 100, *[""] * 6]]
    if progress:
        lines = [PROGRESS_COLUMNS, *progress]
        text = "".join(",".join(map(str, line)) + "\n" for line in lines)
        (folder / "progress.csv").write_text(text)
    if tables is not None:
        labels = {"algorithm": algorithm, "training_seed": seed, "task": task, "task_traffic": traffic}
        table = join_tables(tables)
        counts = table.attrs
        table = table.assign(**labels)
        table.attrs = counts
        write_table(table, folder / "episodes.parquet")
    return folder


def write_test(root: Path, name: str, outcomes: Outcomes, **given) -> Path:
    """Write a run's folder with a greedy test, or the test of a scripted policy, and return it.

    Args:
        root: The experiment's folder.
        name: Of the algorithm or scripted policy.
        outcomes: By episode and agent.
        given: Of `write_run`; the table has its task and traffic.
    """
    is_scripted = name in SCRIPTED_POLICIES
    task, traffic = given.get("task", "intersection"), given.get("traffic", ALONE)
    mode = "scripted" if is_scripted else "greedy"
    table = agent_episodes(outcomes, mode=mode, task=task, task_traffic=traffic)
    return write_run(root, name, [table], **{"seed": -1 if is_scripted else 1} | given)


def write_degenerate(root: Path, *names: str, traffic=ALONE) -> None:
    """Write the tests of degenerate policies, all of whose agents collide."""
    for name in names or DEGENERATE:
        write_test(root, name, [["collision"]] * 200, traffic=traffic)


def finish_runs(experiment, root: Path, columns=None, **facts) -> RunFolder:
    """Leave results of all runs of an experiment as if they were finished, and return the last one's folder.

    Args:
        experiment: With greedy tests alone.
        root: The experiment's folder.
        columns: Further ones of the tables, with their values.
        facts: For run.json.
    """
    for run in runs_of(experiment):
        folder = RunFolder(root / run.folder)
        folder.open(run.content())
        folder.note(status=FINISHED, tested=run.task_setting.test_content(), **facts)
        labels = {"algorithm": run.label, "training_seed": run.seed, "task": run.task_setting.task.name}
        outcomes = [["goal", "goal"]] * experiment.evaluation.episodes
        table = agent_episodes(outcomes, mode="greedy", task_traffic=run.task_setting.traffic, **labels)
        write_table(table.assign(**columns or {}), folder.table)
    return folder


def pack(root: Path, out: Path) -> None:
    """Pack an experiment's runs by `results/pack.py`."""
    script("pack").pack(root, out)


def script(name: str, folder: Path = SCRIPTS):
    """Return a script as a module."""
    spec = importlib.util.spec_from_file_location(name, folder / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module
