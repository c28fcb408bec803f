"""What a process leaves behind, however it ends: no child process, and no file but whole episodes."""

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
    from smarts import env as faces
    from smarts.agents.benchmark import benchmark_interface
    from smarts.sim.assembly import Options

    face, end, record = sys.argv[1:]
    options = Options(record=Path(record))
    agents = {"a": AgentSpec(benchmark_interface().replace(max_episode_steps=20))}
    if face == "vector":
        env = faces.VectorHiWayEnv(2, ["two_way"], agents, simulation=options)
        act = [np.zeros((2, 1), int)]
    elif face == "hiway":
        env = faces.HiWayEnv(["two_way"], agents, decision_interval=5, simulation=options)
        act = {"a": 0}
    elif face == "parallel":
        env = faces.hiway_parallel_env(["two_way"], agents, simulation=options)
        act = {"a": 0}
    else:
        env = faces.RLlibHiWayEnv({"scenarios": ["two_way"], "agent_specs": agents, "simulation": options})
        act = {"a": 0}
    for episode in range(2):
        env.reset()
        for _ in range(6 if face == "vector" else 3):
            env.step(act)
    if end == "kill":
        os.kill(os.getpid(), signal.SIGKILL)
    if end == "exception":
        raise ZeroDivisionError
    if end == "close":
        env.close()
"""
ENDS = {"close": 0, "nothing": 0, "exception": 1, "kill": -signal.SIGKILL}


@pytest.fixture(scope="module")
def built():
    """Build what is played, so that nothing of that is counted."""
    return build_scenario("two_way")


def play(face, end, folder):
    """Play in a process of its own with its own folders; return how it ended."""
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
        [sys.executable, "-c", textwrap.dedent(PLAY), face, end, str(folder / "record")],
        cwd=folder / "working",
        env=environment,
        start_new_session=True,
        stderr=subprocess.PIPE,
    )
    assert process.stderr is not None
    said = process.stderr.read().decode()
    return process.wait(), process.pid, said


def processes_of(session):
    """Return the processes of a session that are left."""
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


@pytest.mark.slow
@pytest.mark.parametrize(
    ("face", "end"),
    [*(("vector", end) for end in ENDS), ("hiway", "exception"), ("parallel", "kill"), ("rllib", "kill")],
)
def test_nothing_is_left_but_whole_episodes(built, tmp_path, face, end):
    code, session, said = play(face, end, tmp_path)
    assert code == ENDS[end], said
    assert processes_of(session) == []
    for name in ("temporary", "working", "home", "cache"):
        assert files_below(tmp_path / name) == []
    for folder in episodes_in(tmp_path / "record"):
        assert RecordedEpisode(folder).facts["steps"] > 0
    hidden = [path.name for path in (tmp_path / "record").glob(".*")]
    if end == "close":
        assert len(episodes_in(tmp_path / "record")) >= 2
        assert hidden == []
    # Whatever is hidden is of the dead, and the next to record here takes it away.
    assert all(name.startswith(PARTIAL) for name in hidden)
    EpisodeStore(tmp_path / "record")
    assert list((tmp_path / "record").glob(".*")) == []
