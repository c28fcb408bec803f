"""Compare the episodes of two checkouts of this project, bit by bit.

    python perf/same_episodes.py BASE NEW --quick                 # three scenarios, 200 steps
    python perf/same_episodes.py BASE NEW                         # all scenarios, 1,000 steps
    python perf/same_episodes.py BASE NEW --scenarios loop --actions Lane MPC --apis dict

Each checkout runs in a process of its own, with its own `.venv/bin/python` if it has one. Both play the same
seeded actions through the public environments:

- `dict`: `HiWayEnv` with all sensors but images, a decision in every step; the agents' vehicles differ in
  class, dynamics and tyres. Every tenth observation is compared with all sensors, the others without paths,
  traffic and lidar;
- `vector`: `VectorHiWayEnv`, four simulations, the benchmark's observation and reward, five steps a decision;
- `arrays`: `VectorHiWayEnv`, two simulations, the arrays of all sensors, images and lidar included;
- `record`: the columns of recorded episodes, whose number is the step;
- `pettingzoo`, `rllib`, `single`: those environments, in one scenario.

Prints a row for each; where episodes differ, the first step that does, and its fields with both values.
Exits with 1 if something differs or fails.
"""

from __future__ import annotations

import argparse
import dataclasses
import enum
import hashlib
import json
import os
import subprocess
import sys
import tempfile
import time
import traceback
import zlib
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import yaml

Case = Mapping[str, Any]
"""A row of the table: api, scenario, action, steps."""
Values = Iterator[tuple[str, Any]]
"""Names and values of one step."""

QUICK = ("loop", "intersection", "double_merge")
ACTIONS = ("Lane", "Continuous", "LaneWithContinuousSpeed", "Trajectory")
PATHS = ("TargetPose", "MultiTargetPose", "Trajectory", "MPC", "TrajectoryWithTime")
"""Actions that are made of the observation."""
DRAWN = ("Lane", "Continuous", "LaneWithContinuousSpeed", "ActuatorDynamic", "RelativeTargetPose", "Direct")
IMAGES = {"drivable_area_grid_map": "DrivableAreaGridMap", "occupancy_grid_map": "OGM"}
IMAGES |= {"top_down_rgb": "RGB", "occlusion_map": "OcclusionMap"}
SHORT = ("step_count", "steps_completed", "elapsed_sim_time", "events", "distance_travelled", "neighbors")
SHORT += ("under_this_agent_control", "ego_vehicle_state", "via_data", "signals")
LONG = ("neighborhood_vehicle_states", "waypoint_paths", "road_waypoints", "lidar_point_cloud")
RESULT: tuple[str, ...] = ("observations", "rewards", "terminated", "truncated", "infos")
PROGRAM = {"version", "program"}
"""Columns of recorded episodes that name the program."""
OFTEN, PERIOD, SEED = 10, 5, 7
TRAFFIC = ["random_social_vehicles"]
AGENTS = dict.fromkeys(("intersection", "two_way", "roundabout", "double_merge", "loop", "city"), 4)
AGENTS |= {"overtaking": 2}
"""Agents that a scenario has missions for; 3 in the others."""
MOST_SHOWN = 15
"""Fields of a differing step."""


def leaves(name: str, value: Any) -> Iterator[tuple[str, np.ndarray]]:
    """Yield the arrays that a value consists of, each with its path; texts are arrays, and None is absent."""
    value = value.value if isinstance(value, enum.Enum) else value
    if hasattr(value, "_asdict"):
        value = value._asdict()
    elif dataclasses.is_dataclass(value):
        value = {field.name: getattr(value, field.name) for field in dataclasses.fields(value)}
    if isinstance(value, Mapping):
        for key in sorted(value):
            yield from leaves(f"{name}.{key}", value[key])
    elif isinstance(value, list | tuple):
        yield f"{name}.length", np.array(len(value))
        for number, part in enumerate(value):
            yield from leaves(f"{name}[{number}]", part)
    elif isinstance(value, set | frozenset):
        yield name, np.array(sorted(map(str, value)))
    elif value is not None:
        array = np.asarray(value)
        yield name, array.astype(str) if array.dtype == object else array


