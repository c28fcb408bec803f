"""What a report's page says first: two sentences, the two rates, what to do next."""

import html
import math
import re

import numpy as np
import pytest

from benchmark.report import drawing, episode_pages, front
from benchmark.report.content import make_report
from benchmark.report.episode_pages import Replays
from benchmark.report.html import report_page
from benchmark.report.robustness import robustness_of
from benchmark.report.summary import summaries_of
from benchmark.results.reading import read_results
from smarts.envision import notable_episodes
from smarts.envision.episode_library import Entry, EpisodeLibrary
from smarts.errors import SmartsError
from tests.hand_made_results import ALONE, SOCIAL, agent_episodes, write_experiment, write_run, write_test

GOALS = [["goal", "goal"], ["goal", "collision"]] * 10
"""30 of 40 agents arrive, 10 collide."""
RISING = (0.1, 0.1, 0.1, 0.2, 0.2, 0.2, 0.3, 0.3, 0.4, 0.4)
"""Completion rates of the fewest lines of progress.csv from which a report tells a trend."""


def lines(*completion):
    """Return lines of progress.csv, 1000 agent-steps apart."""
    return [
        [number, 1000 * number, 10.0 * number, 100, 0.0, value, 0.1, "", "", ""]
        for number, value in enumerate(completion, start=1)
    ]


def trained(root, progress, name="ppo", outcomes=GOALS, **given):
    table = agent_episodes(outcomes, mode="greedy", task_traffic=given.get("traffic", ALONE))
    return write_run(root, name, [table], progress=progress, **given)


def texts(root, begin, end):
    """Return the texts between two tags of a report's page."""
    report = make_report(read_results(root))
    page = report_page(report, summaries_of(report), robustness_of(report), Replays())
    found = re.findall(f"{begin}(.*?){end}", page, re.DOTALL)
    return [" ".join(html.unescape(each).split()) for each in found]


def lead(root):
    """Return the first sentences of a report's page."""
    (text,) = texts(root, '<p class="lead">', "</p>")
    return text


@pytest.mark.parametrize(
    ("completion", "outlook"),
    [
        ((*RISING, 0.5), "It was still improving: train longer."),
        ((0.5,) * 6 + (0.5, 0.4, 0.4, 0.3), "It got worse towards the end of its training."),
        ((0.1,) + (0.7,) * 9, "It no longer improved: other settings may help more than time."),
        (RISING[:9], "The training was too short to tell whether it still improved."),
    ],
)
def test_the_first_sentences_say_who_drove_how_well_and_whether_to_train_longer(
    tmp_path, completion, outlook
):
    write_experiment(tmp_path, scripted=["random", "parked"])
    trained(tmp_path, lines(*completion))
    write_test(tmp_path, "random", [["goal", "collision", "time_out", "time_out"]] * 5)
    write_test(tmp_path, "parked", [["not_moving"]] * 5)
    assert lead(tmp_path) == f"PPO completed 0.75 and collided 0.25; random driving 0.25 and 0.25. {outlook}"


def test_a_policy_that_drives_well_need_not_be_trained_longer(tmp_path):
    write_experiment(tmp_path)
    trained(tmp_path, lines(*RISING), outcomes=[["goal", "goal"]] * 20)
    assert lead(tmp_path) == "PPO completed 1.00 and collided 0.00. Longer training has little left to gain."
    assert not any("budget" in command for command in texts(tmp_path, "<code>", "</code>"))


def test_of_several_the_one_that_completes_most_leads_and_rates_are_means_over_conditions(tmp_path):
    write_experiment(tmp_path, algorithms=["ppo", "dqn", "maac"], traffic=[ALONE, SOCIAL], seeds=[1, 2])
    rising, flat = lines(*RISING), lines(*[0.4] * 10)
    for seed in (1, 2):
        trained(tmp_path, rising, seed=seed)
        trained(tmp_path, flat, seed=seed, traffic=SOCIAL, outcomes=[["goal", "goal"]] * 20)
        trained(tmp_path, flat, "dqn", seed=seed)
        trained(tmp_path, flat, "dqn", seed=seed, traffic=SOCIAL)
    # Perfect, but in one condition only.
    trained(tmp_path, flat, "maac", outcomes=[["goal", "goal"]] * 20)
    report = make_report(read_results(tmp_path))
    rates = front.rates(report, summaries_of(report), front.leader(report))
    assert front.best_first(report) == ["ppo", "dqn", "maac"]
    assert (rates["completion"].value, rates["collision"].value) == pytest.approx((0.875, 0.125))
    # Seeds agree in each condition, so all resamples are alike.
    assert (rates["collision"].low, rates["collision"].high) == pytest.approx((0.125, 0.125))
    assert lead(tmp_path) == (
        "Over 2 conditions, PPO completed 0.88, the most of 2, and collided 0.12. "
        "1 of 5 trainings were still improving (PPO): train longer."
    )


