"""How fast the page draws, in headless Chromium that draws by software: `python -m perf.page`.

Prints, for episodes of 60 s with so many vehicles at a time: bytes of the compact episode, seconds until the
first picture; then, while it plays from above and from the side, pictures a second, processor time of the
page's main thread for each, and the size of the canvas, which the page lowers where pictures come slowly. The
first line is a page that only clears a canvas of the full size: what the browser itself takes here.
"""

from __future__ import annotations

import argparse
import shutil
import tempfile
import time
from pathlib import Path

import numpy as np
from playwright.sync_api import Page, ViewportSize, sync_playwright

from smarts.roads.lane_graph import LaneGraph
from smarts.stream.container import framed
from smarts.stream.motion import Motion, steps_message
from smarts.stream.road_map import map_message, origin_of
from smarts.stream.tables import columns_message, episode_message
from tests.envision.pages import CHROMIUM, FLAGS, page_with
from tests.maps import Road, graph_of

STEPS = 600
CHUNK = 100
DT = 0.1
SIZE: ViewportSize = {"width": 1280, "height": 800}
EMPTY = """<body style="margin:0"><canvas width="956" height="692"></canvas><script>
const gl = document.querySelector("canvas").getContext("webgl2", {antialias: false, alpha: false});
let shade = 0;
(function draw() {
  gl.clearColor((shade = (shade + 0.01) % 1), 0, 0, 1);
  gl.clear(gl.COLOR_BUFFER_BIT);
  requestAnimationFrame(draw);
})();
</script>"""
CANVAS = """() => {
  const { width, height } = document.querySelector("canvas");
  return width + "x" + height;
}"""
COUNT = """seconds => new Promise(resolve => {
  let pictures = 0;
  const begin = performance.now();
  const count = now => {
    pictures++;
    if (now - begin < 1000 * seconds) requestAnimationFrame(count);
    else resolve(pictures / ((now - begin) / 1000));
  };
  requestAnimationFrame(count);
})"""


def town(streets: int = 8, length: float = 900.0) -> LaneGraph:
    """Return streets of two lanes each way, along x and along y."""
    roads = {}
    for i in range(streets):
        at = length * (i + 0.5) / streets
        for name, (begin, end) in {
            f"east{i}": ((0.0, at), (length, at)),
            f"west{i}": ((length, at + 6.4), (0.0, at + 6.4)),
            f"north{i}": ((at, 0.0), (at, length)),
            f"south{i}": ((at - 6.4, length), (at - 6.4, 0.0)),
        }.items():
            roads[name] = Road([begin, end], lanes=2)
    return graph_of(roads)


def episode_of(graph: LaneGraph, vehicles: int) -> bytes:
    """Return an episode in which vehicles drive to and fro along the lanes of a map."""
    rng = np.random.default_rng(0)
    lanes = np.flatnonzero(~graph.is_internal)
    origin = np.array(origin_of(graph))
    steps = np.arange(STEPS + 1)
    number, step, position, heading = [], [], [], []
    for vehicle in range(vehicles):
        line = graph.centreline(int(rng.choice(lanes)))
        along = np.concatenate(([0.0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))))
        s = np.abs((rng.uniform(0, along[-1]) + 10 * DT * steps) % (2 * along[-1]) - along[-1])
        number.append(np.full(len(steps), vehicle))
        step.append(steps)
        position.append(np.stack([np.interp(s, along, line[:, i]) for i in range(2)], -1) - origin)
        direction = line[-1] - line[0]
        heading.append(np.full(len(steps), np.arctan2(direction[1], direction[0])))
    rows = len(steps) * vehicles
    flags = np.ones(rows, np.uint16) | (rng.random(rows) < 0.1).astype(np.uint16) << 3
    motion = Motion.of(
        np.concatenate(number),
        np.concatenate(step),
        np.concatenate(position),
        np.concatenate(heading),
        np.full(rows, 10.0),
        np.zeros(rows),
        flags,
    )
    return b"".join(framed(_messages(graph, motion, vehicles)))