def digest(name: str, value: Any) -> str:
    """Return a digest of all bits of a value, and of the names, types and shapes in it."""
    hashed = hashlib.blake2b(digest_size=8)
    for path, array in leaves(name, value):
        hashed.update(f"{path} {array.dtype.str} {array.shape}".encode())
        hashed.update(array.tobytes())
    return hashed.hexdigest()


def texts(name: str, value: Any) -> Iterator[tuple[str, list[str]]]:
    """Yield the path of each array with its type and its items; those of floats have all digits."""
    for path, array in leaves(name, value):
        yield path, [f"{array.dtype} {array.shape}", *map(repr, array.ravel().tolist())]


def difference(base: Sequence[str], new: Sequence[str]) -> str:
    """Return how two arrays of `texts` differ: types and shapes, or how many items and the first of them."""
    if not base or not new or base[0] != new[0]:
        return f"{base[0] if base else 'absent'} -> {new[0] if new else 'absent'}"
    differing = [number for number in range(1, len(base)) if base[number] != new[number]]
    first = differing[0]
    return f"{len(differing)} of {len(base) - 1} differ, [{first - 1}] {base[first]} -> {new[first]}"


# In the process of a checkout


def interfaces(case: Case) -> dict[str, Any]:
    """Return the agents' interfaces."""
    from smarts import agents as a

    has_images, is_dict = case["api"] == "arrays", case["api"] == "dict"
    size = {"width": 48, "height": 48, "resolution": 1.0}
    images = {name: getattr(a, kind)(**size) for name, kind in IMAGES.items() if has_images}
    vehicles: list[dict[str, Any]] = [
        {},
        {"vehicle_model": "dynamic"},
        {"tyre_model": "linear", "vehicle_class": "truck"},
        {"vehicle_model": "kinematic", "vehicle_class": "motorcycle"},
    ]
    return {
        f"agent-{number}": a.AgentInterface(
            action=a.ActionSpaceType[case["action"]],
            max_episode_steps=80 if case["steps"] < 500 else 200,
            neighborhood_vehicle_states=a.NeighborhoodVehicles(
                radius=None, most=500 if case["scenario"] == "city" else 100
            ),
            **dict.fromkeys([*LONG[1:], "signals"], True),
            **images,
            **(vehicles[number] if is_dict else {}),
        )
        for number in range(AGENTS.get(case["scenario"], 3))
    }


def draw(random: np.random.Generator, kind: str, count: int) -> np.ndarray:
    """Return actions of a type that is numbers, shape (count,) or (count, values)."""
    if kind == "Lane":
        return random.choice([0, 0, 0, 0, 0, 0, 1, 2, 3], size=count)
    turn = random.normal(0.0, 0.02, size=count)
    gas, brake = random.uniform(0.0, 0.8, size=count), 0.3 * (random.uniform(size=count) < 0.1)
    columns = {
        "Continuous": (gas, brake, turn),
        "ActuatorDynamic": (gas, brake, 3 * turn),
        "LaneWithContinuousSpeed": (20 * gas, (turn > 0.04) * 1.0 - (turn < -0.04)),
        "RelativeTargetPose": (2 * gas - 0.8, 50 * turn, turn),
        "Direct": (4 * gas - 1.2, turn),
    }
    return np.stack(columns[kind], axis=-1).astype(np.float32)


def path_action(kind: str, seen: Any, choice: float, speed: float) -> Any:
    """Return an action along one of the waypoint paths that an agent observes."""
    ego, paths = seen.ego_vehicle_state, seen.waypoint_paths
    points = paths[int(choice * len(paths))][:20] if paths else []
    rows = [(*map(float, point.pos), float(point.heading)) for point in points]
    rows = rows or [(*ego.position[:2], float(ego.heading))]
    if kind.endswith("Pose"):
        return (*rows[min(len(rows) - 1, int(speed))], 1.0)
    times = [0.1 + number / speed for number in range(len(rows))]
    path = [*map(list, zip(*rows, strict=True)), [speed] * len(rows)]
    return [times, *path] if kind == "TrajectoryWithTime" else path


