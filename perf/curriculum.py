"""Whether PPO learns the intersection among social vehicles better on a curriculum of traffic densities.

    python -m perf.curriculum [--seeds 1 2 3] [--agent-steps 2000000] [--csv FILE]
    python -m perf.curriculum --page

Trains PPO with the settings of `configs/benchmark_v1.yaml` twice for each seed: as in the table of version 1,
and on a curriculum: on empty roads first, then among a third and two thirds of the vehicles, and from
`FULL` of the budget on among all of them. Each stage continues from the state of the one before: weights,
optimisers, schedules. Each tenth of the budget, and at the end with more episodes, it is validated greedily
among all vehicles at 0.1 s, in worlds of which none is in the tests. Writes completion and collision to
results/curriculum.csv; trainings that it has in full are left out. Prints them as a Markdown table.
"""

from __future__ import annotations

import argparse
import csv
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from statistics import fmean
from typing import Any, NamedTuple, get_type_hints

from algorithms.joint.episode_indices import FIRST_VALIDATION_EPISODE
from algorithms.joint.evaluation import evaluate
from benchmark.experiment.config import EMPTY_ROADS, read_experiment
from benchmark.experiment.runs import Run, runs_of
from benchmark.running.cluster import start_ray
from benchmark.running.environments import environment
from benchmark.running.machine import machine
from benchmark.running.testing import EVALUATION_SEED
from benchmark.running.training import algorithm_of
from scenarios.benchmark import FROM_ALL_SIDES, farther, four_arms
from scenarios.drivers import ALL_KINDS, START_IN_TOWN
from scenarios.intersection_v1.scenario import DENSITY, LATER
from smarts.sstudio import gen_scenario
from smarts.sstudio import types as t

ROOT = Path(__file__).resolve().parents[1]
CONFIG, CSV = ROOT / "configs" / "benchmark_v1.yaml", ROOT / "results" / "curriculum.csv"
TASK, TRAFFIC = "intersection_v1", "random_social_vehicles"
SHARES = (0.0, 1 / 3, 2 / 3)
"""Of the vehicles, in the stages before the last."""
FULL = 0.45
"""Share of the budget at which the last stage begins; those before it are of one length."""
VALIDATIONS, EPISODES, LAST_EPISODES = 10, 40, 200


class Row(NamedTuple):
    """A validation of a training."""

    curriculum: int
    """1 with the curriculum, 0 without."""
    seed: int
    agent_steps: int
    mode: str
    episodes: int
    completion: float
    collision: float
    commit: str


class Stage(NamedTuple):
    """Part of a training."""

    run: Run
    """With what is driven in it."""
    end: float
    """Share of the budget at which it ends."""


def stages_of(run: Run, folder: Path) -> list[Stage]:
    """Return the curriculum of a run; scenarios with fewer vehicles are built in `folder`."""
    found = []
    for number, share in enumerate(SHARES, 1):
        setting = run.task_setting
        if share:
            place = _sparser(share, folder / f"share_{number}")
            setting = replace(setting, task=setting.task.model_copy(update={"scenarios": (str(place),)}))
        else:
            setting = replace(setting, traffic=EMPTY_ROADS)
        # Of version 1 are its own scenarios alone.
        setting = replace(setting, benchmark_version=None)
        found.append(Stage(replace(run, task_setting=setting), FULL * number / len(SHARES)))
    return [*found, Stage(run, 1.0)]


def _sparser(share: float, folder: Path) -> Path:
    """Build the scenario with a share of its vehicles; return its folder."""
    folder.mkdir()
    gen_scenario(
        t.Scenario(
            map_spec=t.MapSpec(source=str(ROOT / "scenarios" / "intersection")),
            traffic=four_arms(share * DENSITY, ALL_KINDS),
            ego_missions=farther(FROM_ALL_SIDES, starts=LATER),
            start_variation=START_IN_TOWN,
        ),
        output_dir=folder,
    )
    return folder


