"""Compare the episodes of two trees of this project, bit by bit.

    python perf/same_episodes.py BASE NEW --quick                 # three scenarios, 200 steps
    python perf/same_episodes.py BASE NEW                         # all scenarios, 1,000 steps
    python perf/same_episodes.py BASE NEW --scenarios loop --actions Lane MPC --apis dict --keep /tmp/base

BASE and NEW are checkouts, each played by its own `.venv/bin/python`, or else by this interpreter. The file
runs alone, outside any checkout, on the standard library. A child process per tree plays seeded actions
through the public environments and prints digests of each block of 50 steps:

- `dict`: `HiWayEnv` with all sensors but the pictures, all vehicles in sight, a decision every step; the
  agents' vehicles, their dynamics and tyres differ;
- `vector`: `VectorHiWayEnv`, four simulations, the benchmark's observation and reward, a decision every five
  steps;
- `arrays`: `VectorHiWayEnv`, two simulations, every array of every sensor, pictures and lidar included;
- `record`: the Parquet columns of recorded episodes;
- `pettingzoo`, `rllib`, `single`: those environments, in one scenario.

Prints a table with the first differing block of each row, then plays the first of these blocks again in both
trees and names the step, the fields and the values that differ. Exits with 1 on any difference or failure.

A name that differs in NEW is given by `--rename OLD=NEW`, the module of a class that has moved by
`--place CLASS=MODULE`; lasting ones go into `RENAMES` and `PLACES`.
"""

from __future__ import annotations

import argparse
import dataclasses
import enum
import hashlib
import importlib
import inspect
import json
import operator
import os
import pickle
import re
import struct
import subprocess
import sys
import tempfile
import time
import zlib
from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from itertools import zip_longest
from pathlib import Path
from typing import Any

RENAMES: dict[str, str] = {
    "void": "invalid",
    "is_void": "is_invalid",
    "seat": "agent_id",
    "seats": "agent_states",
    "partner_seat": "partner_agent_id",
    "legal": "action_mask",
    "ticket": "arrival_number",
    "travelled": "distance_travelled",
    "route_done": "route_progress",
    "adapter": "observation",
    "sumo_seed": "traffic_seed",
}
"""Old name -> new name of fields, keys, columns, tables, keywords, texts; both trees are read by the new."""
IGNORED: set[str] = {"version", "program", "traffic_engine"}
"""New names of fields and columns that are not compared: they name the program; older records lack some."""
PLACES: dict[str, tuple[str, ...]] = {
    **dict.fromkeys(("AgentInterface", "ActionSpaceType", "NeighborhoodVehicles"), ("smarts.agents",)),
    **dict.fromkeys(("DrivableAreaGridMap", "OGM", "RGB", "OcclusionMap"), ("smarts.agents",)),
    **dict.fromkeys(("HiWayEnv", "VectorHiWayEnv", "RLlibHiWayEnv"), ("smarts.env",)),
    **dict.fromkeys(("SingleHiWayEnv", "hiway_parallel_env"), ("smarts.env",)),
    "Options": ("smarts.sim.assembly", "smarts.sim", "smarts.env"),
}
"""Modules that a name may be in; the first that has it counts."""

SHORT_FIELDS = ["dt", "step_count", "steps_completed", "elapsed_sim_time", "events", "distance_travelled"]
SHORT_FIELDS += ["under_this_agent_control", "custom_renders", "ego_vehicle_state", "via_data", "signals"]
TRAFFIC = "neighborhood_vehicle_states"
LONG_FIELDS = ["waypoint_paths", "road_waypoints", "lidar_point_cloud"]
PICTURES = {"drivable_area_grid_map": "DrivableAreaGridMap", "occupancy_grid_map": "OGM"}
PICTURES |= {"top_down_rgb": "RGB", "occlusion_map": "OcclusionMap"}
OBSERVATION = [*SHORT_FIELDS, TRAFFIC, *LONG_FIELDS, *PICTURES]
"""Fields of `HiWayEnv`'s observations. Each step has the short ones of all agents and the traffic, which
covers all vehicles, of one; every tenth has all. The arrays behind them are in each step of `arrays`."""
OFTEN, BLOCK, PERIOD, SEED = 10, 50, 5, 7
SOCIAL = ["random_social_vehicles"]
"""The traffic where few episodes are played."""
EGOS = dict.fromkeys(("intersection", "two_way", "roundabout", "double_merge", "loop", "city"), 4)
EGOS |= {"overtaking": 2}
"""Agents that a scenario has missions for; 3 in the others."""

