"""Which way a report's marks, orders and pictures point: the good one is called good in every file."""

import re

import pytest
from matplotlib.colors import to_rgba

from benchmark.report.content import Report, TableCell, make_report
from benchmark.report.curves import SHOWN, draw_curves
from benchmark.report.episode_pages import Replays
from benchmark.report.html import report_page
from benchmark.report.latex import main_table
from benchmark.report.outcomes import draw_outcomes
from benchmark.report.protocol import protocol_of
from benchmark.report.robustness import robustness_of
from benchmark.report.style import OUTCOME_COLOURS, new_figure
from benchmark.report.summary import Summaries
from benchmark.report.wording import mark
from benchmark.results.reading import read_results
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
        page = report_page(report, Summaries({"completion": {}}), (), robustness_of(report), Replays())
        found = re.findall(r'paper (0\.\d+ / 0\.\d+) <span class="([\w-]+)"[^>]*>([\w -]*)</span>', page)
        assert set(found) == {
            ("0.1 / 0.07", "better", "better"),
            ("0.1 / 0.07", "worse", "worse"),
            ("0.83 / 0.2", "better", "better"),
        }


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
