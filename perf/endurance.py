"""Whether training survives kills, stops, a lost worker and changed settings.

    python -m perf.endurance [--families ppo dqn ...] [--steps 50000] [--out FOLDER]

Trains an algorithm of each family at the intersection through `smarts-bench run`, beyond `--steps`
agent-steps. Then its driver gets SIGKILL, the same command gets SIGTERM, the next one loses its environment
runner, and trains on to the end of the budget. Prints the agent-steps at each interruption and after it.
Exits with 1 if a training lost more than what was made since its checkpoint, or did not end.
"""

from __future__ import annotations

import argparse
import csv
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

FAMILIES: Mapping[str, tuple[str, Mapping[str, Any]]] = {
    "on-policy": ("ppo", {}),
    "replay": ("maddpg", {}),
    "recurrent": ("ppo", {"gru": 32}),
    "sequence replay": ("qmix", {"gru": 32}),
    "networked": ("networked_q", {}),
}
"""Algorithm and settings by family."""
PATIENCE = 900.0
"""Longest time from one interruption to the next [s]."""
ROW = "{:<16} {:>17} {:>17} {:>17} {:>10} {:>7}  {}"
LOST = "ray::JointEnvRunner"
VALIDATIONS = 5
"""Number of validations, each of which saves a checkpoint."""
UPDATE = 64 * 8 * 4 * 5
"""Most agent-steps of one update: PPO's fragment, simulations, agents, simulation steps of a decision."""


@dataclass
class Training:
    """A command of `smarts-bench` that is given again and again, its run's folder and a log."""

    arguments: list[str]
    run: Path
    log: Path
    process: Any = None

    def start(self) -> None:
        """Start the command in a new session, so that its processes can be identified."""
        self.log.parent.mkdir(parents=True, exist_ok=True)
        with self.log.open("a") as log:
            line = [sys.executable, "-m", "benchmark.cli", *self.arguments]
            self.process = subprocess.Popen(line, stdout=log, stderr=log, start_new_session=True)

    def steps(self) -> int:
        """Return the agent-steps trained so far."""
        file = self.run / "progress.csv"
        lines = [*csv.DictReader(file.open())] if file.exists() else []
        return int(lines[-1]["agent_steps"] or 0) if lines else 0

    def saved(self) -> int:
        """Return the agent-steps of the checkpoint."""
        file = self.run / "checkpoint" / "training.json"
        return json.loads(file.read_text())["agent_steps"] if file.exists() else 0

    def wait(self, condition: Callable[[], bool]) -> None:
        """Wait until a condition holds.

        Raises:
            RuntimeError: The command ended before, or it took too long.
        """
        end = time.monotonic() + PATIENCE
        while not condition():
            if self.process.poll() is not None or time.monotonic() > end:
                raise RuntimeError(f"{self.arguments[:2]}: exit code {self.process.poll()}, see {self.log}")
            time.sleep(0.1)

    def interrupt(self, number: int) -> tuple[int, int]:
        """Send the driver a signal; return the agent-steps before and after it."""
        self.process.send_signal(number)
        self.process.wait(PATIENCE)
        end = time.monotonic() + 60
        while [*self.processes("")] and time.monotonic() < end:  # Ray's, which end a little later
            time.sleep(0.1)
        return self.steps(), self.saved()

    def processes(self, title: str) -> Iterator[int]:
        """Yield the processes of the command that have a title."""
        for folder in Path("/proc").glob("[0-9]*"):
            try:
                session = int((folder / "stat").read_text().rpartition(")")[2].split()[3])
                if session == self.process.pid and title in (folder / "cmdline").read_text():
                    yield int(folder.name)
            except OSError:  # it has just ended
                continue


def endure(name: str, steps: int, root: Path) -> tuple[str, bool]:
    """Train an algorithm through all interruptions; return its row of the table, and whether all is well."""
    training = _training(name, steps, root)
    training.start()
    training.wait(lambda: training.steps() > max(steps, training.saved()))
    killed = training.interrupt(signal.SIGKILL)
    training.start()
    training.wait(lambda: training.steps() > 1.15 * steps)
    stopped = training.interrupt(signal.SIGTERM)
    training.start()
    training.wait(lambda: training.steps() > 1.3 * steps)
    before = training.steps()
    for worker in training.processes(LOST):
        os.kill(worker, signal.SIGKILL)
    training.wait(lambda: training.steps() > before)
    after = training.steps()
    code = training.process.wait(PATIENCE)
    facts = json.loads((training.run / "run.json").read_text())
    is_kept = killed[0] - killed[1] <= 1.5 * steps / VALIDATIONS + UPDATE and stopped[0] == stopped[1]
    cells = [f"{one:,} > {two:,}" for one, two in (killed, stopped, (before, after))]
    ending = f"{facts['status']}, budget used: {facts.get('ended_by')}, exit code {code}"
    row = ROW.format(name, *cells, f"{training.steps():,}", len(facts["continued"]), ending)
    return row, is_kept and code == 0


def _training(name: str, steps: int, root: Path) -> Training:
    """Return the command of a family, whose experiment is written."""
    algorithm, settings = FAMILIES[name]
    file = root / f"{name.replace(' ', '_')}.yaml"
    content = {
        "algorithms": [algorithm],
        "tasks": ["intersection"],
        "traffic": ["no_social_vehicles"],
        "seeds": [1],
        "training": dict(settings),
        "budget": {"agent_steps": int(1.5 * steps)},
        "evaluation": {
            "episodes": 2,
            "modes": ["greedy"],
            "validations": VALIDATIONS,
            "validation_episodes": 2,
        },
        "resources": {"env_runners": 1, "parallel": 1},
    }
    file.write_text(json.dumps(content))  # JSON is YAML
    out = root / "results"
    out.mkdir(exist_ok=True)
    run = out / file.stem / algorithm / "intersection" / "no_social_vehicles" / "seed_1"
    return Training(["run", str(file), "--out", str(out)], run, out / "log.txt")


def main() -> int:
    """Do what is asked for; return the exit code."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--families", nargs="+", choices=[*FAMILIES], default=[*FAMILIES])
    parser.add_argument(
        "--steps", type=int, default=50_000, help="agent-steps before the first interruption; at least 50,000"
    )
    parser.add_argument("--out", type=Path, help="folder of all results; by default one that is removed")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="endurance-") as temporary:
        root = (given.out or Path(temporary)).absolute()
        root.mkdir(parents=True, exist_ok=True)
        print(ROW.format("", "SIGKILL", "SIGTERM", "lost worker", "end", "resumed", "status"), flush=True)
        all_well = True
        for name in given.families:
            row, is_well = endure(name, given.steps, root)
            print(row if is_well else f"{row}  FAILED", flush=True)
            all_well &= is_well
    return 0 if all_well else 1


if __name__ == "__main__":
    sys.exit(main())
