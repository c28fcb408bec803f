"""What live viewing costs a simulation, and what it sends.

    python -m perf.envision                       # 4 agents and 25 vehicles, one viewer
    python -m perf.envision --worlds 8 --social 300 --scenario city --seconds 60

Two environments with the same episodes take turns: one is shown by a server, the other is not. The server is
a process of its own, and so are its viewers: one that decodes all it gets, and one that stops reading. A
decision takes five steps. The loss is measured in processor time of the simulation's process, its sending
thread included, and by the wall; where there are fewer cores than processes, the wall says less. The
memory of the server is printed for each tenth of the time.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import socket
import tempfile
import time
from multiprocessing.synchronize import Event
from pathlib import Path
from typing import Any

import numpy as np

from perf.scenes import scene

BLOCK = 10
"""Decisions of one environment, then of the other."""
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

    from smarts.stream.container import unpack
    from smarts.stream.motion import motion_of

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
                rows = len(motion_of(message).x)
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
        shown, hidden = (
            VectorHiWayEnv(
                options.worlds,
                [source],
                options.agents,
                decision_interval=PERIOD,
                simulation=Options(envision=address),
            )
            for address in (f"127.0.0.1:{port}", "")
        )
        actions = [np.zeros((options.worlds, options.agents), np.int64)]
        spent = {True: [], False: []}
        memory = []
        for env in (shown, hidden):
            env.reset()
            for _ in range(2 * BLOCK):
                env.step(actions)
        end = time.monotonic() + options.seconds
        while time.monotonic() < end:
            for is_shown, env in ((True, shown), (False, hidden)):
                used, begin = time.process_time(), time.perf_counter()
                for _ in range(BLOCK):
                    env.step(actions)
                spent[is_shown].append((time.process_time() - used, time.perf_counter() - begin))
            memory.append(resident(server))
        vehicles = float(shown._runner.world.vehicles.alive.sum(axis=1).mean())
        shown.close()
        hidden.close()
    steps = BLOCK * PERIOD * options.worlds
    for place, what in enumerate(("processor", "wall")):
        on, off = (np.median([each[place] for each in spent[is_shown]]) for is_shown in (True, False))
        print(f"{what}: {steps / off:.0f} steps/s, shown {steps / on:.0f}: {100 * (on / off - 1):+.1f}% time")
    tenths = np.array_split(np.array(memory), min(10, len(memory)))
    seconds = {is_shown: sum(used for used, _ in each) for is_shown, each in spent.items()}
    print(f"vehicles {vehicles:.0f}; server's memory [MB]:", *(f"{part.mean():.0f}" for part in tenths))
    return seconds[True] - seconds[False]


def main() -> None:
    """Measure."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--scenario", default="loop")
    parser.add_argument("--social", type=int, default=25)
    parser.add_argument("--agents", type=int, default=4)
    parser.add_argument("--worlds", type=int, default=1)
    parser.add_argument("--seconds", type=float, default=30.0)
    options = parser.parse_args()
    spawn = multiprocessing.get_context("spawn")
    here, there = spawn.Pipe()
    server = spawn.Process(target=serve, args=(there,), daemon=True)
    server.start()
    port = here.recv()
    stop, received = spawn.Event(), spawn.Array("q", 3)
    viewers = [
        spawn.Process(target=view, args=(port, is_stalled, received, stop), daemon=True)
        for is_stalled in (False, True)
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
