"""A process leaves no child processes and no files except complete episodes, however it ends."""

import os
import signal
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest

from smarts.sim.episode_files import PARTIAL, EpisodeStore, RecordedEpisode, episodes_in
from smarts.sstudio.build import build_scenario

PLAY = """
    import os, signal, sys
    from pathlib import Path
    import numpy as np
    from smarts.agents import AgentInterface, AgentSpec, AgentType
    from smarts import env as apis
    from smarts.agents.benchmark import benchmark_interface
    from smarts.sim.assembly import Options

    api, end, record = sys.argv[1:]
    options = Options(record=Path(record))
    agents = {"a": AgentSpec(benchmark_interface().replace(max_episode_steps=20))}
    if api == "vector":
        env = apis.VectorHiWayEnv(2, ["two_way"], agents, simulation=options)
        act = [np.zeros((2, 1), int)]
    else:
        env = apis.RLlibHiWayEnv({"scenarios": ["two_way"], "agent_specs": agents, "simulation": options})
        act = {"a": 0}
    for episode in range(2):
        env.reset()
        for _ in range(6 if api == "vector" else 3):
            env.step(act)
    if end == "kill":
        os.kill(os.getpid(), signal.SIGKILL)
    if end == "exception":
        raise ZeroDivisionError
    if end == "close":
        env.close()
"""
ENDS = {"close": 0, "exception": 1, "kill": -signal.SIGKILL}


def play(api, end, folder):
    """Play in a process with its own folders; return its exit code, id and error output."""
    for name in ("temporary", "working", "cache", "home"):
        (folder / name).mkdir(parents=True, exist_ok=True)
    environment = {
        **os.environ,
        "TMPDIR": str(folder / "temporary"),
        "XDG_CACHE_HOME": str(folder / "cache"),
        "HOME": str(folder / "home"),
        "PYTHONPATH": str(Path(__file__).parents[2]),
    }
    process = subprocess.Popen(
        [sys.executable, "-c", textwrap.dedent(PLAY), api, end, str(folder / "record")],
        cwd=folder / "working",
        env=environment,
        start_new_session=True,
        stderr=subprocess.PIPE,
    )
    assert process.stderr is not None
    errors = process.stderr.read().decode()
    return process.wait(), process.pid, errors


def processes_of(session):
    """Return the remaining processes of a session."""
    found = []
    for process in Path("/proc").iterdir():
        if process.name.isdigit():
            try:
                fields = (process / "stat").read_text().rpartition(")")[2].split()
            except (FileNotFoundError, ProcessLookupError):
                continue
            if int(fields[3]) == session:
                found.append(process.name)
    return found


def files_below(folder):
    return sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*") if not path.is_dir())


@pytest.mark.parametrize(
    ("api", "end"),
    [
        ("vector", "close"),
        ("vector", "kill"),
        pytest.param("vector", "exception", marks=pytest.mark.nightly),
        pytest.param("rllib", "kill", marks=pytest.mark.nightly),
    ],
)
def test_only_complete_episodes_are_left(tmp_path, api, end):
    build_scenario("two_way")  # beforehand, so that its files are not counted
    code, session, errors = play(api, end, tmp_path)
    assert code == ENDS[end], errors
    assert processes_of(session) == []
    for name in ("temporary", "working", "home", "cache"):
        assert files_below(tmp_path / name) == []
    for folder in episodes_in(tmp_path / "record"):
        assert RecordedEpisode(folder).facts["steps"] > 0
    hidden = [path.name for path in (tmp_path / "record").glob(".*")]
    if end == "close":
        assert len(episodes_in(tmp_path / "record")) >= 2
        assert hidden == []
    # Hidden folders belong to ended processes; the next recorder removes them.
    assert all(name.startswith(PARTIAL) for name in hidden)
    EpisodeStore(tmp_path / "record")
    assert list((tmp_path / "record").glob(".*")) == []
