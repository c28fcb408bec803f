"""Convert results to the names of today: `python results/convert_v1.py OLD NEW`.

OLD is the folder of an experiment or a run, or a store of recorded episodes; it stays. NEW is created.
Names change, numbers do not:

- folder and YAML key `reference` -> `scripted`, policy `yielder` -> `gap_acceptance`
- YAML keys `copies` -> `num_envs_per_env_runner`, `longest_life` -> `longest_trajectory`
- YAML keys `adapter`, `options` of `environment` -> `observation`, `reward`; those of own adapters `adapter`,
  `adapter_options`
- columns `is_void` -> `is_invalid`, `travelled` -> `distance_travelled`, outcome `void` -> `invalid`
- tables and columns of recorded episodes, see `EPISODE_TABLES` and `EPISODE_COLUMNS`

Results of format 2 may have old YAML keys; of these, only the keys change.
"""

from __future__ import annotations

import json
import re
import shutil
import sys
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
import yaml

from smarts.errors import SmartsError

FORMAT = 2
POLICIES = {"yielder": "gap_acceptance"}
CONFIG_KEYS = {
    "reference": "scripted",
    "copies": "num_envs_per_env_runner",
    "longest_life": "longest_trajectory",
}
COMMANDS = {
    r"environment\.options\.(reward|observation)=": r"environment.\1=",
    r"environment\.adapter=(benchmark|paper|raw)\b": r"environment.observation=\1",
}
"""Patterns of overrides in commands."""
TABLE_COLUMNS = {"is_void": "is_invalid", "travelled": "distance_travelled"}
OUTCOMES = {"void": "invalid"}
EPISODE_TABLES = {"seats": "agent_states"}
EPISODE_COLUMNS = {
    "seat": "agent_id",
    "partner_seat": "partner_agent_id",
    "travelled": "distance_travelled",
    "route_done": "route_progress",
    "legal": "action_mask",
    "ticket": "arrival_number",
    "sumo_seed": "traffic_seed",
    "is_void": "is_invalid",
}
TABLE_FORMAT, TABLE_COUNTS = b"smarts_bench.metrics.format", b"smarts_bench.metrics.episodes"


def convert(old: Path, new: Path) -> None:
    """Write a converted copy of a folder.

    Raises:
        SmartsError: There is no such folder or no old name in it, or the new one exists already.
    """
    if not old.is_dir():
        raise SmartsError("there is no such folder", place=str(old))
    if new.exists():
        raise SmartsError("exists already", place=str(new), remedy="name a new folder")
    partial = new.with_name(f".partial-{new.name}")
    shutil.rmtree(partial, ignore_errors=True)
    shutil.copytree(old, partial)
    try:
        found = [_convert_file(file) for file in sorted(partial.rglob("*")) if file.is_file()]
        if not any(found):
            raise SmartsError("there is nothing to convert in it", place=str(old))
        _rename_folders(partial)
        partial.rename(new)
    finally:
        shutil.rmtree(partial, ignore_errors=True)


def _rename_folders(root: Path) -> None:
    if (root / "reference").is_dir():
        (root / "reference").rename(root / "scripted")
    for old, name in POLICIES.items():
        if (root / "scripted" / old).is_dir():
            (root / "scripted" / old).rename(root / "scripted" / name)


def _convert_file(file: Path) -> bool:
    """Convert a file in place; return whether it has changed."""
    if file.suffix == ".parquet":
        return _convert_parquet(file)
    if file.name == "config.yaml":
        given = yaml.safe_load(file.read_text(encoding="utf-8"))
        content = _renamed(given)
        if content != given:
            file.write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf-8")
        return content != given
    if file.name not in ("run.json", "experiment.json", "command.json", "search.json"):
        return False
    given = json.loads(file.read_text(encoding="utf-8"))
    content = _renamed(given)
    if (
        file.name == "command.json" and "parts" not in content
    ):  # of the first versions, which kept one command
        experiment = json.loads((file.parent / "experiment.json").read_text(encoding="utf-8"))
        content["parts"] = [{**content, "experiment": _renamed(experiment)}]
    if file.name != "experiment.json":
        content = {"format": FORMAT, **content} | {"format": FORMAT}
    if content != given:
        file.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
    return content != given