def test_where_nothing_is_measured_the_page_says_so_and_what_to_do(tmp_path):
    write_experiment(tmp_path, seeds=[1, 2])
    write_run(tmp_path, "ppo", None, progress=lines(0.1, 0.2, 0.3))
    assert lead(tmp_path) == "No run is measured yet: 0 of 2 finished."
    assert texts(tmp_path, "<code>", "</code>")[:1] == ["smarts-bench run hand.yaml"]
    # The curve of a training that has not ended is there.
    assert texts(tmp_path, '<path class="mean', "/>")


def test_the_next_commands_train_on_with_the_budget_that_ended_the_training(tmp_path):
    write_experiment(tmp_path)
    folder = trained(tmp_path, lines(*RISING), budget={"agent_steps": 20_000, "minutes": 0.5})
    (folder / "episodes").mkdir()
    (folder / "checkpoint").mkdir()
    assert texts(tmp_path, "<code>", "</code>")[:4] == [
        "smarts-bench run hand.yaml --set budget.minutes=2.5",
        f"smarts-bench view {folder}",
        f"smarts-bench evaluate {folder} --traffic {SOCIAL} --mode greedy --episodes 20",
        "smarts-bench run hand.yaml --set 'algorithms=[ppo,dqn,maddpg]'",
    ]


def test_the_trend_is_said_of_the_algorithm_that_has_it_and_of_finished_runs(tmp_path):
    write_experiment(tmp_path, algorithms=["ppo", "dqn", "maac"])
    trained(tmp_path, lines(0.7, 0.8), outcomes=[["goal", "goal"], ["goal", "collision"]] * 5)
    trained(tmp_path, lines(*RISING), "dqn", outcomes=[["goal", "collision"]] * 10)
    write_run(tmp_path, "maac", None, progress=lines(*RISING))
    assert lead(tmp_path).endswith("DQN was still improving: train longer.")


def test_what_trainings_began_with_is_named(tmp_path):
    write_experiment(tmp_path)
    file = trained(tmp_path, ()) / "config.yaml"
    file.write_text(f"{file.read_text()}start_from: /results/town\n")
    sentence = "Intersection: trainings began with the weights of /results/town."
    assert sentence in texts(tmp_path, '<p class="soft">', "</p>")
    assert sentence in " ".join(texts(tmp_path, '<details id="runs">', "</details>"))


def test_an_episode_that_cannot_be_shown_is_left_out_alone(tmp_path, monkeypatch):
    write_experiment(tmp_path)
    (trained(tmp_path, ()) / "episodes").mkdir()
    library = EpisodeLibrary([])
    ends = {"good": {"goal": 2}, "bad": {"collision": 2}}
    library.entries = lambda: [
        Entry(id=name, label=name, run="", agents=2, outcomes=how, complete=True)
        for name, how in ends.items()
    ]
    monkeypatch.setattr(episode_pages, "_tested", lambda *_: library)

    def read_compact(path):
        if path == "bad":
            raise SmartsError("damaged")
        return b""

    library.path = lambda number: number
    monkeypatch.setattr(notable_episodes, "read_compact", read_compact)
    played = episode_pages.replays(read_results(tmp_path), "greedy", "ppo")
    assert (played.episodes, played.left_out) == ((("best", "good"),), ("bad: damaged",))
    report = make_report(read_results(tmp_path))
    page = report_page(report, summaries_of(report), robustness_of(report), played)
    assert "Left out: bad: damaged." in page


def test_a_line_has_a_gap_where_a_value_is_not_known():
    places = np.array([[0.0, 1.0], [2.0, math.nan], [4.0, 5.0], [6.0, 7.0]])
    assert drawing.path(places, 0) == "M0 1M4 5L6 7"
