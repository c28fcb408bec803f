"""Which way a report's marks, orders and pictures point: the good one is called good in every file."""

import re
from dataclasses import replace

import pandas as pd
import pytest
import yaml
from matplotlib.colors import to_rgba

from benchmark.report import wording
from benchmark.report.content import Report, TableCell, make_report
from benchmark.report.curves import SHOWN, draw_curves
from benchmark.report.html import report_page
from benchmark.report.latex import main_table
from benchmark.report.leaderboard import make_leaderboard
from benchmark.report.markdown import report_text
from benchmark.report.outcomes import draw_outcomes
from benchmark.report.protocol import protocol_of
from benchmark.report.provenance import circumstances
from benchmark.report.style import OUTCOME_COLOURS, new_figure
from benchmark.report.summary import Summaries
from benchmark.report.tables import difference_notes
from benchmark.report.values import by_key, measure_cells
from benchmark.report.wording import intervals, mark, pairs_notes
from benchmark.results.reading import read_results
from benchmark.results.run_folder import FINISHED, RunFolder
from tests.hand_made_results import (
    ALONE,
    ENVIRONMENT,
    agent_episodes,
    write_experiment,
    write_run,
    write_test,
)

EPISODES = 200
"""As many as a mark asks for."""
GOOD = [["goal", "goal"]] * EPISODES
BAD = [["collision", "collision"]] * EPISODES
MIXED = [["goal", "goal"], ["goal", "collision"]] * (EPISODES // 2)
"""3 of 4 arrive."""
PROGRESS = ([1, 500, 2.5, 200, -1.0, 0.0, 1.0, "", "", ""], [2, 1000, 5.0, 200, 1.0, 0.5, 0.5, "", "", ""])
"""200 agent-steps a second."""


@pytest.fixture(scope="module")
def report(tmp_path_factory) -> Report:
    """PPO arrives and DQN collides, both at the intersection; sampled, it is the other way round."""
    root = tmp_path_factory.mktemp("marks")
    write_experiment(root, algorithms=["ppo", "dqn"], seeds=[1, 2])
    for name, greedy, sampled in (("ppo", GOOD, BAD), ("dqn", MIXED, GOOD)):
        tables = [agent_episodes(greedy, mode="greedy"), agent_episodes(sampled, mode="sampled")]
        write_run(root, name, tables, progress=PROGRESS)
    # The second seed learns to collide.
    second = [[*line[:5], 0.0, 1.0, *line[7:]] for line in PROGRESS]
    write_run(root, "ppo", None, seed=2, progress=second)
    return make_report(read_results(root))


def cell_of(report: Report, algorithm: str, mode: str = "greedy") -> TableCell:
    return next(row.cells[0] for row in report.main_table(mode) if row.algorithm == algorithm)


class TestMarks:
    """The paper has 0.1 / 0.07 of PPO and 0.83 / 0.2 of DQN."""

    def test_which_are_better_than_the_paper(self, report):
        # 0.0 / 1.0 and 0.25 / 0.75, on 200 episodes.
        assert [mark(cell_of(report, name)) for name in ("ppo", "dqn")] == ["better", "better"]
        assert mark(cell_of(report, "ppo", "sampled")) == "worse"

    def test_the_stars_in_latex_are_theirs(self, report):
        # In brackets, since it is not known whether random driving passes: the cell does not count.
        assert r"{\small 0.1 / 0.07$^{(\ast\ast)}$}" in main_table(report, "greedy")
        sampled = main_table(report, "sampled")
        assert r"{\small 0.1 / 0.07}" in sampled
        assert r"{\small 0.83 / 0.2$^{(\ast\ast)}$}" in sampled

    def test_the_colour_on_the_page_is_theirs(self, report):
        page = report_page(report, Summaries({"completion": {}}), None)
        found = re.findall(r'paper (0\.\d+ / 0\.\d+) <span class="([\w-]+)"[^>]*>([\w -]*)</span>', page)
        assert set(found) == {
            ("0.1 / 0.07", "better", "better"),
            ("0.1 / 0.07", "worse", "worse"),
            ("0.83 / 0.2", "better", "better"),
        }


def test_half_an_interval_is_none(report):
    cell = cell_of(report, "ppo")
    assert cell.collision
    assert cell.completion
    unknown = float("nan")
    for name in ("collision", "completion"):
        value = replace(getattr(cell, name), low=unknown, high=unknown)
        assert intervals(replace(cell, **{name: value})) == "no interval"
    assert intervals(cell).count("[") == 2


def test_outcomes_are_those_of_the_main_mode(report):
    axes = new_figure(3, 3).add_subplot()
    draw_outcomes(axes, report, "intersection", ALONE)
    names = [name for name, _ in report.names]
    bars = dict(zip(("completion_rate", "collision_rate"), axes.containers, strict=True))
    for outcome, shares in (
        ("completion_rate", {"ppo": 1.0, "dqn": 0.75}),
        ("collision_rate", {"ppo": 0.0, "dqn": 0.25}),
    ):
        drawn = {name: bar.get_width() for name, bar in zip(names, bars[outcome], strict=True)}
        assert drawn == pytest.approx(shares)
        assert bars[outcome][0].get_facecolor() == to_rgba(OUTCOME_COLOURS[outcome])


def test_a_learning_curve_is_the_mean_of_its_seeds_in_their_band(report):
    panels = new_figure(3, 5).subplots(len(SHOWN), 1)
    draw_curves(panels, report, "intersection", ALONE)
    completion = panels[SHOWN.index("completion")]
    line = {line.get_label(): line for line in completion.get_lines()}["PPO"]
    # From 0 to 0.5, and 0 all the time.
    assert (line.get_ydata()[0], line.get_ydata()[-1]) == (0.0, 0.25)
    box = completion.collections[0].get_paths()[0].get_extents()
    assert (box.ymin, box.ymax) == (0.0, 0.5)


def test_the_summary_begins_with_the_best(report):
    summaries = make_leaderboard([report.results.root]).summaries
    assert [(each.algorithm, each.completion) for each in summaries] == [("ppo", 1.0), ("dqn", 0.75)]


@pytest.mark.parametrize(
    ("changes", "is_same"),
    [
        ({}, True),
        (
            {"environment": ENVIRONMENT | {"action": "Lane", "vehicle_model": "bullet", "friction": None}},
            True,
        ),
        ({"environment": ENVIRONMENT | {"friction": 0.9}}, False),
        ({"budget": {"agent_steps": 2000, "minutes": None}}, False),
    ],
)
def test_results_of_other_environments_are_not_compared(tmp_path, changes, is_same):
    protocols = []
    for name, keys in (("one", {}), ("other", changes)):
        write_test(tmp_path / name, "ppo", GOOD[:2], **keys)
        results = read_results(tmp_path / name)
        protocols.append(protocol_of(results.finished[0], results))
    assert (protocols[0] == protocols[1]) == is_same


def test_a_run_without_its_table_is_not_finished(tmp_path):
    tested = {"episodes": 2}
    folder = RunFolder(write_test(tmp_path, "ppo", GOOD[:2]))
    folder.note(status=FINISHED, tested=tested)
    assert folder.is_finished(tested)
    folder.checkpoint.mkdir()
    assert not folder.is_finished({"episodes": 3})
    folder.table.unlink()
    assert not folder.is_finished(tested)


def test_all_files_say_what_the_words_mean_and_count_ties_in_each_mode(report):
    bound = "the paper's by Wilson's at 20 trials (40 agent-episodes / a design effect of 2)"
    assert f"% {wording.BOLD}" in main_table(report, "greedy")
    for text in (
        report_page(report, Summaries({"completion": {}}), None).replace("&#39;", "'"),
        report_text(report, Summaries({"completion": {}}), ()),
        main_table(report, "greedy"),
    ):
        assert bound in text
    notes = [note for note in difference_notes(report) if "are decided" in note]
    for mode, note in zip(report.modes, notes, strict=True):
        decided = int((report.differences[mode]["wins"] != "").sum())
        assert note.startswith(f"{mode.capitalize()}: {decided} differences are decided")
        assert "of them with training seeds as the unit 0 of the 0 that have one;" in note
    assert len(notes) == 2


def test_the_differences_that_training_seeds_decide_are_counted(tmp_path):
    """PPO completes 1, 1 and 0.95, DQN 0, 0 and 0.05: t = 0.967 / sqrt(2 x 0.05^2 / 9) is 41 at 4 degrees."""
    write_experiment(tmp_path, algorithms=["ppo", "dqn"], seeds=[1, 2, 3])
    goals = {"ppo": (20, 20, 19), "dqn": (0, 0, 1)}
    for name, counts in goals.items():
        for seed, count in enumerate(counts, start=1):
            outcomes = [["goal"]] * count + [["collision"]] * (20 - count)
            write_test(tmp_path, name, outcomes, seed=seed)
    (said,) = difference_notes(make_report(read_results(tmp_path)))
    assert said.startswith(
        "Greedy: 2 differences are decided, of them with training seeds as the unit 2 of the 2 that have one;"
    )


def test_episodes_that_begin_alike_count_together_and_the_remedy_is_named():
    notes = ["", "2 episodes played by one only, 9 episodes with the start of another"]
    notes += ["9 episodes with the start of another"]
    together, left_out = pairs_notes(notes)
    assert together.startswith("9 episodes begin as another does, and count together with it")
    assert "start_variation" in together
    assert left_out == "left out: 2 episodes played by one only"


@pytest.mark.parametrize(
    ("seeds", "label", "said"),
    [
        ([1], "this checkpoint", "1 seed, 4 episodes; this checkpoint"),
        ([1, 2], "these checkpoints", "2 seeds, 8 episodes; these checkpoints"),
        ([1, 2, 3], "3 training seeds", "3 seeds, 12 episodes"),
    ],
)
def test_tables_and_pages_say_alike_what_intervals_cover(seeds, label, said):
    parts = [
        agent_episodes(
            GOOD[:4],
            mode="greedy",
            algorithm="ppo",
            task="intersection",
            task_traffic=ALONE,
            training_seed=seed,
        )
        for seed in seeds
    ]
    rows = measure_cells(pd.concat(parts, ignore_index=True), ["completion_rate"])
    assert [*rows["label"]] == [label]
    (value,) = by_key(rows).values()
    cell = TableCell("intersection", ALONE, value, value, (), None, (), "", None, False)
    assert wording.count(cell) == said


def test_the_circumstances_of_runs_are_told(tmp_path):
    for seed in (1, 2):
        folder = RunFolder(write_test(tmp_path, "ppo", GOOD[:2], seed=seed))
    name = "Continued after an interruption, or tested again"
    assert name not in dict(circumstances(read_results(tmp_path)))
    folder.note_continuation({"commit": "0123"})
    folder.note(commit="0123456789ab+")
    config = yaml.safe_load(folder.config.read_text())
    own = {"imports": ["/home/a/mine.py", "/home/a/more"], "own_code": {"mine:Reward": "0123"}}
    folder.config.write_text(yaml.safe_dump({**config, **own}))
    found = dict(circumstances(read_results(tmp_path)))
    assert found[name] == ["PPO in 1 of 2 runs"]
    assert "0123456789ab+" in found["Commit (+: with changes that were not committed)"]
    assert found["Own code"] == ["/home/a/mine.py, /home/a/more"]
    assert found["Digests of own code"] == ["mine:Reward 0123"]