def _renamed(content: Any) -> Any:
    """Return the content of a JSON or YAML file with new keys and policies."""
    if isinstance(content, dict):
        content = {CONFIG_KEYS.get(key, key): _renamed(value) for key, value in content.items()}
        if isinstance(content.get("environment"), dict):
            content["environment"] = _converted_environment(content["environment"])
        return content
    if isinstance(content, list):
        return [_renamed(value) for value in content]
    if not isinstance(content, str):
        return content
    for old, new in POLICIES.items():
        content = new + content[len(old) :] if content == old or content.startswith(f"{old}, ") else content
    if content.startswith("smarts-bench "):  # a command that made the results
        for old, new in (*CONFIG_KEYS.items(), *POLICIES.items()):
            content = content.replace(old, new)
        for old, new in COMMANDS.items():
            content = re.sub(old, new, content)
    return content


def _converted_environment(section: dict[str, Any]) -> dict[str, Any]:
    """Return a section `environment` with the observation and the reward of its adapter."""
    name, options = section.get("adapter"), {**section.get("options", {})}
    if "options" not in section and (name is None or ":" in name):
        return section
    name = name or "benchmark"
    kept = {key: value for key, value in section.items() if key not in ("adapter", "options")}
    observation = options.pop("observation", name if ":" not in name else "benchmark")
    size, resolution = options.pop("image_size", 64), options.pop("image_resolution", 1.0)
    if name == "benchmark":
        if "reward" not in options and _base(observation) != "benchmark":
            options["reward"] = "benchmark"  # that of the adapter, whatever the observation
        if options.pop("image", False):
            is_default = (size, resolution) == (64, 1.0)
            image = "image" if is_default else {"image": {"size": size, "resolution": resolution}}
            observation = {"base": observation, "stacked": [image]}
    kept |= {"observation": observation, "reward": options.pop("reward", None)}
    if ":" in name:
        kept["adapter"] = name
    return {**kept, "adapter_options": options} if options else kept


def _base(observation: Any) -> Any:
    """Return the name of the observation that another one is based on."""
    while isinstance(observation, dict):
        observation = observation.get("base", "benchmark")
    return observation


def _convert_parquet(file: Path) -> bool:
    table = pq.read_table(file)
    metadata = dict(table.schema.metadata or {})
    if metadata.get(TABLE_FORMAT) == b"1":
        converted = _converted_results(table, metadata)
    elif (file.parent / "episode.parquet").exists() or (file.parent / "agents.parquet").exists():
        converted = _converted_episode(table, file.stem)
    else:
        return False
    if converted is None:
        return False
    file.unlink()
    target = file.with_stem(EPISODE_TABLES.get(file.stem, file.stem))
    pq.write_table(converted, target, compression="zstd")
    return True


def _converted_results(table: pa.Table, metadata: dict[bytes, bytes]) -> pa.Table:
    """Return a table of agent-episodes under new names."""
    for column, names in (("outcome", OUTCOMES), ("algorithm", POLICIES)):
        for old, new in names.items():
            number = table.column_names.index(column)
            values = [new if value == old else value for value in table[column].to_pylist()]
            table = table.set_column(number, column, pa.array(values, table.schema.field(column).type))
    frame = table.rename_columns([TABLE_COLUMNS.get(name, name) for name in table.column_names]).to_pandas(
        ignore_metadata=True
    )
    counts = json.loads(metadata[TABLE_COUNTS])
    counts = {OUTCOMES.get(name, name): count for name, count in counts.items()}
    own = {TABLE_FORMAT: str(FORMAT).encode(), TABLE_COUNTS: json.dumps(counts).encode()}
    arrow = pa.Table.from_pandas(frame, preserve_index=False)
    return arrow.replace_schema_metadata({**(arrow.schema.metadata or {}), **own})


def _converted_episode(table: pa.Table, name: str) -> pa.Table | None:
    """Return a table of a recorded episode under new names; None if it is of format 2."""
    if name == "episode":
        if table["version"][0].as_py() != 1:
            return None
        names = table.column_names
        table = table.set_column(names.index("version"), "version", pa.array([FORMAT], pa.int32()))
        # Not recorded in format 1.
        table = table.add_column(names.index("sumo_seed"), "traffic_engine", pa.array([""], pa.string()))
    return table.rename_columns([EPISODE_COLUMNS.get(column, column) for column in table.column_names])


def main() -> None:
    """Convert the folder that the command line names."""
    if len(sys.argv) != 3:
        sys.exit("usage: python results/convert_v1.py OLD NEW")
    try:
        convert(Path(sys.argv[1]), Path(sys.argv[2]))
    except SmartsError as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(error.exit_code)


if __name__ == "__main__":
    main()
