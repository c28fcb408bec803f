"""Measures how realistic drivers are: policies in the place of recorded vehicles, traffic engines, floors.

Axis letters: R rollouts, T instants, K vehicles.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from benchmark.experiment.environment import Environment
from benchmark.experiment.models import Evaluation, TrainingTask
from benchmark.experiment.runs import TaskSetting
from benchmark.metrics.realism import Features, collides, log_likelihoods, realism
from benchmark.results.run_folder import RunFolder
from benchmark.running import recorded_windows
from benchmark.running.environments import environment
from benchmark.running.evaluating import AgentDriver, batch_agent, environment_of
from benchmark.running.playing_together import Driver, TrainedDriver, play_together
from benchmark.running.policy import Policy, read_run
from benchmark.running.recorded_windows import INSTANTS, Window, play_engine, windows_of
from benchmark.running.testing import EVALUATION_SEED
from smarts.agents.criteria import DoneCriteria
from smarts.arrays import Bools, Floats
from smarts.config import fitted
from smarts.env.vector import VectorHiWayEnv
from smarts.errors import SmartsError
from smarts.geometry.frames import wrap_angle
from smarts.recordings.log import Log, lanes_onward
from smarts.recordings.matching import lanes_of
from smarts.roads.lane_graph import LaneGraph
from smarts.sim.hold_missions import find_way
from smarts.sstudio.build import build_scenario
from smarts.types.episode import EpisodeStart
from smarts.types.frame import Frame
from smarts.types.mission import AgentMission
from smarts.types.vehicles import VehicleKind

ENVS = 32
"""Simulations side by side."""
Played = tuple[Callable[[int], Floats], Floats]
"""What happens in a window: the poses of the driver in the place of a column, (R, T, 4), and of all vehicles,
(R, T, K, 4), in one rollout where all are alike; see `Window.pose`."""


def measure_realism(
    scenario: str,
    *,
    traffic: str | None = None,
    policies: Sequence[str] = (),
    engines: Sequence[str] = ("SUMO",),
    rollouts: int = 32,
) -> Iterator[dict[str, Any]]:
    """Yield what each driver scores against a recording by name, as in `realism`, the recording itself first.

    The mean distance to the recorded pose is called `displacement`; `collisions` is the share of rollouts in
    which the vehicle overlaps another one.

    Args:
        scenario: The scenario, perhaps with a variation.
        traffic: Variation of its traffic, by default the last that is recorded.
        policies: Folders of runs, which act as sampled, and agents of the zoo.
        engines: Traffic engines, each of which drives all vehicles from a window's begin on.
        rollouts: How often everything is played that may differ.

    Raises:
        SmartsError: The scenario has no recorded traffic, or there is no such driver.
    """
    built = build_scenario(scenario)
    recorded = [each for each, files in built.traffic.items() if files.recording]
    traffic = traffic or next(reversed(recorded), None)
    if (recording := built.traffic_files(traffic).recording) is None or traffic is None:
        remedy = "give a scenario that `smarts-bench data import` wrote"
        raise SmartsError("it has no recorded traffic", place=scenario, remedy=remedy)
    roads, features = built.roads(), Features(built.roads())
    log = Log.load(recording.log)
    windows = [*windows_of(log, recording.begin)]
    if not windows:
        problem = "no vehicle of its recorded traffic is there for 5 s"
        raise SmartsError(problem, place=scenario, remedy="give a longer recording")

    def alone(drive: Callable[[Log, Window, int, LaneGraph], Floats]) -> Iterator[Played]:
        return ((lambda column, w=w: drive(log, w, column, roads), w.pose[None]) for w in windows)

    def together(engine: str) -> Iterator[Played]:
        for pose in play_engine(engine, log, windows, roads, built.net_file, rollouts):
            yield lambda column, pose=pose: pose[:, :, column], pose

    drivers = {
        "log": alone(lambda _, window, column, __: window.pose[None, :, column]),
        "constant speed": alone(recorded_windows.constant_speed),
        "constant speed with noise": alone(partial(recorded_windows.noisy_speed, rollouts=rollouts)),
        "IDM on the path": alone(recorded_windows.idm),
        **{engine: together(engine) for engine in engines},
        **{
            policy: _played_by(policy, scenario, traffic, log, windows, roads, rollouts)
            for policy in policies
        },
    }
    for name, played in drivers.items():
        yield {"driver": name, "traffic": traffic} | _score(features, windows, played)


def _score(features: Features, windows: Sequence[Window], played: Iterator[Played]) -> dict[str, Any]:
    """Return what a driver scores; scenes into which it could not be put are left out."""
    likelihoods, apart, collisions = [], [], []
    for window, (driven, pose) in zip(windows, played, strict=True):
        logged = features.motion(window.pose[None], window.size)
        everyone = features.motion(pose, window.size)
        for column in window.scenes:
            own = features.motion(driven(column), window.size[column])
            if np.isnan(own.pose[:, 0]).any():
                continue
            log, others = logged.of(column), everyone.without(column)
            measured = features.measure(log, logged.without(column)), features.measure(own, others)
            likelihoods.append(log_likelihoods(*measured))
            apart.append(np.nanmean(np.linalg.norm((own.pose - log.pose)[:, 1:, :2], axis=-1)))
            collisions.append(collides(own, others).mean())
    means = {"displacement": np.mean(apart), "collisions": np.mean(collisions)}
    return realism(np.array(likelihoods)) | means | {"scenes": len(apart)}


def _played_by(
    policy: str,
    scenario: str,
    traffic: str,
    log: Log,
    windows: Sequence[Window],
    roads: LaneGraph,
    rollouts: int,
) -> Iterator[Played]:
    """Yield what happens in each window while a policy drives one vehicle at a time."""
    scenes = [(window, column) for window in windows for column in window.scenes]
    env, driver = _driver(policy, scenario, traffic)

    def scene(start: EpisodeStart) -> tuple[Window, int]:
        return scenes[start.world // rollouts % len(scenes)]

    recorded = Poses(env, len(scenes) * rollouts, scene, log)
    env.listen(recorded)
    env.change_starts(lambda start: in_place_of(start, *scene(start), log, roads))
    with closing(env):
        play_together(env, [(driver, np.ones(1, np.bool_))], range(len(recorded.pose)))
    poses = iter(recorded.pose.reshape(len(scenes), rollouts, INSTANTS, 4))
    for window in windows:
        yield {column: next(poses) for column in window.scenes}.__getitem__, window.pose[None]


def _driver(policy: str, scenario: str, traffic: str) -> tuple[VectorHiWayEnv, Driver]:
    """Return simulations with one agent, and what drives it; it ends with the window or off the map."""
    folder = RunFolder(Path(policy))
    never = DoneCriteria(collision=False, off_road=False, off_route=False)
    played: dict[str, Any] = {"num_envs": ENVS, "max_episode_steps": INSTANTS - 1, "criteria": never}
    task = fitted({"name": "realism", "scenarios": [scenario]}, TrainingTask, policy)
    if folder.config.exists():
        run = read_run(folder)
        changed = run.task_setting.environment.model_dump() | {"agents": 1, "traffic_engine": None}
        given = {"environment": fitted(changed, Environment, policy), "task": task, "traffic": traffic}
        run = replace(run, task_setting=replace(run.task_setting, **given))
        trained = Policy(run, folder.kept("last"), is_sampled=True, seed=EVALUATION_SEED)
        env = environment(run.task_setting, **played)
        return env, TrainedDriver(trained, np.ones(1, np.bool_), env)
    agent, interface = batch_agent(policy)
    driven = environment_of(agent, interface, 1, None, policy)
    setting = TaskSetting(task, traffic, driven, Evaluation(), ENVS)
    env = environment(setting, observation=agent.observation, **played)
    return env, AgentDriver(agent, env)


def in_place_of(
    start: EpisodeStart, window: Window, column: int, log: Log, roads: LaneGraph, mode: str = "log"
) -> EpisodeStart:
    """Return an episode in which the agent begins in the place of a recorded vehicle, on its route.

    Where the recording ends on the way, the route leads straight on to the map's end.
    Traffic plays the recording; it leaves out what stands in the agent's place, which is that vehicle.
    """
    track, (x, y, heading, speed) = window.tracks[column], window.pose[0, column].tolist()
    paths, last = log.paths, log.paths.sample[track + 1] - 1
    places, turns = [[x, y], [paths.x[last], paths.y[last]]], [heading, paths.turn[last]]
    found = lanes_of(np.array(places), wrap_angle(np.array(turns)), roads)
    lane, edges = int(found.lane[0]), log.routes[track]
    after = [int(roads.lane_edge[each]) for each in lanes_onward(roads, int(found.lane[1]))]
    edges = (*edges, *(each for each in after if each not in edges and not roads.edge_is_internal[each]))
    edge = int(roads.lane_edge[lane])
    way = find_way(roads, edges[edges.index(edge) :] if edge in edges else edges)
    length, width = window.size[column].tolist()
    agent = replace(
        start.agents[0],
        pose=(x, y, heading),
        speed=speed,
        mission=way.mission_from(roads, lane, float(found.s[0]), speed) if way else AgentMission(),
        kind=VehicleKind(int(paths.kind[track])),
        length=length,
        width=width,
        entry_time=0.0,
        take_over=None,
    )
    recording: Any = start.traffic.recording
    recording = replace(recording, mode=mode, begin=window.begin, latest=window.begin)
    traffic = replace(start.traffic, recording=recording)
    return replace(start, agents=(agent,), traffic=traffic, clears=False)


class Poses:
    """Keeps the agent's poses in the first worlds, and gives it the recorded path; see `StepListener`."""

    def __init__(
        self,
        env: VectorHiWayEnv,
        worlds: int,
        scene: Callable[[EpisodeStart], tuple[Window, int]],
        log: Log,
    ) -> None:
        self._env, self._scene, self._log = env, scene, log
        self.pose = np.full((worlds, INSTANTS, 4), np.nan)

    def collect(self, frame: Frame, is_last: bool) -> None:
        """Keep the poses of a step."""
        vehicles, slot = frame.world.vehicles, frame.world.agents.slot[:, 0]
        for row, start in frame.starts.items():
            window, column = self._scene(start)
            key = int(slot[row]), int(vehicles.generation[row, slot[row]])
            frame.world.paths[row][key] = self._log.paths.points(window.tracks[column])
        number = np.array([start.world for start in self._env.episodes])
        rows = np.flatnonzero(frame.env_mask & (slot >= 0) & (number < len(self.pose)))
        columns = vehicles.position, vehicles.heading[..., None], vehicles.speed[..., None]
        found = np.concatenate([each[rows, slot[rows]] for each in columns], axis=-1)
        self.pose[number[rows], frame.world.step[rows]] = found

    def reset(self, egos: Bools) -> None:
        """See `StepListener`."""