def _messages(graph: LaneGraph, motion: Motion, vehicles: int):
    x, y = origin_of(graph)
    yield episode_message({"scenario": f"{vehicles} vehicles", "dt": DT, "steps": STEPS}, (x, y))
    yield map_message(graph, "")
    count = np.arange(vehicles)
    yield columns_message(
        "vehicles",
        {
            "number": count.astype(np.uint32),
            "slot": count.astype(np.int32),
            "generation": np.ones(vehicles, np.int32),
            "name": [f"car-{i}" for i in count.tolist()],
            "kind": (count % 20 == 0).astype(np.uint8),
            "length": np.where(count % 20 == 0, 12.0, 4.5).astype(np.float32),
            "width": np.where(count % 20 == 0, 2.5, 1.8).astype(np.float32),
        },
    )
    for begin in range(0, STEPS + 1, CHUNK):
        chosen = (motion.step >= begin) & (motion.step < begin + CHUNK)
        steps = np.arange(begin, min(begin + CHUNK, STEPS + 1), dtype=np.int32)
        yield steps_message(steps, Motion._make(column[chosen] for column in motion))
    yield {"type": "end", "is_complete": True, "remark": ""}


def rate_of(page: Page, seconds: float) -> str:
    """Return pictures a second, milliseconds of the main thread for each, and the size of the canvas."""
    session = page.context.new_cdp_session(page)
    session.send("Performance.enable", {"timeDomain": "threadTicks"})

    def busy() -> float:
        metrics = session.send("Performance.getMetrics")["metrics"]
        return next(metric["value"] for metric in metrics if metric["name"] == "TaskDuration")

    before = busy()
    rate = float(page.evaluate(COUNT, seconds))
    each = 1000 * (busy() - before) / (rate * seconds)
    return f"{rate:8.0f} {each:8.1f} {page.evaluate(CANVAS):>9s}"


def measure(page: Page, file: Path, mode: str, seconds: float) -> tuple[float, str]:
    """Return seconds until the first picture, and what `rate_of` says of playing."""
    begin = time.perf_counter()
    page.goto(f"{file.as_uri()}#cam={mode}")
    page.wait_for_selector(".app[data-ready]")
    page.evaluate("() => new Promise(resolve => requestAnimationFrame(() => requestAnimationFrame(resolve)))")
    first = time.perf_counter() - begin
    page.wait_for_timeout(3000)
    return first, rate_of(page, seconds)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--vehicles", type=int, nargs="+", default=[25, 300, 1000])
    parser.add_argument("--seconds", type=float, default=4.0, help="for which pictures are counted")
    arguments = parser.parse_args()
    folder = Path(tempfile.mkdtemp())
    graph = town()
    print("vehicles   bytes  bytes/row  first [s]  mode  pictures/s  ms main    canvas")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=shutil.which(CHROMIUM), args=FLAGS)
        empty = browser.new_page(viewport=SIZE)
        empty.set_content(EMPTY)
        empty.wait_for_timeout(1000)
        print(f"{'empty':>8s} {'':7s} {'':10s} {'':10s} {'':>5s} {rate_of(empty, arguments.seconds)}")
        empty.close()
        for vehicles in arguments.vehicles:
            data = episode_of(graph, vehicles)
            file = folder / f"{vehicles}.html"
            file.write_text(page_with([data]))
            each = len(data) / (vehicles * (STEPS + 1))
            for mode in ("top", "free"):
                page = browser.new_page(viewport=SIZE)
                first, rate = measure(page, file, mode, arguments.seconds)
                print(f"{vehicles:8d} {len(data):7d} {each:10.2f} {first:10.2f} {mode:>5s} {rate}")
                page.close()
        browser.close()
    shutil.rmtree(folder)


if __name__ == "__main__":
    main()
