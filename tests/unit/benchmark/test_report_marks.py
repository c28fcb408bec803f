"""Which way a report's marks, orders and pictures point: the good one is called good in every file."""

import re

import pytest

from benchmark.report import drawing
from benchmark.report.content import Report, TableCell, make_report
from benchmark.report.episode_pages import Replays
from benchmark.report.html import main_table, pictures, report_page
from benchmark.report.protocol import protocol_of
from benchmark.report.robustness import robustness_of
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
        page = report_page(report, Summaries({"completion": {}}), robustness_of(report), Replays())
        found = re.findall(r'paper (0\.\d+ / 0\.\d+) <span class="([\w-]+)"[^>]*>([\w -]*)</span>', page)
        assert set(found) == {
            ("0.1 / 0.07", "better", "better"),
            ("0.1 / 0.07", "worse", "worse"),
            ("0.83 / 0.2", "better", "better"),
        }


def test_outcomes_are_those_of_the_main_mode(report):
    picture = pictures(report, Summaries({"completion": {}}))["outcomes"]
    widths = {name: [] for name in ("completion_rate", "collision_rate")}
    for width, name in re.findall(r'width="([\d.]+)" height="20" fill="var\(--(\w+)\)"', picture):
        widths[name].append(float(width))
    dqn, ppo = (drawing.shares(report, name, "intersection", ALONE) for name in ("dqn", "ppo"))
    assert (dqn["completion_rate"], dqn["collision_rate"]) == (0.75, 0.25)
    assert (ppo["completion_rate"], ppo["collision_rate"]) == (1.0, 0.0)
    whole = max(widths["completion_rate"])
    assert sorted(widths["completion_rate"]) == pytest.approx([0.75 * whole, whole], abs=0.1)
    assert widths["collision_rate"] == pytest.approx([0.25 * whole], abs=0.1)


def test_a_learning_curve_is_the_mean_of_its_seeds_in_their_band(report):
    panel = drawing.curves(report, "intersection", ALONE, "completion")
    (curve,) = [curve for curve in panel.curves if curve[0].label == "PPO"]
    _, mean, seeds, band, _ = (places(text) if isinstance(text, str) else text for text in curve)
    # From 0 to 0.5, and 0 all the time; 0 is at the bottom of a square of 1000.
    assert (mean[0][1], mean[-1][1]) == (1000, 750)
    assert {y for _, y in (seeds[-1], seeds[len(seeds) // 2 - 1])} == {1000, 500}
    assert (min(y for _, y in band), max(y for _, y in band)) == (500, 1000)


def places(path):
    """Return the places of a path of SVG."""
    return [tuple(map(int, place)) for place in re.findall(r"[ML](-?\d+) (-?\d+)", path)]


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
