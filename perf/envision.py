"""What live viewing costs a simulation, and what it sends.

    python -m perf.envision                       # 4 agents and 25 vehicles, one viewer
    python -m perf.envision --worlds 8 --social 300 --scenario city --stalled --seconds 600

Two environments with the same episodes take turns: one is shown by a server, the other is not. The server is
a process of its own, and so are its viewers: one that decodes all it gets, and with `--stalled` one more,
which stops reading. A decision takes five steps. The loss is measured in processor time of the simulation's
process, its sending thread included, and by the wall; where there are fewer cores than processes, the wall
says less. The memory of the server is printed for each tenth of the time.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import socket
import tempfile
import time
from collections.abc import Sequence
from multiprocessing.synchronize import Event
from pathlib import Path
from typing import Any

import numpy as np

from perf.scenes import scene
from smarts.arrays import Floats

BLOCK = 0.25
"""Time of one environment, then of the other [s]: long, since the first frame of a block is always due."""
PERIOD = 5
PAGE = "<html><head></head><body><!--EPISODE--></body></html>"


def serve(port: Any) -> None:
    """Run a server; tell its port."""
    from smarts.envision.server import ViewServer

    os.nice(10)
    server = ViewServer(None, live=True, port=0, page=PAGE)
    port.send(server.port)
    server.run()


def view(port: int, is_stalled: bool, received: Any, stop: Event) -> None:
    """Watch all simulations; count what comes, or stop reading."""
    from websockets.sync.client import connect

    from smarts.stream.arrays import unpacked_array
    from smarts.stream.container import unpack

    os.nice(10)
    uri, origin = f"ws://127.0.0.1:{port}/live", f"http://127.0.0.1:{port}"
    with connect(uri, origin=origin, max_size=None, max_queue=1, ping_interval=None) as server:  # pyright: ignore[reportArgumentType]
        watched: list[str] = []
        while not stop.is_set():
            if is_stalled and watched:
                time.sleep(0.1)
                continue
            try:
                packed = server.recv(timeout=1.0)
            except TimeoutError:
                continue
            assert isinstance(packed, bytes)
            message = unpack(packed)
            if message["type"] == "sources":
                found = [row["id"] for row in message["sources"]][:9]
                if found != watched:
                    watched = found
                    server.send(json.dumps({"watch": watched}))
            elif message["type"] == "steps":
                rows = len(unpacked_array(message["flags"]))
                with received.get_lock():
                    received[0] += 1
                    received[1] += rows
                    received[2] = _bytes_received(server.socket)


def _bytes_received(connection: socket.socket) -> int:
    """Return how many bytes have come: `tcpi_bytes_received` of Linux."""
    info = connection.getsockopt(socket.IPPROTO_TCP, socket.TCP_INFO, 256)
    return int.from_bytes(info[128:136], "little")


def resident(pid: int) -> float:
    """Return the memory of a process [MB]."""
    pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def measure(options: argparse.Namespace, port: int, server: int) -> float:
    """Let the environments take turns, print what was found; return the processor time of viewing [s]."""
    from smarts.env.vector import VectorHiWayEnv
    from smarts.sim.assembly import Options

    with tempfile.TemporaryDirectory() as folder:
        source = scene(options.scenario, options.social, options.agents, Path(folder))
        envs = [
            VectorHiWayEnv(
                options.worlds,
                [source],
                options.agents,
                decision_interval=PERIOD,
                simulation=Options(envision=address),
            )
            for address in ("", f"127.0.0.1:{port}")
        ]
        actions = [np.zeros((options.worlds, options.agents), np.int64)]
        for env in envs:
            env.reset()
            advance(env, actions, 20)
        decisions = max(1, round(20 * BLOCK / advance(envs[0], actions, 20)[1]))
        advance(envs[1], actions, 20)
        spent: list[list[tuple[float, float]]] = [[], []]
        begin, memory = time.monotonic(), []
        while time.monotonic() < begin + options.seconds:
            # Which one comes first changes, lest what else the machine does falls on one of them.
            for number in (0, 1) if len(memory) % 2 else (1, 0):
                spent[number].append(advance(envs[number], actions, decisions))
            memory.append((time.monotonic() - begin, resident(server)))
        vehicles = float(envs[1]._runner.world.vehicles.alive.sum(axis=1).mean())
        for env in envs:
            env.close()
    off, on = (np.array(each) for each in spent)
    report(off, on, decisions * PERIOD * options.worlds)
    print(f"vehicles {vehicles:.0f} in each of {options.worlds}; {len(on)} pairs of {decisions} decisions")
    print_memory(memory)
    return float((on - off)[:, 0].sum())


def advance(env: Any, actions: Any, decisions: int) -> tuple[float, float]:
    """Make some decisions; return the time of the processor and of the wall that they took [s]."""
    used, begin = time.process_time(), time.perf_counter()
    for _ in range(decisions):
        env.step(actions)
    return time.process_time() - used, time.perf_counter() - begin


def report(off: Floats, on: Floats, steps: int) -> None:
    """Print the rates of all blocks (N, 2), and the loss: the median of the pairs' and its 95% interval.

    Args:
        off: Time of the processor and of the wall of each block that is not shown [s].
        on: Of those that are shown.
        steps: Of one block, of all simulations together.
    """
    draws = np.random.default_rng(0).integers(0, len(on), (2000, len(on)))
    for place, what in enumerate(("processor", "wall")):
        more = 100 * (on[:, place] / off[:, place] - 1)
        low, high = np.percentile(np.median(more[draws], axis=1), (2.5, 97.5))
        rates = [steps / np.median(each[:, place]) for each in (off, on)]
        print(
            f"{what}: {rates[0]:.0f} steps/s, shown {rates[1]:.0f}: "
            f"{np.median(more):+.1f}% time ({low:+.1f} to {high:+.1f})"
        )


def print_memory(memory: Sequence[tuple[float, float]]) -> None:
    """Print the server's memory: rows of time [s] and memory [MB], ten times."""
    for part in np.array_split(np.array(memory), min(10, len(memory))):
        print(f"server's memory at {part[-1, 0]:4.0f} s: {part[:, 1].mean():.1f} MB")


def main() -> None:
    """Measure."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--scenario", default="loop")
    parser.add_argument("--social", type=int, default=25)
    parser.add_argument("--agents", type=int, default=4)
    parser.add_argument("--worlds", type=int, default=1)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--stalled", action="store_true", help="a second viewer, which stops reading")
    options = parser.parse_args()
    spawn = multiprocessing.get_context("spawn")
    here, there = spawn.Pipe()
    server = spawn.Process(target=serve, args=(there,), daemon=True)
    server.start()
    port = here.recv()
    stop, received = spawn.Event(), spawn.Array("q", 3)
    viewers = [
        spawn.Process(target=view, args=(port, is_stalled, received, stop), daemon=True)
        for is_stalled in ((False, True) if options.stalled else (False,))
    ]
    for viewer in viewers:
        viewer.start()
    assert server.pid is not None
    extra = measure(options, port, server.pid)
    stop.set()
    for viewer in viewers:
        viewer.join(5)
    messages, rows, size = received[:]
    print(f"one viewer got {messages} frames, {size / max(rows, 1):.1f} bytes a vehicle and step")
    each = extra / max(messages, 1)
    print(
        f"the simulation spends {1e6 * each:.0f} us on a frame: {6000 * each:.1f}% of a core at 60 a second"
    )
    server.terminate()


if __name__ == "__main__":
    main()
