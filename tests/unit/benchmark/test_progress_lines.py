"""What a log says while an experiment runs: one line each, with names, and how it is ended."""

import io
import time
from dataclasses import replace

from rich.console import Console

from benchmark.running import live
from benchmark.running.jobs import JobState
from benchmark.running.live import LiveProgress
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

    training = RunProgress("training", 0.5, 6, 1500, 60.0, 867.4, 1.41, 0.75, 0.25)
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
    assert lines("training", replace(training, iteration=7)) == [expected.replace("6", "7", 1)]
    assert lines("testing", RunProgress("testing", 0.25)) == [f"{NAME}: testing 25%"]
    assert lines("failed", error="[red] no") == [f"{NAME}: failed: [red] no"]
