"""A film of traffic without agents under SUMO, on the left, and under Native, at twice its speed.

python perf/native_film.py docs/native.gif [--scenario intersection_v1] [--seconds 30]
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

import numpy as np
import PIL.Image

from smarts.envision.animation import write_moving
from smarts.envision.world_picture import WorldPicture
from smarts.roads.agent_routes import AgentRoutes
from smarts.roads.atlas import RoadAtlas
from smarts.roads.scene import Scene
from smarts.sim.traffic_run import traffic_run
from smarts.sstudio.build import build_scenario

ENGINES = ("SUMO", "Native")
FILMED, SPEED, GAP, GREY = 4, 2.0, 12, 90
"""Steps of 0.1 s between pictures; speed of the film; width [pixels] and shade of what parts the engines."""


def images(scenario: str, seconds: float) -> Iterator[np.ndarray]:
    """Yield the pictures of the film."""
    built = build_scenario(scenario)
    atlas = RoadAtlas([built.roads()])
    with ExitStack() as runs:
        both = [
            runs.enter_context(traffic_run(built, "random_social_vehicles", seed=1, engine=engine))
            for engine in ENGINES
        ]
        pictures = [WorldPicture(Scene(run.world, atlas, AgentRoutes(atlas, 1, 0))) for run in both]
        starts = [replace(run.start, scenario=engine) for run, engine in zip(both, ENGINES, strict=True)]
        for step, _ in enumerate(zip(*(run.steps(seconds) for run in both), strict=True)):
            if step % FILMED == 0:
                shown = [each.image(0, start) for each, start in zip(pictures, starts, strict=True)]
                shown.insert(1, np.full((len(shown[0]), GAP, 3), GREY, np.uint8))
                yield np.asarray(PIL.Image.fromarray(np.concatenate(shown, axis=1)).reduce(2))


def main() -> None:
    """Write the film."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("out", type=Path, help=".gif or .mp4")
    parser.add_argument("--scenario", default="intersection_v1")
    parser.add_argument("--seconds", type=float, default=30.0)
    options = parser.parse_args()
    frames = write_moving(images(options.scenario, options.seconds), options.out, FILMED * 0.1 / SPEED)
    print(f"{options.out}: {frames} frames, {options.out.stat().st_size / 1e6:.2f} MB")


if __name__ == "__main__":
    main()