def dict_actions(kind: str, random: Any, names: Sequence[str], observations: Mapping[str, Any]) -> Any:
    """Return the actions of the agents in `observations`; the draws do not depend on which these are."""
    drawn = [] if kind in PATHS else draw(random, kind, len(names))
    choices, speeds = random.uniform(size=len(names)), random.uniform(3.0, 12.0, size=len(names))
    actions = {}
    for number, name in enumerate(names):
        if name in observations and kind in PATHS:
            actions[name] = path_action(kind, observations[name], choices[number], speeds[number])
        elif name in observations:
            actions[name] = int(drawn[number]) if kind == "Lane" else drawn[number]
    return actions


def play_dict(case: Case, random: np.random.Generator) -> Iterator[Values]:
    """Play `HiWayEnv`."""
    from smarts.env import HiWayEnv

    agents = interfaces(case)
    env = HiWayEnv([case["scenario"]], agents, traffic=TRAFFIC, seed=SEED)
    observations, done = {}, True

    def values(result: Mapping[str, Any], is_whole: bool) -> Values:
        for name in set(result) - {"observations", "infos"}:
            yield name, result[name]
        yield "infos", {name: {**info, "env_obs": None} for name, info in result["infos"].items()}
        for field in (*SHORT, *(LONG if is_whole else ())):
            yield f"observations.{field}", {name: getattr(o, field) for name, o in observations.items()}

    try:
        for step in range(case["steps"]):
            actions, is_reset = dict_actions(case["action"], random, [*agents], observations), done
            names = (RESULT[0], RESULT[-1]) if is_reset else RESULT
            result = dict(zip(names, env.reset() if is_reset else env.step(actions), strict=True))
            observations = result["observations"]
            done = not is_reset and (result["terminated"]["__all__"] or result["truncated"]["__all__"])
            yield values(result, is_reset or done or step % OFTEN == 0)
    finally:
        env.close()


def play_vector(case: Case, random: np.random.Generator, record: str | None = None) -> Iterator[Values]:
    """Play `VectorHiWayEnv`."""
    from smarts.env import VectorHiWayEnv
    from smarts.sim.assembly import Options

    is_raw = case["api"] == "arrays"
    egos, count, period = AGENTS.get(case["scenario"], 3), *((2, 1) if is_raw else (4, PERIOD))
    options: dict[str, Any] = {"observation": "raw", "traffic": TRAFFIC} if is_raw else {}
    agents = egos if case["action"] == "Lane" and not is_raw else interfaces(case)
    keywords = {"seed": SEED, "decision_interval": period, "simulation": Options(record=record)}
    env = VectorHiWayEnv(count, [case["scenario"]], agents, **keywords, **options)
    try:
        now = env.reset()
        ends = np.cumsum([len(block.agents) for block in env.spaces.blocks])[:-1]
        for _ in range(0, case["steps"], period):
            yield iter(now._asdict().items())
            drawn = draw(random, case["action"], count * egos)
            drawn = drawn.reshape(count, egos, *drawn.shape[1:])
            now = env.step(np.split(drawn, ends, axis=1))
    finally:
        env.close()


def play_record(case: Case, random: np.random.Generator) -> Iterator[Values]:
    """Record episodes, and read their tables; an episode is a step."""
    from pyarrow import parquet

    with tempfile.TemporaryDirectory() as folder:
        for _ in play_vector(case, random, folder):
            pass
        for episode in sorted({file.parent for file in Path(folder).rglob("*.parquet")}):
            tables = {file.stem: parquet.read_table(file) for file in sorted(episode.glob("*.parquet"))}
            yield (
                (f"{stem}.{name}", _plain(table[name]))
                for stem, table in tables.items()
                for name in table.column_names
                if name not in PROGRAM
            )


def _plain(column: Any) -> Any:
    return column.to_pylist() if str(column.type).startswith("list") else column.to_numpy()


