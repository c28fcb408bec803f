"""How much memory a process that plays many short episodes holds.

    python -m perf.memory --episodes 2000
    python -m perf.memory --episodes 2000 --record

Prints the resident set every 200 episodes. The remaining leak is SUMO 1.28's: at every load it loses the name
of each file some ten times (`XMLSubSys::transcodeToLocal`), and adds its examples of calls to a list that is
never emptied (`OptionsCont::addCallExample`).
"""

from __future__ import annotations

import argparse
import ctypes
import gc
import os
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from smarts.agents.benchmark import benchmark_interface
from smarts.env import VectorHiWayEnv
from smarts.sim.assembly import Options
from smarts.types.agent_states import agent_names

EARLY = 200
"""Episodes after which everything has been used once."""


def resident() -> int:
    """Return what this process holds, garbage and unused pages taken away [byte]."""
    gc.collect()
    ctypes.CDLL(None).malloc_trim(0)
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE")


@contextmanager
def _folder(wanted: bool) -> Iterator[Path | None]:
    if not wanted:
        yield None
        return
    with tempfile.TemporaryDirectory() as folder:
        yield Path(folder)


def measure(options: argparse.Namespace) -> None:
    """Play episodes and print the memory on the way."""
    interface = benchmark_interface().replace(max_episode_steps=options.steps)
    agents = dict.fromkeys(agent_names(4), interface)
    begin = time.perf_counter()
    with _folder(options.record) as record:
        env = VectorHiWayEnv(1, options.scenarios, agents, simulation=Options(record=record))
        env.reset(42)
        early, episodes = resident(), 0
        while episodes < options.episodes:
            over = env.step([np.zeros((1, 4), int)]).reset[0]
            episodes += int(over)
            if over and episodes % EARLY == 0:
                now, seconds = resident(), time.perf_counter() - begin
                early = now if episodes == EARLY else early
                more = 100 * (now / early - 1)
                print(
                    f"{episodes:5} episodes, {seconds:5.0f} s: {now / 1e6:7.2f} MB ({more:+.2f}%)", flush=True
                )
        env.close()


def main() -> None:
    """Measure what the command line asks for."""
    parser = argparse.ArgumentParser(description="Memory after many short episodes.")
    parser.add_argument("--scenarios", nargs="+", default=["intersection", "double_merge"])
    parser.add_argument("--episodes", type=int, default=2000)
    parser.add_argument("--steps", type=int, default=20, help="most steps of an episode")
    parser.add_argument("--record", action="store_true", help="record into a folder that is then removed")
    measure(parser.parse_args())


if __name__ == "__main__":
    main()
