"""The conversion of results of format 1, on an example made by hand."""

import importlib.util
import json
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import yaml

from benchmark.experiment.environment import Environment
from benchmark.experiment.runs import with_defaults
from benchmark.metrics import compute
from benchmark.results.files import FormatError, ResultsError
from benchmark.results.reading import read_results
from benchmark.results.run_folder import RunFolder
from benchmark.running.evaluate_checkpoint import evaluate_checkpoint
from smarts.config import fitted
from smarts.errors import RecordError, SmartsError
from smarts.sim.episode_files import RecordedEpisode
from tests.hand_made_results import agent_episodes, write_experiment, write_run
from tests.recordings import Drive, at_speed, crossroads, record

ROOT = Path(__file__).parents[3]
OLD_COLUMNS = {
    "agent_id": "seat",
    "partner_agent_id": "partner_seat",
    "distance_travelled": "travelled",
    "route_progress": "route_done",
    "action_mask": "legal",
    "arrival_number": "ticket",
    "traffic_seed": "sumo_seed",
    "is_invalid": "is_void",
}
OUTCOMES = [["goal", "collision"], ["invalid", "invalid"], ["goal", "goal"]]


ENVIRONMENTS = [
    ({"agents": 4, "adapter": "benchmark", "options": {}}, {"agents": 4}),
    ({"adapter": "paper"}, {"observation": "paper"}),
    ({"adapter": "raw", "options": {"reward": "paper"}}, {"observation": "raw", "reward": "paper"}),
    (
        {"options": {"reward": {"goal": 1.0}, "image": True}},
        {"observation": {"base": "benchmark", "stacked": ["image"]}, "reward": {"goal": 1.0}},
    ),
    (
        {"options": {"image": True, "image_size": 32}},
        {
            "observation": {
                "base": "benchmark",
                "stacked": [{"image": {"size": 32, "resolution": 1.0}}],
            }
        },
    ),
    (
        {"options": {"observation": {"base": "paper", "frames": 1}}},
        {"observation": {"base": "paper", "frames": 1}, "reward": "benchmark"},
    ),
    (
        {"adapter": "m:Own", "options": {"factor": 2}},
        {"adapter": "m:Own", "adapter_options": {"factor": 2}},
    ),
    ({"adapter": "m:Own"}, {"adapter": "m:Own"}),
    ({"observation": "raw", "adapter": None}, {"observation": "raw"}),
]
"""`environment` of an old config, and the values of today that are not defaults."""


def load_script():
    spec = importlib.util.spec_from_file_location("convert_v1", ROOT / "results" / "convert_v1.py")
    assert spec
    assert spec.loader
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


convert = load_script().convert


def age_table(file):
    """Turn a table of agent-episodes into one of format 1."""
    table = pq.read_table(file)
    frame = table.to_pandas().rename(columns={"is_invalid": "is_void", "distance_travelled": "travelled"})
    frame["outcome"] = frame["outcome"].replace("invalid", "void")
    frame["algorithm"] = frame["algorithm"].replace("gap_acceptance", "yielder")
    counts = json.loads(table.schema.metadata[b"smarts_bench.metrics.episodes"])
    counts["void"] = counts.pop("invalid")
    own = {
        b"smarts_bench.metrics.format": b"1",
        b"smarts_bench.metrics.episodes": json.dumps(counts).encode(),
    }
    arrow = pa.Table.from_pandas(frame, preserve_index=False)
    pq.write_table(arrow.replace_schema_metadata({**arrow.schema.metadata, **own}), file)


def age_json(file, **changes):
    content = json.loads(file.read_text()) | changes
    content.pop("format", None)
    file.write_text(json.dumps(content))


@pytest.fixture
def folders(tmp_path):
    """Return an experiment of format 1 and the folder for its conversion."""
    root = tmp_path / "old"
    write_experiment(root, scripted=["gap_acceptance"])
    runs = [
        write_run(root, "ppo", [agent_episodes(OUTCOMES, mode="greedy", distance_travelled=7.5)]),
        write_run(root, "gap_acceptance", [agent_episodes(OUTCOMES, mode="scripted")], seed=-1),
    ]
    for run in runs:
        age_table(run / "episodes.parquet")
        age_json(run / "run.json")
    (runs[0] / "config.yaml").write_text("copies: 8\nsettings: {lr: 1.0e-3, longest_life: 500}\n")
    (runs[1] / "config.yaml").write_text("policy: yielder\n")
    (root / "scripted" / "gap_acceptance").rename(root / "scripted" / "yielder")
    (root / "scripted").rename(root / "reference")
    (part,) = json.loads((root / "command.json").read_text())["parts"]
    experiment = part["experiment"]
    del experiment["scripted"]
    experiment["reference"] = ["yielder"]
    (root / "experiment.json").write_text(json.dumps(experiment))
    line = "smarts-bench run x.yaml --set 'reference=[yielder]'"
    (root / "command.json").write_text(json.dumps({"command": line}))
    return root, tmp_path / "new"


