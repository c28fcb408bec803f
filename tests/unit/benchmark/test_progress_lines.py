"""What a log says while an experiment runs: one line each, with names, and how it is ended."""

import io
import time

import pytest
from rich.console import Console

from benchmark.experiment.models import Budget, Evaluation, Experiment, Resources
from benchmark.experiment.runs import Run, runs_of
from benchmark.running import live
from benchmark.running.jobs import JobState
from benchmark.running.live import LiveProgress, share_done
from benchmark.running.messages import RunProgress

NAME = "ppo, two_way, no_social_vehicles, seed 1"


def test_a_log_has_one_line_for_each_change_and_names_its_numbers(monkeypatch):
    log = io.StringIO()
    shown = LiveProgress(Console(file=log, width=40))
    state = JobState(NAME, heard=time.monotonic())  # type: ignore[arg-type] - of a job only its name is shown

    def lines(status, progress=None, error="", state=state):
        log.seek(0)
        log.truncate()
        state.status, state.progress, state.error = status, progress, error
        shown.show([state])
        return log.getvalue().splitlines()

    line = {"iteration": 6, "agent_steps": 1500, "seconds": 60.0, "agent_steps_per_second": 867}
    line |= {"return": 1.41, "completion": 0.75, "collision": 0.25}
    training = RunProgress("training", 0.5, line)
    assert lines("waiting") == []
    assert lines("starting") == [f"{NAME}: starting ({live.STARTS})"]
    third = JobState("a third", iteration=12)  # type: ignore[arg-type]
    assert lines("starting", state=third) == ["a third: starting, continues after iteration 12"]
    expected = (
        f"{NAME}: training 50%, iteration 6, 867 agent-steps/s, return 1.41, completion 0.75, "
        "collision 0.25, 1.0 min of training left"
    )
    assert lines("training", training) == [expected]
    assert lines("training", training) == []
    monkeypatch.setattr(live, "SECONDS", 0.0)
    assert lines("training", training) == []  # nothing is new
    assert lines("training", RunProgress("training", 0.5, line | {"iteration": 7})) == [
        expected.replace("6", "7", 1)
    ]
    assert lines("testing", RunProgress("testing", 0.25)) == [f"{NAME}: testing 25%"]
    monkeypatch.setattr(live, "TOTAL_SECONDS", -1.0)
    failed, total = lines("failed", error="[red] no")
    assert failed == f"{NAME}: failed: [red] no"
    assert total.startswith("0 of 1 runs finished after 0 min; ends about ")


def test_a_plan_counts_test_episodes_and_says_when_all_will_end():
    """On a usual machine two minutes of training and one of 150 test episodes, twice one after the other."""
    experiment = Experiment(
        name="own",
        algorithms=["ppo"],  # pyright: ignore
        tasks=["loop"],  # pyright: ignore
        traffic=["no_social_vehicles"],  # pyright: ignore
        seeds=[1, 2],  # pyright: ignore
        budget=Budget(agent_steps=300_000),
        evaluation=Evaluation(episodes=150, modes=("greedy",), validations=0, held_out_episodes=0),
        scripted=[],  # pyright: ignore
    )
    text = live.plan([JobState(run) for run in runs_of(experiment)], 1)
    wanted = "plan: 2 trainings in 1 task, each of 300,000 agent-steps, 300 test episodes, 1 at a time; ends"
    assert text.startswith(wanted)
    assert text.endswith(", in 6 min")


def test_the_time_left_follows_what_is_done_since_the_beginning(monkeypatch):
    """One of three jobs was finished before; two others have done half of their training in a minute."""
    runs = [Run("ppo", NAME, seed, {}, Budget(), Resources()) for seed in (1, 2, 3)]  # type: ignore[arg-type]
    states = [JobState(run) for run in runs]
    states[0].status = "finished"
    shown, now = LiveProgress(Console(file=io.StringIO())), time.monotonic()
    shown.show(states)
    assert shown._total(states).endswith("runs finished after 0 min")
    states[1].status, states[1].progress = "training", RunProgress("training", 0.01)
    assert shown._total(states).endswith("runs finished after 0 min")  # too early to say
    for state in states[1:]:
        state.status, state.progress = "training", RunProgress("training", 0.5)
    assert share_done(states) == pytest.approx((1 + 0.45 + 0.45) / 3)
    monkeypatch.setattr(live.time, "monotonic", lambda: now + 60)
    assert shown._total(states).endswith(f", in {1.1 / 0.9:.0f} min")
    resumed = LiveProgress(Console(file=io.StringIO()))
    resumed._first = 0.62
    monkeypatch.setattr(live.time, "monotonic", lambda: now + 120)
    assert ", in " in resumed._total(states)  # of a third of what was left
    states[1].progress, states[2].error = RunProgress("testing", 0.5), "no"
    states[2].status = "failed"
    assert share_done(states) == pytest.approx((1 + 0.95 + 1) / 3)