QUICK = ("loop", "intersection", "double_merge")
ACTIONS = ("Lane", "Continuous", "LaneWithContinuousSpeed", "Trajectory")
PATHS = ("TargetPose", "MultiTargetPose", "Trajectory", "MPC", "TrajectoryWithTime")
"""Actions that are made from the observation."""
DRAWN = ("Lane", "Continuous", "LaneWithContinuousSpeed", "ActuatorDynamic", "RelativeTargetPose", "Direct")
CODES = {"f8": "d", "f4": "f", "f2": "e", "i8": "q", "i4": "i", "i2": "h", "i1": "b", "b1": "?", "u1": "B"}
CODES |= {"u8": "Q", "u4": "I", "u2": "H"}
"""NumPy's types -> those of `struct`."""

Cell = Mapping[str, Any]
"""A row of the table: its name, api, scenario, action and steps."""
Leaf = tuple[str, str, bytes]
"""Path, kind (an array's type and shape, or "text"), bytes."""


def leaves(path: str, value: Any) -> Iterator[Leaf]:
    """Yield what a value consists of, in an order that depends on names and values only.

    Dicts and records (named tuples, dataclasses) are read by name, so that one may become the other; enums
    are their values, and what is None is not there. A sequence of equal records is read by columns.
    """
    kind = kind_of(type(value))
    if kind == "record":
        for new, old in fields_of(type(value)):
            yield from leaves(f"{path}.{new}", getattr(value, old, None))
    elif kind == "mapping":
        named = [(new_name(key), part) for key, part in value.items()]
        for new, part in sorted(named, key=operator.itemgetter(0)):
            if new not in IGNORED:
                yield from leaves(f"{path}.{new}", part)
    elif kind == "sequence":
        yield f"{path}.length", "text", str(len(value)).encode()
        yield from sequence_leaves(path, value)
    elif kind != "none":
        yield path, *scalar(kind, value)


@cache
def kind_of(cls: type) -> str:
    """Return how a class is read."""
    kinds = {"none": type(None), "enum": enum.Enum, "text": bool | int | str, "float": float}
    kinds |= {"mapping": Mapping, "set": set | frozenset}
    found = [kind for kind, classes in kinds.items() if issubclass(cls, classes)]
    if found:
        return found[0]
    if hasattr(cls, "tobytes"):  # arrays and scalars of NumPy
        return "array"
    if hasattr(cls, "_fields") or dataclasses.is_dataclass(cls):
        return "record"
    if issubclass(cls, list | tuple):
        return "sequence"
    raise TypeError(f"{cls} is neither numbers, text nor a record")


@cache
def fields_of(cls: type) -> list[tuple[str, str]]:
    """Return new and old names of a record's fields, in alphabetical order of the new."""
    names = getattr(cls, "_fields", None) or [field.name for field in dataclasses.fields(cls)]
    if hasattr(cls, "ego_vehicle_state"):
        names = OBSERVATION
    return sorted((new_name(name), name) for name in names if new_name(name) not in IGNORED)


def new_name(name: Any) -> str:
    """Return the new name of a field or key; those of arrays are paths."""
    return "/".join(RENAMES.get(piece, piece) for piece in str(name).split("/"))


def scalar(kind: str, value: Any) -> tuple[str, bytes]:
    """Return kind and bytes of a number, text, array or set."""
    if kind == "array" and value.dtype.kind not in "OUS":
        return f"{value.dtype.str} {value.shape}", value.tobytes()
    if kind == "float":
        return "<f8 ()", struct.pack("<d", value)
    if kind == "array":
        return "text", "\n".join(map(text_of, value.ravel().tolist())).encode()
    return "text", ("\n".join(sorted(map(text_of, value))) if kind == "set" else text_of(value)).encode()