def play_other(case: Case, random: np.random.Generator) -> Iterator[Values]:
    """Play the PettingZoo, the RLlib or the single-agent environment."""
    from smarts.env import RLlibHiWayEnv, SingleHiWayEnv, hiway_parallel_env

    count, scenarios = AGENTS.get(case["scenario"], 3), [case["scenario"]]
    makers = {
        "single": lambda: SingleHiWayEnv(scenarios, seed=SEED),
        "pettingzoo": lambda: hiway_parallel_env(scenarios, count, seed=SEED, action_mask=True),
        "rllib": lambda: RLlibHiWayEnv({"scenarios": scenarios, "agents": count, "seed": SEED}),
    }
    env, done, is_single = makers[case["api"]](), True, case["api"] == "single"
    try:
        for _ in range(0, case["steps"], PERIOD):
            drawn = draw(random, "Lane", count).tolist()
            if done:
                result = dict(zip((RESULT[0], RESULT[-1]), env.reset(), strict=True))
            else:
                names = [] if is_single else env.agents
                actions = {name: drawn[int(name.rpartition("-")[2])] for name in names}
                result = dict(zip(RESULT, env.step(drawn[0] if is_single else actions), strict=True))
            ends = [result[name] for name in ("terminated", "truncated") if name in result]
            done = any(ends) if is_single else not env.agents
            yield iter(result.items())
    finally:
        env.close()


PLAYERS = {"dict": play_dict, "vector": play_vector, "arrays": play_vector, "record": play_record}
PLAYERS |= dict.fromkeys(("pettingzoo", "rllib", "single"), play_other)


def serve() -> None:
    """Play the cases that standard input names; answer with lines of JSON.

    A case is played to its end, with the digests of each step, or, if it has a step "wanted", to that step,
    with its values.
    """
    sys.path[0] = str(Path.cwd())
    for line in sys.stdin:
        case = json.loads(line)
        wanted, failure = case.pop("wanted", None), ""
        random = np.random.Generator(np.random.Philox(key=zlib.crc32(name_of(case).encode())))
        begin = time.perf_counter()
        try:
            for step, values in enumerate(PLAYERS[case["api"]](case, random)):
                if wanted is None:
                    # A field that holds nothing may be there or not.
                    kept = [(name, value) for name, value in values if any(True for _ in leaves(name, value))]
                    print(json.dumps({name: digest(name, value) for name, value in kept}))
                elif step == wanted:
                    print(json.dumps(dict(pair for each in values for pair in texts(*each))))
                    break
        except Exception as error:
            traceback.print_exc()
            failure = f"{type(error).__name__}: {error}".split("\n")[0]
        print(json.dumps({"failure": failure, "seconds": time.perf_counter() - begin}), flush=True)


# In the process that compares


def name_of(case: Case) -> str:
    """Return the name of a row."""
    return f"{case['api']} {case['scenario']} {case['action']}"


class Worker:
    """A process that plays the episodes of one checkout.

    Args:
        tree: Root of the checkout.
        number: Seed of its hashes of names, on which nothing may depend.
    """

    def __init__(self, tree: Path, number: int) -> None:
        python = tree / ".venv" / "bin" / "python"
        self._process = subprocess.Popen(
            [python if python.exists() else sys.executable, str(Path(__file__).resolve()), "--serve"],
            cwd=tree,
            env={**os.environ, "PYTHONHASHSEED": str(number), "OMP_NUM_THREADS": "1"},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )

    def ask(self, case: Case) -> None:
        """Let it play a case; `answer` waits for it."""
        if self._process.stdin is not None:
            print(json.dumps(case), file=self._process.stdin, flush=True)

    def answer(self) -> tuple[list[dict[str, Any]], dict[str, Any]]:
        """Return the digests or values of the steps, and the failure and seconds of the case."""
        steps = []
        for line in self._process.stdout or ():
            if line.startswith("{"):  # SUMO and Bullet print, too
                steps.append(json.loads(line))
                if "failure" in steps[-1]:
                    return steps[:-1], steps[-1]
        return steps, {"failure": f"the process ended with code {self._process.wait()}", "seconds": 0.0}

    def close(self) -> None:
        """End the process."""
        if self._process.stdin is not None:
            self._process.stdin.close()
        self._process.wait()