def test_converted_results_are_read_and_numbers_stay(folders):
    old, new = folders
    convert(old, new)
    results = read_results(new)
    assert not results.problems
    assert [(run.algorithm, run.status) for run in results.runs] == [
        ("ppo", "finished"),
        ("gap_acceptance", "finished"),
    ]
    assert results.commands == ("smarts-bench run x.yaml --set 'scripted=[gap_acceptance]'",)
    assert (results.counts["measured"], results.counts["invalid"]) == (4, 2)
    table = results.runs[0].table
    assert table["outcome"].tolist() == [each for ends in OUTCOMES for each in ends]
    assert table["is_invalid"].tolist() == [False, False, True, True, False, False]
    assert (table["distance_travelled"] == 7.5).all()
    rates = compute(table, ["algorithm"], ["collision_rate", "completion_rate"])["value"]
    assert rates.tolist() == [0.25, 0.75]
    config = yaml.safe_load(
        (new / "scripted/gap_acceptance/intersection/no_social_vehicles/config.yaml").read_text()
    )
    assert config == {"policy": "gap_acceptance"}
    config = yaml.safe_load((new / "ppo/intersection/no_social_vehicles/seed_1/config.yaml").read_text())
    assert config == {"num_envs_per_env_runner": 8, "settings": {"lr": 0.001, "longest_trajectory": 500}}
    assert (old / "reference" / "yielder").is_dir()


def test_results_of_format_1_are_refused_by_name_of_the_script(folders):
    old, _ = folders
    run = old / "ppo/intersection/no_social_vehicles/seed_1"
    for read in (
        lambda: read_results(old),
        lambda: RunFolder(run).check({}),
        lambda: RunFolder(run).is_finished({}),
        lambda: evaluate_checkpoint(run),
    ):
        with pytest.raises(FormatError) as caught:
            read()
        assert "results/convert_v1.py" in caught.value.remedy
        assert issubclass(FormatError, ResultsError)


@pytest.mark.parametrize("what", ["missing", "there already", "of format 2"])
def test_what_cannot_be_converted_is_named_and_nothing_is_written(folders, what):
    old, new = folders
    if what == "missing":
        old = old / "nowhere"
    elif what == "there already":
        new.mkdir()
    else:
        convert(old, new)
        old, new = new, new.with_name("newer")
    with pytest.raises(SmartsError) as caught:
        convert(old, new)
    assert caught.value.place == str(new if what == "there already" else old)
    assert not new.exists() or not any(new.iterdir())


@pytest.mark.parametrize(("old", "expected"), ENVIRONMENTS)
def test_runs_with_old_keys_of_the_environment_are_recognised(tmp_path, old, expected):
    folder = tmp_path / "old" / "seed_1"
    folder.mkdir(parents=True)
    command = "smarts-bench run x.yaml --set environment.adapter=paper --set environment.options.reward=raw"
    (folder / "run.json").write_text(json.dumps({"command": command}))
    (folder / "config.yaml").write_text(yaml.safe_dump({"seed": 1, "environment": old}))
    convert(tmp_path / "old", tmp_path / "new")
    converted = yaml.safe_load((tmp_path / "new" / "seed_1" / "config.yaml").read_text())
    assert with_defaults(converted) == with_defaults({"seed": 1, "environment": expected})
    assert fitted(converted["environment"], Environment) == fitted(expected, Environment)
    said = json.loads((tmp_path / "new" / "seed_1" / "run.json").read_text())["command"]
    assert said.endswith("--set environment.observation=paper --set environment.reward=raw")


def test_recorded_episodes_are_converted(tmp_path):
    graph = crossroads()
    lanes = [graph.lane_ids[0]]
    episode = record(tmp_path / "old", graph, [Drive(lanes, at_speed(5.0, 10), agent="agent_0")])
    before = {path.stem: pd.read_parquet(path) for path in sorted(episode.iterdir())}
    for name, frame in before.items():
        aged = frame.rename(columns=OLD_COLUMNS)
        if name == "episode":
            aged = aged.drop(columns="traffic_engine").assign(version=np.int32(1))
        aged = aged.drop(columns=["interface", "release_step"], errors="ignore")
        (episode / f"{name}.parquet").unlink()
        name = {"agent_states": "seats"}.get(name, name)
        pq.write_table(pa.Table.from_pandas(aged, preserve_index=False), episode / f"{name}.parquet")
    with pytest.raises(RecordError) as caught:
        RecordedEpisode(episode)
    assert "convert_v1.py" in caught.value.remedy
    convert(tmp_path / "old", tmp_path / "new")
    converted = RecordedEpisode(tmp_path / "new" / episode.name)
    assert converted.facts["traffic_engine"] == ""
    assert converted.facts["version"] == 2
    for name, frame in before.items():
        table = converted.table(name)
        assert {*table} == {*frame}
        for column in set(frame) - {"traffic_engine", "version"}:
            pairs = zip(table[column], frame[column], strict=True)
            assert all(np.array_equal(*pair) for pair in pairs), column