def text_of(value: Any) -> str:
    """Return a number, truth or text as text; a text by its new name."""
    value = value.value if isinstance(value, enum.Enum) else value
    if isinstance(value, float):
        return value.hex()
    return RENAMES.get(value, value) if isinstance(value, str) else str(value)


def sequence_leaves(path: str, values: Sequence[Any]) -> Iterator[Leaf]:
    """Yield what a sequence consists of."""
    classes = {*map(type, values)}
    kind = kind_of(*classes) if len(classes) == 1 else ""
    arrays = [scalar(kind, value) for value in values] if kind == "array" else []
    if kind == "float":
        yield path, f"<f8 ({len(values)},)", struct.pack(f"<{len(values)}d", *values)
    elif kind == "text":
        yield path, "text", "\n".join(map(text_of, values)).encode()
    elif arrays and len({shape for shape, _ in arrays}) == 1:
        yield path, f"{arrays[0][0]} x {len(arrays)}", b"".join(data for _, data in arrays)
    elif kind == "record":
        for new, old in fields_of(*classes):
            column = [getattr(value, old, None) for value in values]
            if any(part is not None for part in column):
                yield from leaves(f"{path}[*].{new}", column)
    else:
        for number, value in enumerate(values):
            yield from leaves(f"{path}[{number}]", value)


# The child: plays one tree.


