"""Every script in `perf/` runs with minimal settings."""

import importlib
import subprocess
import sys

import pytest

from tests.blocks import ROOT

SCRIPTS = {file.stem for file in (ROOT / "perf").glob("*.py") if "__main__" in file.read_text()}
SMALLEST = {
    "dict_api": [str(ROOT), str(ROOT), "--blocks", "1", "--steps", "2"],
    "environment": ["--worlds", "1", "--decisions", "20"],
    "games": ["--games", "pg promise", "--seeds", "1"],
    "hosts": ["--rounds", "20", "--steps", "10"],
    "handovers": [
        "--handovers",
        "4",
        "--scenarios",
        "intersection",
        "--models",
        "kinematic",
    ],
    "memory": ["--scenarios", "loop", "--episodes", "200", "--steps", "1"],
    "native": ["--scenarios", "two_way_v1", "--seeds", "2", "--seconds", "20"],
    "same_episodes": [str(ROOT), str(ROOT), "--scenarios", "loop", "--apis", "vector", "--steps", "5"],
    "step": ["--scenarios", "loop", "--worlds", "1", "--decisions", "40"],
    "size": [],
}
"""Arguments of the scripts that run in the tests' process."""
OFTEN = ("step",)
"""Those that run in `make test`, too; `same_episodes` has a test of its own."""
IN_OWN_PROCESS = {
    "envision": ["--seconds", "2"],
    "joint": ["--seconds", "0.01"],
    "training": [
        *("--algorithms", "ppo", "--scenario", "two_way", "--seconds", "0.01"),
        *("--set", "settings.ppo.rollout_fragment_length=32"),
    ],
}
"""Arguments of scripts that start Ray, other processes or a browser."""
ELSEWHERE = {
    "gpu_learner",
    "imitation",
    "native_film",
    "real_maps",
    "recorded",
    "recorded_brakes",
    "recorded_bubbles",
    "yardsticks",
}
"""Scripts that take minutes, have their own tests, or draw a picture of a page."""


def test_every_script_is_tested():
    assert {*SMALLEST, *IN_OWN_PROCESS, *ELSEWHERE} == SCRIPTS


def marked(script):
    return script if script in OFTEN else pytest.param(script, marks=pytest.mark.nightly)


@pytest.mark.parametrize("script", [marked(script) for script in SMALLEST])
def test_script(script, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", [script, *SMALLEST[script]])
    try:
        code = importlib.import_module(f"perf.{script}").main()
    except SystemExit as ended:
        code = ended.code
    assert not code
    assert capsys.readouterr().out.strip()


@pytest.mark.nightly
@pytest.mark.parametrize("script", IN_OWN_PROCESS)
def test_script_in_its_own_process(script):
    command = [sys.executable, "-m", f"perf.{script}", *IN_OWN_PROCESS[script]]
    ended = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert ended.returncode == 0, ended.stderr[-3000:]
    assert ended.stdout.strip()


def test_gpu_learner_says_that_there_is_no_gpu(monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["gpu_learner"])
    monkeypatch.setattr("torch.cuda.is_available", lambda: False)
    with pytest.raises(SystemExit) as ended:
        importlib.import_module("perf.gpu_learner").main()
    assert ended.value.code == 2
    assert "finds no GPU" in capsys.readouterr().err


@pytest.mark.parametrize("script", sorted(ELSEWHERE))
def test_script_imports(script):
    assert importlib.import_module(f"perf.{script}").main
