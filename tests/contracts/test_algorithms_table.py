"""The table of all algorithms is what its command writes, and its parts are read as they are meant."""

import pandas as pd

from algorithms.registry import ALGORITHMS
from benchmark.experiment.config import read_experiment
from benchmark.experiment.runs import runs_of
from benchmark.results.progress import COLUMNS
from perf import algorithms_table as table
from tests.blocks import ROOT


def test_the_committed_table_is_what_the_command_writes():
    assert table.TABLE.read_text() == table.page()


def test_every_algorithm_has_a_line_with_checks():
    lines = [line for line in table.page().splitlines() if line.startswith("| [`")]
    assert len(lines) == len(ALGORITHMS)
    assert all(int(line.split(" | ")[3]) >= 1 for line in lines)


def test_own_games_show_the_failing_score_where_a_line_names_no_other():
    failing = {"cues": "0", "recall": "0.5"}
    assert table.own_games("cues, 6,000 steps: -1.000; recall with `gru`, 3,200: 0.9.", failing) == (
        "cues -1.000 (0); recall with `gru` 0.9 (0.5)"
    )
    assert table.own_games("cues, 40 steps: 0.8; `ppo` 0.1.", failing) == "cues 0.8 (`ppo` 0.1)"


def write_curve(root, traffic, seed, *rows):
    folder = root / "ppo" / "intersection" / traffic / f"seed_{seed}"
    folder.mkdir(parents=True)
    lines = pd.DataFrame(rows, columns=["iteration", "agent_steps", "completion", "collision"])
    lines.reindex(columns=[*COLUMNS]).assign(seconds=0).to_csv(folder / "progress.csv", index=False)


def end_of(root):
    return table.intersection(table.curves_in(root), "ppo")


def test_the_end_of_a_curve_is_its_last_row_with_finished_episodes(tmp_path):
    write_curve(
        tmp_path,
        "no_social_vehicles",
        1,
        (1, 500, 0.25, 0.5),
        (2, 200000, 0.75, 0.125),
        (3, 300000, None, None),
    )
    assert end_of(tmp_path) == "0.75 / 0.12 (1 seed, 0.2M)"


def test_the_end_of_curves_is_their_mean_over_all_seeds_without_traffic(tmp_path):
    assert end_of(tmp_path) == ""
    write_curve(tmp_path, "random_social_vehicles", 1, (1, 1000000, 0.1, 0.9))
    assert end_of(tmp_path) == ""
    write_curve(tmp_path, "no_social_vehicles", 1, (1, 1000000, 0.9, 0.1))
    write_curve(tmp_path, "no_social_vehicles", 2, (1, 1000000, 0.5, 0.3))
    assert end_of(tmp_path) == "0.70 / 0.20 (2 seeds, 1M)"


def test_the_experiment_trains_every_algorithm():
    runs = runs_of(read_experiment(ROOT / "configs" / "all_algorithms.yaml", []))
    assert sorted(run.algorithm for run in runs) == sorted(ALGORITHMS)


def test_the_experiment_sets_nothing_by_hand_but_which_networks_are_shared():
    for run in runs_of(read_experiment(ROOT / "configs" / "all_algorithms.yaml", [])):
        own_networks = run.algorithm in ("happo", "networked_q")
        assert run.settings == {"sharing": "none" if own_networks else "all"}