class Digests:
    """Digests of a cell's blocks, printed as lines of JSON.

    Args:
        cell: What is played.
        wanted: The block whose leaves are kept instead, if any.
    """

    def __init__(self, cell: Cell, wanted: int | None = None) -> None:
        self.episodes = 0
        self.kept: list[tuple[int, Leaf]] = []
        self._cell, self._wanted = cell, wanted
        self._step, self._hashes = 0, {}

    def begin(self, step: int) -> bool:
        """Begin a step; return whether it is wanted."""
        if step // BLOCK != self._step // BLOCK:
            self.flush()
        self._step = step
        return self._wanted is None or step // BLOCK <= self._wanted

    def add(self, group: str, value: Any) -> None:
        """Add to the digest of a group."""
        group = new_name(group)
        if group in IGNORED:
            return
        if self._wanted is not None:
            if self._wanted == self._step // BLOCK:
                self.kept += [(self._step, leaf) for leaf in leaves(group, value)]
            return
        hashed = self._hashes.setdefault(group, hashlib.blake2b(digest_size=12))
        for path, kind, data in leaves(group, value):
            hashed.update(f"{path} {kind} {len(data)} ".encode())
            hashed.update(data)

    def flush(self) -> None:
        """Print the block."""
        if self._hashes:
            digests = {group: hashed.hexdigest() for group, hashed in self._hashes.items()}
            block = {"block": self._step // BLOCK, "episodes": self.episodes, "digests": digests}
            print(json.dumps({"cell": self._cell["name"], **block}), flush=True)
        self._hashes = {}


def find(name: str) -> Any:
    """Return a class or function of the tree.

    Raises:
        ImportError: None of its places has it.
    """
    for place in PLACES[name]:
        try:
            return getattr(importlib.import_module(place), name)
        except (ModuleNotFoundError, AttributeError):
            continue
    raise ImportError(f"{name} is in none of {PLACES[name]}: add its module to PLACES")


def make(name: str, **keywords: Any) -> Any:
    """Call a class or function of the tree, with keywords by their old or new names."""
    function = find(name)
    known = inspect.signature(function).parameters
    return function(**{key if key in known else new_name(key): value for key, value in keywords.items()})


def get(value: Any, name: str) -> Any:
    """Return an attribute by its old or new name."""
    return getattr(value, name) if hasattr(value, name) else getattr(value, new_name(name))


def egos_of(cell: Cell) -> int:
    """Return how many agents there are."""
    return EGOS.get(cell["scenario"], 3)


def interfaces(cell: Cell) -> dict[str, Any]:
    """Return the agents' interfaces."""
    size = {"width": 48, "height": 48, "resolution": 1.0}
    pictures = (
        {name: make(kind, **size) for name, kind in PICTURES.items()} if cell["api"] == "arrays" else {}
    )
    most = 500 if cell["scenario"] == "city" else 100
    vehicles: list[dict[str, Any]] = [
        {},
        {"vehicle_model": "dynamic"},
        {"tyre_model": "linear", "vehicle_class": "truck"},
        {"vehicle_model": "kinematic", "vehicle_class": "motorcycle"},
    ]
    return {
        f"agent-{number}": make(
            "AgentInterface",
            action=getattr(find("ActionSpaceType"), cell["action"]),
            max_episode_steps=80 if cell["steps"] < 500 else 200,
            neighborhood_vehicle_states=make("NeighborhoodVehicles", radius=None, most=most),
            **dict.fromkeys([*LONG_FIELDS, "signals"], True),
            **pictures,
            **(vehicles[number] if cell["api"] == "dict" else {}),
        )
        for number in range(egos_of(cell))
    }


def draw(random: Any, kind: str, count: int) -> Any:
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
    return importlib.import_module("numpy").stack(columns[kind], axis=-1).astype("float32")


def path_action(kind: str, seen: Any, choice: float, speed: float) -> Any:
    """Return an action along one of the waypoint paths that an agent sees."""
    ego, paths = get(seen, "ego_vehicle_state"), get(seen, "waypoint_paths")
    points = paths[int(choice * len(paths))][:20] if paths else []
    rows = [(*map(float, get(point, "pos")), float(get(point, "heading"))) for point in points]
    rows = rows or [(*get(ego, "position")[:2], float(get(ego, "heading")))]
    if kind.endswith("Pose"):
        return (*rows[min(len(rows) - 1, int(speed))], 1.0)
    times = [0.1 + number / speed for number in range(len(rows))]
    path = [*map(list, zip(*rows, strict=True)), [speed] * len(rows)]
    return [times, *path] if kind == "TrajectoryWithTime" else path


def dict_actions(cell: Cell, random: Any, names: Sequence[str], observations: Mapping[str, Any]) -> Any:
    """Return the actions of the agents that see something; the draws are the same whoever does."""
    kind = cell["action"]
    drawn = [] if kind in PATHS else draw(random, kind, len(names))
    choices = random.uniform(size=len(names)).tolist(), random.uniform(3.0, 12.0, size=len(names)).tolist()
    actions = {}
    for number, name in enumerate(names):
        if name in observations and kind in PATHS:
            actions[name] = path_action(kind, observations[name], choices[0][number], choices[1][number])
        elif name in observations:
            actions[name] = int(drawn[number]) if kind == "Lane" else drawn[number]
    return actions


def play_dict(cell: Cell, random: Any, digests: Digests) -> None:
    """Play `HiWayEnv`."""
    agents = interfaces(cell)
    keywords = {"agent_specs": agents, "seed": SEED, "traffic": SOCIAL}
    env = make("HiWayEnv", scenarios=[cell["scenario"]], **keywords)
    observations, done = {}, True
    try:
        for step in range(cell["steps"]):
            if not digests.begin(step):
                break
            actions, is_reset = dict_actions(cell, random, [*agents], observations), done
            if is_reset:
                observations, infos = env.reset()
                done = False
            else:
                observations, rewards, terminated, truncated, infos = env.step(actions)
                digests.add("rewards", rewards)
                digests.add("terminated", terminated)
                digests.add("truncated", truncated)
                done = terminated["__all__"] or truncated["__all__"]
                digests.episodes += done
            digests.add("infos", {name: {**info, "env_obs": None} for name, info in infos.items()})
            add_observations(digests, observations, done or is_reset or step % OFTEN == 0)
    finally:
        env.close()


def add_observations(digests: Digests, observations: Mapping[str, Any], is_whole: bool) -> None:
    """Add observations; see `OBSERVATION`."""
    for field in OBSERVATION if is_whole else [*SHORT_FIELDS, TRAFFIC]:
        names = sorted(observations) if is_whole or field != TRAFFIC else sorted(observations)[:1]
        digests.add(
            f"observations.{new_name(field)}", {name: get(observations[name], field) for name in names}
        )


def play_vector(cell: Cell, random: Any, digests: Digests) -> None:
    """Play `VectorHiWayEnv`."""
    is_raw = cell["api"] == "arrays"
    egos, count, period = egos_of(cell), *((2, 1) if is_raw else (4, PERIOD))
    options: dict[str, Any] = {"adapter": "raw", "traffic": SOCIAL} if is_raw else {}
    if "record" in cell:
        options["simulation"] = make("Options", record=cell["record"])
    agents = egos if cell["action"] == "Lane" and not is_raw else interfaces(cell)
    keywords = {"num_envs": count, "scenarios": [cell["scenario"]], "agents": agents, "seed": SEED}
    env = make("VectorHiWayEnv", **keywords, decision_interval=period, **options)
    try:
        now = env.reset()
        sizes = [len(get(block, "agents")) for block in get(get(env, "spaces"), "blocks")]
        for step in range(0, cell["steps"], period):
            if not digests.begin(step):
                break
            for new, old in fields_of(type(now)):
                digests.add(new, getattr(now, old))
            digests.episodes += int(get(now, "reset").sum())
            drawn = draw(random, cell["action"], count * egos)
            drawn = drawn.reshape(count, egos, *drawn.shape[1:])
            ends = [sum(sizes[: number + 1]) for number in range(len(sizes))]
            now = env.step([drawn[:, end - size : end] for size, end in zip(sizes, ends, strict=True)])
    finally:
        env.close()


def play_record(cell: Cell, random: Any, digests: Digests) -> None:
    """Record episodes, and read their tables; an episode is a block."""
    parquet = importlib.import_module("pyarrow.parquet")
    with tempfile.TemporaryDirectory() as folder:
        unread = Digests(cell, -1)
        unread.begin = lambda step: True
        play_vector({**cell, "record": folder}, random, unread)
        digests.episodes = unread.episodes
        for number, episode in enumerate(sorted({file.parent for file in Path(folder).rglob("*.parquet")})):
            digests.begin(number * BLOCK)
            for file in sorted(episode.glob("*.parquet")):
                table = parquet.read_table(file)
                digests.add(file.stem, {name: _plain(table[name]) for name in table.column_names})


def _plain(column: Any) -> Any:
    if str(column.type) == "string" or str(column.type).startswith("list"):
        return column.to_pylist()
    return column.to_numpy()


def play_named(cell: Cell, random: Any, digests: Digests) -> None:
    """Play the PettingZoo, the RLlib or the single-agent environment."""
    api, keywords = cell["api"], {"scenarios": [cell["scenario"]], "seed": SEED}
    egos = egos_of(cell)
    if api == "single":
        env = make("SingleHiWayEnv", **keywords)
    elif api == "pettingzoo":
        env = make("hiway_parallel_env", **keywords, agents=egos, action_mask=True)
    else:
        env = find("RLlibHiWayEnv")({**keywords, "agents": egos})
    labels = ("observations", "rewards", "terminated", "truncated", "infos")
    done, names = True, []
    try:
        for step in range(0, cell["steps"], PERIOD):
            if not digests.begin(step):
                break
            drawn = draw(random, "Lane", egos).tolist()
            actions = {name: drawn[int(name.rpartition("-")[2])] for name in names}
            result = env.reset() if done else env.step(drawn[0] if api == "single" else actions)
            for label, value in zip(("observations", "infos") if done else labels, result, strict=True):
                digests.add(label, value)
            names = [] if api == "single" else list(env.agents)
            digests.add("agents", sorted(names))
            ends = [] if done else result[2:4]
            done = any(each.get("__all__", not names) if isinstance(each, dict) else each for each in ends)
            digests.episodes += done
    finally:
        env.close()


PLAYERS = {"dict": play_dict, "vector": play_vector, "arrays": play_vector, "record": play_record}
PLAYERS |= dict.fromkeys(("pettingzoo", "rllib", "single"), play_named)


def child(folder: Path) -> None:
    """Play cells; print digests, or write the leaves of a block into the folder."""
    cells, wanted, renames, places, ignored = json.loads((folder / "task.json").read_text())
    RENAMES.update(renames)
    PLACES.update(places)
    IGNORED.update(ignored)
    numpy = importlib.import_module("numpy")
    place = Path(str(importlib.import_module("smarts").__file__)).resolve()
    if Path.cwd().resolve() not in place.parents:
        sys.exit(f"smarts is imported from {place}, not from {Path.cwd()}")
    for cell in cells:
        random = numpy.random.Generator(numpy.random.Philox(key=zlib.crc32(cell["name"].encode())))
        digests, begin, end = Digests(cell, wanted), time.perf_counter(), {}
        try:
            PLAYERS[cell["api"]](cell, random, digests)
        except Exception as error:
            print(f"\n{cell['name']}:", file=sys.stderr)
            sys.excepthook(type(error), error, error.__traceback__)
            end["failure"] = f"{type(error).__name__}: {error}".split("\n")[0]
        digests.flush()
        end |= {"cell": cell["name"], "seconds": time.perf_counter() - begin}
        print(json.dumps(end), flush=True)
        (folder / "leaves").write_bytes(pickle.dumps(digests.kept))


# The parent: compares.


def run_child(tree: Path, cells: Sequence[Cell], *, number: int, wanted: int | None = None) -> Any:
    """Play cells in a tree; return its rows by cell, or the leaves of the wanted block."""
    python = tree / ".venv" / "bin" / "python"
    rows: dict[str, Any] = {cell["name"]: {"blocks": {}, "episodes": 0} for cell in cells}
    # Names are hashed with another seed in each tree; nothing may depend on that.
    own = {"PYTHONPATH": str(tree), "PYTHONHASHSEED": str(number), "OMP_NUM_THREADS": "1"}
    with tempfile.TemporaryDirectory() as name, Path(name, "errors").open("w+") as errors:
        folder = Path(name)
        (folder / "player.py").write_text(SOURCE)
        (folder / "task.json").write_text(json.dumps([cells, wanted, RENAMES, PLACES, [*IGNORED]]))
        command = [
            str(python) if python.exists() else sys.executable,
            "-P",
            folder / "player.py",
            "--child",
            name,
        ]
        pipes = {"stdout": subprocess.PIPE, "stderr": errors, "text": True}
        process = subprocess.Popen(command, cwd=tree, env={**os.environ, **own}, **pipes)
        for line in process.stdout or ():
            if line.startswith("{"):
                _take(json.loads(line), rows, tree)
        code = process.wait()
        for row in rows.values():
            if "seconds" not in row:
                row["failure"] = f"the process ended with code {code}"
        if any("failure" in row for row in rows.values()):
            errors.seek(0)
            print(f"{tree}: ...{errors.read()[-6000:]}", file=sys.stderr)
        return rows if wanted is None else pickle.loads((folder / "leaves").read_bytes())


def _take(told: dict[str, Any], rows: dict[str, Any], tree: Path) -> None:
    row = rows[told.pop("cell")]
    if "block" in told:
        row["blocks"][str(told.pop("block"))] = told.pop("digests")
    row.update(told)
    if "seconds" in row:
        done = sum("seconds" in each for each in rows.values())
        print(f"{tree}: {done} of {len(rows)}, {row['seconds']:.1f} s", file=sys.stderr)


def kept_rows(tree: Path, cells: Sequence[Cell], keep: Path | None) -> Any:
    """Return the rows of the base tree, from a folder where they are there for this commit and this file."""
    if keep is None:
        return run_child(tree, cells, number=1)
    git = [["git", "rev-parse", "HEAD"], ["git", "diff", "HEAD"]]
    state = [subprocess.run(each, cwd=tree, capture_output=True, check=True).stdout.hex() for each in git]
    key = json.dumps([SOURCE, state, str(tree), RENAMES, PLACES, sorted(IGNORED)])
    folder = keep / hashlib.blake2b(key.encode(), digest_size=8).hexdigest()
    files = {
        cell["name"]: folder / f"{cell['name'].replace(' ', '_')}_{cell['steps']}.json" for cell in cells
    }
    missing = [cell for cell in cells if not files[cell["name"]].exists()]
    made = run_child(tree, missing, number=1) if missing else {}
    folder.mkdir(parents=True, exist_ok=True)
    for name, row in made.items():
        if "failure" not in row:
            partial = files[name].with_suffix(f".{os.getpid()}")
            partial.write_text(json.dumps(row))
            partial.replace(files[name])
    return {
        name: made[name] if name in made else json.loads(file.read_text()) for name, file in files.items()
    }


def first_difference(base: Mapping[str, Any], new: Mapping[str, Any]) -> tuple[int, list[str]] | None:
    """Return the first block that differs, and the groups in it, or None."""
    for block in sorted({*base["blocks"], *new["blocks"]}, key=int):
        one, other = (row["blocks"].get(block, {}) for row in (base, new))
        groups = [group for group in sorted({*one, *other}) if one.get(group) != other.get(group)]
        if groups:
            return int(block), groups
    return None


def items_of(leaf: tuple[str, bytes]) -> list[str]:
    """Return the items of a leaf as text; that of floats has their bits."""
    kind, data = leaf
    if kind == "text":
        return [repr(line) for line in data.decode().split("\n")]
    code = CODES[kind.split()[0][1:]]
    values = struct.unpack(f"<{len(data) // struct.calcsize(code)}{code}", data)
    if code not in "dfe":
        return [*map(repr, values)]
    return [f"{value!r} [{struct.pack('>' + code, value).hex()}]" for value in values]


def compare_leaves(one: tuple[str, bytes] | None, other: tuple[str, bytes] | None) -> str:
    """Return how two leaves of a name differ: the first item in which they do, and how many there are."""
    pairs = [*zip_longest(*(items_of(leaf) if leaf else [] for leaf in (one, other)), fillvalue="nothing")]
    differing = [number for number, pair in enumerate(pairs) if pair[0] != pair[1]]
    kinds = " -> ".join(dict.fromkeys("absent" if leaf is None else leaf[0] for leaf in (one, other)))
    first = f", [{differing[0]}] {' -> '.join(pairs[differing[0]])}" if differing else ""
    return f"{kinds}, {len(differing)} of {len(pairs)} differ{first}"


def explain(trees: Sequence[Path], cell: Cell, block: int, most: int) -> None:
    """Play a block again in both trees; print what differs in its first differing step."""
    steps: dict[int, list[dict[str, tuple[str, bytes]]]] = {}
    for side, tree in enumerate(trees):
        for step, (path, kind, data) in run_child(tree, [cell], number=side + 1, wanted=block):
            steps.setdefault(step, [{}, {}])[side][path] = kind, data
    for step, (one, other) in sorted(steps.items()):
        paths = [path for path in {**one, **other} if one.get(path) != other.get(path)]
        if paths:
            where = f"episode {step // BLOCK}" if cell["api"] == "record" else f"step {step}"
            print(f"\n{cell['name']}, {where}: {len(paths)} of {len({**one, **other})} values differ")
            for path in paths[:most]:
                print(f"  {path}: {compare_leaves(one.get(path), other.get(path))}")
            return
    print(f"\n{cell['name']}: played again the block is equal, so one of the trees is not deterministic")


def cells_of(arguments: argparse.Namespace) -> list[Cell]:
    """Return what is played: rows of the table."""
    suite = (arguments.base / "scenarios" / "suite.yaml").read_text()
    scenarios = arguments.scenarios or (QUICK if arguments.quick else re.findall(r"(?m)^(\w+):", suite))
    actions = arguments.actions or ACTIONS[: 3 if arguments.quick else None]
    steps = arguments.steps or (200 if arguments.quick else 1000)
    found = []
    for scenario in scenarios:
        drawn = [action for action in actions if action in DRAWN] or ["Lane"]
        found += [("dict", scenario, action, steps) for action in actions]
        found += [("vector", scenario, action, steps) for action in drawn]
        found += [
            ("arrays", scenario, drawn[0], max(steps // 5, 20)),
            ("record", scenario, drawn[0], steps // 2),
        ]
    others = "intersection" if "intersection" in scenarios else scenarios[0]
    found += [(api, others, "Lane", 200) for api in ("pettingzoo", "rllib", "single")]
    return [
        {
            "api": api,
            "scenario": scenario,
            "action": action,
            "steps": length,
            "name": f"{api} {scenario} {action}",
        }
        for api, scenario, action, length in found
        if api in arguments.apis
    ]


def verdict_of(base: Mapping[str, Any], new: Mapping[str, Any], name: str) -> str:
    """Return a row's last column."""
    found = [f"{side}: {row['failure']}" for side, row in (("BASE", base), ("NEW", new)) if "failure" in row]
    difference = first_difference(base, new)
    if difference is not None:
        block, groups = difference
        where = (
            f"episode {block}"
            if name.startswith("record")
            else f"steps {block * BLOCK} to {block * BLOCK + 49}"
        )
        found.append(f"DIFFERS in {where}: {', '.join(groups[:8])}{' ...' if groups[8:] else ''}")
    return "; ".join(found) or ("equal" if base["blocks"] else "nothing was played")


def read_arguments() -> argparse.Namespace:
    """Read the command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("base", type=lambda text: Path(text).resolve())
    parser.add_argument("new", type=lambda text: Path(text).resolve())
    parser.add_argument("--scenarios", nargs="+", default=[], help="names of the suite; default: all")
    actions = [*dict.fromkeys((*DRAWN, *PATHS))]
    parser.add_argument("--actions", nargs="+", default=[], help=f"of {', '.join(actions)}")
    parser.add_argument("--apis", nargs="+", default=[*PLAYERS], help=f"of {', '.join(PLAYERS)}")
    parser.add_argument("--steps", type=int, help="of 0.1 s; default: 1000, with --quick 200")
    parser.add_argument("--quick", action="store_true", help=f"only {', '.join(QUICK)}, three action types")
    pair = {"type": lambda text: tuple(text.split("=")), "nargs": "+", "default": []}
    parser.add_argument("--rename", **pair, metavar="OLD=NEW", help="fields, keys, columns, keywords, texts")
    parser.add_argument("--place", **pair, metavar="CLASS=MODULE", help="where NEW has a class")
    parser.add_argument("--ignore", nargs="+", default=[], help="new names of what is not compared")
    parser.add_argument("--keep", type=Path, help="folder for BASE's digests: the next call takes them")
    parser.add_argument("--explained", type=int, default=2, help="rows whose difference is explained")
    parser.add_argument("--most", type=int, default=15, help="values that an explanation names")
    arguments = parser.parse_args()
    for name, known in (("scenarios", None), ("actions", actions), ("apis", [*PLAYERS])):
        given = [each for text in getattr(arguments, name) for each in text.split(",") if each]
        setattr(arguments, name, given)
        for each in given:
            if known and each not in known:
                parser.error(f"--{name}: {each!r} is not of {', '.join(known)}")
    return arguments


def main() -> int:
    """Compare; return the exit code."""
    arguments = read_arguments()
    RENAMES.update(arguments.rename)
    PLACES.update({name: (module, *PLACES[name]) for name, module in arguments.place})
    IGNORED.update(arguments.ignore)
    cells = cells_of(arguments)
    bases = kept_rows(arguments.base, cells, arguments.keep)
    news = run_child(arguments.new, cells, number=2)
    width = max(len(cell["name"]) for cell in cells)
    print(f"{'':<{width}}  steps  blocks  episodes  base [s]  new [s]")
    wrong = []
    for cell in cells:
        base, new = bases[cell["name"]], news[cell["name"]]
        verdict = verdict_of(base, new, cell["name"])
        counts = f"{cell['steps']:>5}  {len(new['blocks']):>6}  {new['episodes']:>8}"
        times = f"{base.get('seconds', 0.0):>8.1f}  {new.get('seconds', 0.0):>7.1f}"
        print(f"{cell['name']:<{width}}  {counts}  {times}  {verdict}")
        if verdict != "equal":
            wrong.append((cell, first_difference(base, new)))
    differing = [(cell, difference[0]) for cell, difference in wrong if difference is not None]
    for cell, block in differing[: arguments.explained]:
        explain((arguments.base, arguments.new), cell, block, arguments.most)
    print(f"\n{len(cells) - len(wrong)} of {len(cells)} rows are equal")
    return int(bool(wrong))


if __name__ == "__main__":
    if sys.argv[1:2] == ["--child"]:
        child(Path(sys.argv[2]))
    else:
        SOURCE = Path(__file__).read_text()
        sys.exit(main())
