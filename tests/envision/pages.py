"""Pages with compact episodes inside, and episodes that differ from recorded ones."""

import base64
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from smarts.stream.arrays import packed_array, unpacked_array
from smarts.stream.container import framed, messages_in
from smarts.stream.motion import motion_of

CHROMIUM = "chromium"
FLAGS = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
ROOT = Path(__file__).resolve().parents[2]
VIEWER = ROOT / "smarts/envision/viewer.html"
FIXTURES = ROOT / "tests/data/envision"
PLACE = "<!--EPISODE-->"


def episode(name: str) -> bytes:
    """Return a compact episode of tests/data."""
    return (FIXTURES / f"{name}.smarts").read_bytes()


def page_with(episodes: Sequence[bytes]) -> str:
    """Return the built page with episodes inside; their ids are 0, 1, ..."""
    scripts = "".join(
        f'<script type="application/octet-stream" data-id="{i}" data-label="episode {i}">'
        f"{base64.b64encode(data).decode()}</script>"
        for i, data in enumerate(episodes)
    )
    return VIEWER.read_text().replace(PLACE, scripts)


def observing(data: bytes) -> bytes:
    """Return a compact episode in which its first agent observes: paths, a neighbour, a lidar, two grids."""
    messages = list(messages_in(data))
    motions = [motion_of(message) for message in messages if message["type"] == "steps"]
    number = _first_vehicle(messages)
    rows = []
    for motion in motions:
        at = np.flatnonzero(motion.number == number)
        for step, x, y, heading in zip(
            motion.step[at].tolist(),
            *(motion.x[at] / 100, motion.y[at] / 100, np.deg2rad(motion.heading[at] / 10)),
            strict=True,
        ):
            rows += [(step, name, values) for name, values in _observation(x, y, heading).items()]
    values = [np.asarray(each, np.float32) for *_, each in rows]
    offsets = np.cumsum([0, *map(len, values)]).astype(np.uint32)
    table = {
        "type": "table",
        "name": "observations",
        "append": True,
        "columns": {
            "step": packed_array(np.array([step for step, *_ in rows], np.int32)),
            "agent": packed_array(np.zeros(len(rows), np.int32)),
            "name": [name for _, name, _ in rows],
            "values": {**packed_array(np.concatenate(values)), "o": packed_array(offsets)},
        },
    }
    end = next(i for i, message in enumerate(messages) if message["type"] == "steps")
    return b"".join(framed([*messages[:end], table, *messages[end:]]))


def _first_vehicle(messages: list[dict[str, Any]]) -> int:
    """Return the number of the vehicle that the first agent has."""
    states = next(message["columns"] for message in messages if message.get("name") == "agent_states")
    agents, slots = (unpacked_array(states[name]) for name in ("agent", "slot"))
    vehicles = next(message for message in messages if message["type"] == "vehicles")
    number, slot = (unpacked_array(vehicles[name]) for name in ("number", "slot"))
    return int(number[slot == slots[agents == 0][0]][0])


def _observation(x: float, y: float, heading: float) -> dict[str, list[float]]:
    """Return what a vehicle at a place observes."""
    ahead, left = np.array([np.cos(heading), np.sin(heading)]), np.array([-np.sin(heading), np.cos(heading)])
    place = np.array([x, y])

    def line(aside: float) -> list[float]:
        return [float(v) for s in range(2, 24, 2) for v in place + s * ahead + aside * left]

    angles = np.linspace(0, 2 * np.pi, 60, endpoint=False)
    lidar = place + 14 * np.stack([np.cos(angles), np.sin(angles)], -1)
    # The upper left quarter is full.
    cells = np.zeros((32, 32))
    cells[:16, :16] = 1
    beside = place + 6 * ahead + 4 * left
    return {
        "waypoints": [*line(0), np.nan, np.nan, *line(3.2)],
        "neighbors": [*beside.tolist(), heading, 4.5, 1.8, 7.0],
        "lidar": lidar.ravel().tolist(),
        "grid:occupancy": [32, 32, 1.0, *cells.ravel().tolist()],
        "rgb:top_down": [2, 2, 8.0, *np.eye(3).ravel().tolist(), 1, 1, 1],
        "speed": [7.25],
    }


def changed(data: bytes, change: Callable[[dict[str, Any]], None]) -> bytes:
    """Return a compact episode, each of its messages changed in place."""
    messages = list(messages_in(data))
    for message in messages:
        change(message)
    return b"".join(framed(messages))