def train(stages: Sequence[Stage], whole: Run, has_curriculum: bool) -> Iterator[Row]:
    """Train through all stages, and yield the validations, all of them in `whole`."""
    budget, steps, due = whole.budget.agent_steps, 0, 1
    row = Row(int(has_curriculum), whole.seed, 0, "greedy", EPISODES, 0, 0, str(machine()["commit"]))
    with tempfile.TemporaryDirectory(prefix="smarts-bench-") as temporary:
        kept = Path(temporary, "checkpoint")
        for stage in stages:
            with algorithm_of(stage.run) as algo:
                if kept.exists():
                    algo.restore_from_path(str(kept))
                while steps < stage.end * budget:
                    decisions = algo.train()["env_runners"]["num_agent_steps_sampled_lifetime"]
                    steps = int(sum(decisions.values()) * whole.task_setting.environment.decision_interval)
                    row = row._replace(agent_steps=steps)
                    if steps >= due * budget / VALIDATIONS:
                        due += 1
                        yield _validated(row, algo, whole)
                if stage is stages[-1]:
                    for mode in ("greedy", "sampled"):
                        yield _validated(row._replace(mode=mode, episodes=LAST_EPISODES), algo, whole)
                algo.save_to_path(str(kept))


def _validated(row: Row, algo: Any, run: Run) -> Row:
    """Return a row with the rates of a policy among all vehicles, at 0.1 s."""
    with closing(environment(run.task_setting, discount=algo.config.gamma)) as env:
        played = evaluate(
            algo,
            row.episodes,
            explore=row.mode == "sampled",
            first_episode=FIRST_VALIDATION_EPISODE,
            env=env,
            seed=EVALUATION_SEED,
        )
    completion, collision = (
        round(fmean(each.metrics[name] for each in played), 4) for name in ("goal", "collision")
    )
    row = row._replace(completion=completion, collision=collision)
    print(row, flush=True)
    return row


def read(file: Path) -> list[Row]:
    """Return the rows of a table, none if there is none."""
    if not file.exists():
        return []
    kinds = get_type_hints(Row)
    with file.open(newline="") as opened:
        return [
            Row(**{name: kinds[name](text) for name, text in row.items()}) for row in csv.DictReader(opened)
        ]


def write(rows: Sequence[Row], file: Path) -> None:
    """Write the table."""
    with file.open("w", newline="") as opened:
        writer = csv.writer(opened, lineterminator="\n")
        writer.writerows([Row._fields, *rows])


def page(rows: Sequence[Row]) -> str:
    """Return a Markdown table: completion and collision in the course of each training."""
    trainings: dict[tuple[int, int], list[Row]] = {}
    for row in rows:
        trainings.setdefault((row.curriculum, row.seed), []).append(row)
    shown = range(1, VALIDATIONS, 2)
    points = [f"{(number + 1) / VALIDATIONS:.0%}" for number in shown]
    head = ["density", "seed", *points, "end, greedy", "end, sampled"]
    lines = ["| " + " | ".join(head) + " |", "|---" * len(head) + "|"]
    for (has_curriculum, seed), own in sorted(trainings.items()):
        course, end = own[:-2], own[-2:]  # a short training has fewer validations
        chosen = [*(course[number] if number < len(course) else None for number in shown), *end]
        cells = [f"{row.completion:.2f} / {row.collision:.2f}" if row else "" for row in chosen]
        name = "growing" if has_curriculum else "constant"
        lines.append("| " + " | ".join([name, str(seed), *cells]) + " |")
    return "\n".join(lines)


def main() -> None:
    """Train what is missing, and print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=int, nargs="+", default=[1, 2, 3])
    parser.add_argument("--agent-steps", type=int, help="of each training (default: that of version 1)")
    parser.add_argument("--csv", type=Path, default=CSV, help="table of the validations")
    parser.add_argument("--page", action="store_true", help="only print what the table has")
    given = parser.parse_args()
    if not given.page:
        overrides = ["algorithms=[ppo]", f"tasks=[{TASK}]", f"traffic=[{TRAFFIC}]", f"seeds={given.seeds}"]
        runs = [*runs_of(read_experiment(CONFIG, overrides))]
        if given.agent_steps:
            length = {"agent_steps": given.agent_steps}
            runs = [replace(run, budget=run.budget.model_copy(update=length)) for run in runs]
        start_ray(runs[0].resources)
        for has_curriculum in (True, False):
            for run in runs:
                rows = read(given.csv)
                if any((row.curriculum, row.seed) == (has_curriculum, run.seed) for row in rows):
                    continue
                with tempfile.TemporaryDirectory(prefix="smarts-bench-") as temporary:
                    stages = stages_of(run, Path(temporary)) if has_curriculum else [Stage(run, 1.0)]
                    write([*rows, *train(stages, run, has_curriculum)], given.csv)
    print(page(read(given.csv)))


if __name__ == "__main__":
    sys.exit(main())
