"""What a log says while an experiment runs: one line each, with names, and how it is ended."""

import io
import time
from types import SimpleNamespace

import pytest
from rich.console import Console

from benchmark.experiment.models import Budget, Evaluation, Resources
from benchmark.experiment.runs import Run, ScriptedRun
from benchmark.running import live
from benchmark.running.jobs import JobState
from benchmark.running.live import ASSUMED, LiveProgress, episodes_of, seconds_left
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
        shown.show([state], 2)
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
    assert total.endswith(", in 0 min")


def test_the_time_left_follows_budgets_then_what_jobs_of_the_same_name_took():
    """Two trainings of 3,000 agent-steps or a minute, with 28 episodes each; then a scripted policy."""
    task_setting = SimpleNamespace(
        evaluation=Evaluation(episodes=20, modes=("greedy",), validations=4, validation_episodes=2)
    )
    budget = Budget(agent_steps=3000, minutes=1)
    runs = [Run("ppo", task_setting, seed, {}, budget, Resources()) for seed in (1, 2)]  # type: ignore[arg-type]
    jobs = [*runs, ScriptedRun("parked", task_setting)]  # type: ignore[arg-type]
    states = [JobState(job, episodes=episodes_of(job, 0)) for job in jobs]
    steps, episodes = ASSUMED["training"], ASSUMED["testing"]
    whole = 3000 / steps + 28 / episodes
    assert seconds_left(states, 1) == pytest.approx(2 * whole + 20 / episodes)
    assert seconds_left(states, 8) == pytest.approx(whole)
    states[0].progress = RunProgress("training", 0.5, {"agent_steps": 1500, "seconds": 30.0})
    states[0].rates["training"] = 50.0  # the first has 30 s left, and the second the whole minute
    assert seconds_left(states[:2], 1) == pytest.approx(30 + 24 / episodes + 60 + 28 / episodes)
    states[0].status, states[0].rates["testing"] = "finished", 4.0
    states[2].progress = RunProgress("testing", 0.75)
    assert seconds_left(states, 1) == pytest.approx(60 + 28 / 4 + 5 / 4)