def compare(workers: Sequence[Worker], case: Case) -> bool:
    """Play a case in both checkouts and print its row; return whether they are equal."""
    for worker in workers:
        worker.ask(case)
    (base, base_end), (new, new_end) = (worker.answer() for worker in workers)
    failures = [end["failure"] for end in (base_end, new_end) if end["failure"]]
    steps = max(len(base), len(new))
    first = next((step for step in range(steps) if base[step : step + 1] != new[step : step + 1]), None)
    differs = [] if first is None else [f"DIFFERS from step {first} on"]
    verdict = "; ".join([*differs, *failures]) or ("equal" if steps else "nothing was played")
    times = f"{base_end['seconds']:8.1f} {new_end['seconds']:8.1f}"
    print(f"{name_of(case):44} {len(new):6} {times}  {verdict}", flush=True)
    if first is not None and not failures:
        explain(workers, {**case, "wanted": first})
    return verdict == "equal"


def explain(workers: Sequence[Worker], case: Case) -> None:
    """Play a case up to its first differing step again; print the fields that differ."""
    for worker in workers:
        worker.ask(case)
    base, new = ((worker.answer()[0] or [{}])[0] for worker in workers)
    paths = [path for path in {**base, **new} if base.get(path) != new.get(path)]
    print(f"    {len(paths)} of {len({**base, **new})} fields differ" + ", now none" * (not paths))
    for path in paths[:MOST_SHOWN]:
        print(f"    {path}: {difference(base.get(path, []), new.get(path, []))}")


def cases_of(given: argparse.Namespace) -> list[Case]:
    """Return the rows of the table."""
    suite = yaml.safe_load((given.base / "scenarios" / "suite.yaml").read_text())
    scenarios = given.scenarios or (QUICK if given.quick else [*suite])
    actions = given.actions or ACTIONS[: 3 if given.quick else None]
    steps = given.steps or (200 if given.quick else 1000)
    drawn = [action for action in actions if action in DRAWN] or ["Lane"]
    found = []
    for scenario in scenarios:
        found += [("dict", scenario, action, steps) for action in actions]
        found += [("vector", scenario, action, steps) for action in drawn]
        found += [("arrays", scenario, drawn[0], max(steps // 5, 20))]
        found += [("record", scenario, drawn[0], max(steps // 2, 20))]
    one = "intersection" if "intersection" in scenarios else scenarios[0]
    found += [(api, one, "Lane", 200) for api in ("pettingzoo", "rllib", "single")]
    cases: list[Case] = [
        dict(zip(("api", "scenario", "action", "steps"), each, strict=True)) for each in found
    ]
    return [case for case in cases if case["api"] in given.apis]


def main() -> int:
    """Compare; return the exit code."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("base", type=lambda text: Path(text).resolve())
    parser.add_argument("new", type=lambda text: Path(text).resolve())
    parser.add_argument("--scenarios", nargs="+", help="names of the suite; default: all")
    parser.add_argument("--actions", nargs="+", choices=[*dict.fromkeys((*DRAWN, *PATHS))], metavar="ACTION")
    parser.add_argument("--apis", nargs="+", choices=[*PLAYERS], default=[*PLAYERS])
    parser.add_argument("--steps", type=int, help="of 0.1 s; default: 1000, with --quick 200")
    parser.add_argument("--quick", action="store_true", help=f"only {', '.join(QUICK)}, three action types")
    given = parser.parse_args()
    workers = [Worker(tree, number) for number, tree in enumerate((given.base, given.new), 1)]
    print(f"{'':44} {'steps':>6} {'base [s]':>8} {'new [s]':>8}")
    try:
        cases = cases_of(given)
        equal = sum(compare(workers, case) for case in cases)
    finally:
        for worker in workers:
            worker.close()
    print(f"{equal} of {len(cases)} rows are equal")
    return int(equal < len(cases))


if __name__ == "__main__":
    sys.exit(serve() if "--serve" in sys.argv else main())
