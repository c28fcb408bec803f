"""An agent that brakes hard in the place of each recorded vehicle: its collisions, and those of an oracle.

    python -m perf.recorded_brakes FOLDER

FOLDER is what `smarts-bench data import` wrote. The oracle of mode "log" is where the boxes of the agent's
poses and of the recording's samples, interpolated by NumPy, overlap at a step; vehicles that would enter
onto the agent do not count, as they wait. For collisions in mode "reactive" the script prints how hard each
driver behind has to brake from the begin on to stop behind the agent.
"""

from __future__ import annotations

import argparse
from contextlib import closing

import numpy as np

from benchmark.experiment.models import Evaluation, TrainingTask
from benchmark.experiment.runs import TaskSetting
from benchmark.metrics.realism import Features
from benchmark.running.environments import environment
from benchmark.running.evaluating import AgentDriver, batch_agent, environment_of
from benchmark.running.realism import ENVS, Poses, in_place_of
from benchmark.running.recorded_windows import INSTANTS, Window, windows_of
from smarts.config import fitted
from smarts.geometry.boxes import boxes_overlap
from smarts.recordings.log import Log
from smarts.sstudio.build import build_scenario
from smarts.types.episode import EpisodeStart
from smarts.types.recorded import MODES

AGENT = "smarts.zoo:non-interactive-v0"


def braked(folder: str, mode: str) -> tuple[list[tuple[Window, int]], np.ndarray, np.ndarray, Features]:
    """Return scenes, the agent's poses in them, shape (C, T, 4), and whether it collided, shape (C,)."""
    built = build_scenario(folder)
    found = [(name, files.recording) for name, files in built.traffic.items() if files.recording]
    traffic, recording = found[0]
    log, roads = Log.load(recording.log), built.roads()
    scenes = [(window, column) for window in windows_of(log, recording.begin) for column in window.scenes]
    agent, interface = batch_agent(AGENT, speed=0.0)
    task = fitted({"name": "brakes", "scenarios": [folder]}, TrainingTask, folder)
    driven = environment_of(agent, interface, 1, None, folder)
    setting = TaskSetting(task, traffic, driven, Evaluation(), ENVS)
    env = environment(setting, observation=agent.observation, max_episode_steps=INSTANTS - 1)

    def scene(start: EpisodeStart) -> tuple[Window, int]:
        return scenes[start.world % len(scenes)]

    poses, driver = Poses(env, len(scenes), scene, log), AgentDriver(agent, env)
    env.listen(poses)
    env.change_starts(lambda start: in_place_of(start, *scene(start), log, roads, mode))
    hits = np.zeros(len(scenes), bool)
    with closing(env):
        now, begun = env.reset(1, np.arange(ENVS), stride=ENVS), np.ones(ENVS, bool)
        while ((worlds := env.worlds) < len(scenes)).any():
            now = env.step(driver.act(now, begun))
            begun = now.reset.copy()
            for row, shares in now.metrics.items():
                if worlds[row] < len(scenes):
                    hits[worlds[row]] = shares["collision"] > 0
    return scenes, poses.pose, hits, Features(roads)


def found_by_oracle(window: Window, column: int, pose: np.ndarray) -> bool:
    """Return whether an agent's poses, shape (T, 4), overlap a recorded vehicle that has not just entered."""
    others = np.delete(window.pose, column, axis=1)
    sizes = window.size[column], np.delete(window.size, column, axis=0)
    own = pose[:, None, :2], pose[:, None, 2], sizes[0]
    overlaps = boxes_overlap(*own, others[..., :2], others[..., 2], sizes[1])
    first = overlaps.argmax(axis=0)
    was_there = ~np.isnan(others[np.maximum(first - 1, 0), np.arange(len(sizes[1])), 0])
    return bool((overlaps.any(axis=0) & was_there).any())


def needed_behind(window: Window, column: int, pose: np.ndarray, features: Features) -> list[float]:
    """Return how hard drivers behind an agent have to brake from the begin on to stop behind it [m/s^2]."""
    there = features.motion(window.pose[None], window.size)
    way = float(np.nansum(np.linalg.norm(np.diff(pose[:, :2], axis=0), axis=1)))
    needed = []
    for other in range(len(window.size)):
        gap = float(features.measure(there.of(other), there.of([column]))["leader_gap"][0, 0])
        if other != column and np.isfinite(gap):
            needed.append(float(window.pose[0, other, 3]) ** 2 / 2 / (gap + way))
    return needed


def main() -> None:
    """Play all scenes in both modes, and print the counts."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder")
    folder = parser.parse_args().folder
    for mode in MODES:
        scenes, poses, hits, features = braked(folder, mode)
        oracle = np.array([found_by_oracle(*scene, pose) for scene, pose in zip(scenes, poses, strict=True)])
        print(
            f"{mode}: {len(hits)} scenes, {hits.sum()} collisions; by an oracle {oracle.sum()} with the log"
        )
        if mode == "log":
            print(f"they differ in {(hits != oracle).sum()}")
        for number in np.flatnonzero(hits) if mode == "reactive" else ():
            needed = needed_behind(*scenes[number], poses[number], features)
            print(f"drivers behind the agent of a collision have to brake with {np.round(needed, 1)} m/s^2")


if __name__ == "__main__":
    main()
