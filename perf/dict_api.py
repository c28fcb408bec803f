"""Time per step of `HiWayEnv` in two source trees, measured in turn.

    python perf/dict_api.py BASE NEW            # e.g. a worktree of an older commit, and this one
    python perf/dict_api.py BASE NEW --blocks 40 --steps 100

Four agents of type `LanerWithSpeed` drive on the scenario `loop` with a decision in every step. Each tree
runs in a process of its own, one block of steps at a time, in alternation, so that both see the same load of
the machine. Two figures for each tree: observations that are not read, and observations whose vehicle,
waypoints and events are read. Time is the processor time of the process; the ratio is the median over blocks
of NEW / BASE.
"""

from __future__ import annotations

import argparse
import statistics
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

AGENTS = 4


def serve() -> None:
    """Run blocks of steps as standard input asks for: "READ STEPS" -> seconds per step."""
    sys.path[0] = str(Path.cwd())
    from smarts.agents import AgentInterface, AgentType
    from smarts.env import HiWayEnv

    interface = AgentInterface.from_type(AgentType.LanerWithSpeed, max_episode_steps=None)
    env = HiWayEnv(["loop"], {f"agent-{n}": interface for n in range(AGENTS)}, decision_interval=1, seed=1)
    observations, _ = env.reset(seed=1)
    for line in sys.stdin:
        reads, steps = (int(word) for word in line.split())
        seconds = 0.0
        for _ in range(steps):
            begin = time.process_time()
            observations, _, ended, _, _ = env.step(dict.fromkeys(observations, (10.0, 0)))
            if reads:
                for seen in observations.values():
                    _read(seen)
            seconds += time.process_time() - begin
            if ended["__all__"]:
                observations, _ = env.reset()
        print(seconds / steps, flush=True)
    env.close()


def _read(seen: Any) -> float:
    """Read what a lane-following policy reads."""
    ego, paths = seen.ego_vehicle_state, seen.waypoint_paths
    return ego.speed + sum(point.lane_width for path in paths for point in path[:5]) + seen.events.off_road


class Worker:
    """A process that steps the environment of one tree.

    Args:
        tree: Root of the source tree.
    """

    def __init__(self, tree: Path) -> None:
        command = [sys.executable, str(Path(__file__).resolve()), "--serve"]
        self._process = subprocess.Popen(
            command, cwd=tree, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )

    def measure(self, reads: bool, steps: int) -> float:
        """Return the seconds per step of one block.

        Raises:
            RuntimeError: The process has ended.
        """
        process: Any = self._process
        print(int(reads), steps, file=process.stdin, flush=True)
        line = process.stdout.readline()
        if not line:
            raise RuntimeError(f"the worker ended with code {self._process.wait()}")
        return float(line)

    def close(self) -> None:
        """End the process."""
        if self._process.stdin is not None:
            self._process.stdin.close()
        self._process.wait()


def main() -> None:
    """Compare two trees, and print a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("trees", nargs=2, type=Path, metavar="TREE")
    parser.add_argument("--blocks", type=int, default=20)
    parser.add_argument("--steps", type=int, default=100)
    given = parser.parse_args()
    workers = [Worker(tree) for tree in given.trees]
    try:
        for reads in (False, True):
            for worker in workers:
                worker.measure(reads, given.steps)
            pairs = [[worker.measure(reads, given.steps) for worker in workers] for _ in range(given.blocks)]
            base, new = (1e3 * statistics.median(times) for times in zip(*pairs, strict=True))
            ratio = statistics.median(after / before for before, after in pairs)
            what = "observations read" if reads else "observations not read"
            print(f"{what:24} base {base:.3f} ms, new {new:.3f} ms a step, ratio {ratio:.3f}")
    finally:
        for worker in workers:
            worker.close()


if __name__ == "__main__":
    if "--serve" in sys.argv:
        serve()
    else:
        main()
