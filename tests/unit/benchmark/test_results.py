"""The table of agent-episodes, and what is computed from it."""

import math

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from benchmark.metrics import (
    METRICS,
    compute,
    join_tables,
    measure_episodes,
    read_table,
    write_table,
)
from benchmark.metrics.results import THIS_CHECKPOINT
from smarts.errors import RecordError
from smarts.types.events import Outcome
from tests.raising import raises
from tests.recordings import Drive, at_speed, record, straight

ROAD = straight(lanes=2, length=200.0)


def play(folder, number, outcomes, begin=0.0, **facts):
    """Record an episode whose agents end as told."""
    drives = [
        Drive(["road_0"], at_speed(5.0, 20, begin + 20.0 * place), agent=f"a{place}", outcome=outcome)
        for place, outcome in enumerate(outcomes)
    ]
    return record(folder, ROAD, drives, name=f"e{number}", episode=number, **facts)


@pytest.fixture
def store(tmp_path):
    """Two episodes that count, one invalid, one cut short, one damaged."""
    folder = tmp_path / "store"
    play(folder, 0, [Outcome.GOAL, Outcome.COLLISION], scenario="hand_made@dense")
    play(folder, 1, [Outcome.GOAL, Outcome.GOAL], begin=1.0, scenario="hand_made@dense")
    play(folder, 2, [Outcome.INVALID, Outcome.INVALID], begin=2.0, is_invalid=True)
    play(folder, 3, [Outcome.NONE, Outcome.NONE], begin=3.0, is_complete=False)
    damaged = play(folder, 4, [Outcome.GOAL, Outcome.GOAL], begin=4.0)
    vehicles = damaged / "vehicles.parquet"
    vehicles.write_bytes(vehicles.read_bytes()[:100])
    return folder


def test_a_row_for_each_agent_episode(store):
    table = measure_episodes(store, labels={"algorithm": "ppo"})
    counts = table.attrs["episodes"]
    assert (counts["measured"], counts["invalid"], counts["incomplete"]) == (2, 1, 1)
    assert [*counts["corrupted"]] == ["e4"]
    assert "vehicles" in counts["corrupted"]["e4"]
    assert table["outcome"].tolist() == ["goal", "collision", "goal", "goal", "invalid", "invalid"]
    assert table["variation"].tolist() == ["dense"] * 4 + [""] * 2
    assert set(table["algorithm"]) == {"ppo"}
    assert table["agents"].tolist() == [1, 1, 1, 1, 0, 0]
    assert table.loc[table["is_invalid"], "collisions"].isna().all()


def change(file, column, value):
    """Put a value into all rows of a column of a recorded table."""
    table = pq.read_table(file)
    number = table.schema.get_field_index(column)
    kind = table.schema.field(number)
    values = pa.array([value] * len(table), kind.type)
    pq.write_table(
        table.set_column(number, kind, values).replace_schema_metadata(table.schema.metadata), file
    )


@pytest.mark.parametrize(
    ("table", "column", "value", "said"),
    [
        ("agents", "outcome", 99, "not a whole episode: ValueError: 99 is not a valid Outcome"),
        ("vehicles", "length", math.nan, "column 'length' is not finite"),
    ],
)
def test_an_episode_whose_numbers_cannot_be_is_named_and_the_others_count(
    tmp_path, table, column, value, said
):
    play(tmp_path, 0, [Outcome.GOAL])
    change(play(tmp_path, 1, [Outcome.GOAL]) / f"{table}.parquet", column, value)
    found = measure_episodes(tmp_path)
    counts = found.attrs["episodes"]
    assert found["episode"].tolist() == [0]
    assert counts["measured"] == 1
    assert said in counts["corrupted"]["e1"]


def test_the_file_gives_the_table_back_or_is_refused(store, tmp_path):
    table = measure_episodes(store)
    file = tmp_path / "results" / "episodes.parquet"
    write_table(table, file)
    again = read_table(file)
    pd.testing.assert_frame_equal(again, table)
    assert again.attrs == table.attrs
    assert [path.name for path in file.parent.iterdir()] == [file.name]
    file.write_bytes(file.read_bytes()[:-50])
    with raises(RecordError, file):
        read_table(file)
    with raises(RecordError, "no.parquet"):
        write_table(table, tmp_path / "store" / "e0" / "agents.parquet" / "no.parquet")


def test_values_and_intervals_of_one_checkpoint(store):
    answer = compute(measure_episodes(store)).set_index("metric")
    collision = answer.loc["collision_rate"]
    assert collision["value"] == 0.25
    assert 0.0 <= collision["low"] < 0.25 < collision["high"] <= 1.0
    assert (collision["n"], collision["episodes"], collision["seeds"]) == (4, 2, 1)
    assert collision["label"] == THIS_CHECKPOINT
    assert math.isnan(answer.loc["cut_in_ratio", "value"])
    assert "no lane change" in answer.loc["cut_in_ratio", "note"]
    assert "post_encroachment_time" in answer.loc["safety", "note"]
    assert set(answer.index) == set(METRICS)


def test_groups_and_training_seeds(tmp_path):
    tables = []
    for seed, goals in enumerate((2, 3, 4)):
        folder = tmp_path / str(seed)
        for number in range(4):
            play(folder, number, [Outcome.GOAL if number < goals else Outcome.COLLISION], begin=float(number))
        tables.append(measure_episodes(folder, labels={"algorithm": "ppo", "training_seed": seed}))
    answer = compute(join_tables(tables), ["algorithm"], ["completion_rate", "progress_speed"])
    completion, speed = answer.to_dict("records")
    assert (completion["algorithm"], completion["seeds"]) == ("ppo", 3)
    assert completion["label"] == "3 training seeds"
    angles = np.arcsin(np.sqrt([0.5, 0.75, 1.0]))
    reach = 4.302653 * angles.std(ddof=1) / math.sqrt(3)
    assert completion["low"] == pytest.approx(math.sin(angles.mean() - reach) ** 2)
    assert completion["high"] == 1.0
    assert speed["value"] == pytest.approx(5.0)
