"""Disks that are full, folders that cannot be written to, files that are damaged, two who record at once."""

import errno
import os
import resource
import subprocess
import sys
import textwrap
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from smarts.agents import ActionSpaceType, AgentInterface
from smarts.errors import RecordError
from smarts.sim.assembly import Options, assemble
from smarts.sim.episode_files import PARTIAL, RecordedEpisode, episodes_in
from smarts.sstudio.build import build_scenario
from smarts.types.episode_schema import TABLES
from tests.raising import raises

WRITTEN_WITHOUT_ROWS = {table.name for table in TABLES if not table.is_optional}
ROOT = Path(__file__).parents[3]


@contextmanager
def full_disk():
    """Let no file grow beyond a kilobyte: the same errors as on a full disk, in this process only."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1024, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


class Recording:
    """A simulation with one ego that is recorded."""

    def __init__(self, folder):
        interface = AgentInterface(action=ActionSpaceType.Lane)
        self.parts = assemble([build_scenario("two_way")], [interface], options=Options(record=folder))

    def play(self, episodes=1, steps=5):
        for episode in range(episodes):
            self.parts.simulation.reset({0: self.parts.schedule.start(0, episode)})
            for _ in range(steps):
                self.parts.simulation.step(
                    self.parts.actions, np.ones(1, np.bool_), np.ones((1, 1), np.bool_)
                )

    def close(self):
        self.parts.simulation.close()


def test_a_full_disk_is_told_and_leaves_nothing(tmp_path):
    recording = Recording(tmp_path)
    recording.play(2)
    with full_disk(), raises(RecordError, tmp_path, values=[os.strerror(errno.EFBIG)]):
        recording.close()
    recording.close()
    whole = [RecordedEpisode(folder).facts["steps"] for folder in episodes_in(tmp_path)]
    assert len(whole) <= 1, "the first may have been written before"
    assert list(tmp_path.glob(f"{PARTIAL}*")) == []
    again = Recording(tmp_path)
    again.play(1)
    again.close()
    assert len(episodes_in(tmp_path)) == len(whole) + 1


def test_a_folder_that_cannot_be_written_to():
    # Not even by the system's administrator, as whom tests may run.
    with raises(RecordError, "/proc/episodes"):
        Recording(Path("/proc/episodes"))


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    folder = tmp_path_factory.mktemp("recorded")
    recording = Recording(folder)
    recording.play(1)
    recording.close()
    return episodes_in(folder)[0]


def flipped(content, place):
    """Return a file's content with one bit changed, which the tables' checksums notice."""
    return content[:place] + bytes([content[place] ^ 1]) + content[place + 1 :]


@pytest.mark.parametrize(
    ("table", "damage"),
    [
        ("episode", lambda content: b""),
        ("vehicles", lambda content: content[: len(content) // 2]),
        ("vehicles", lambda content: flipped(content, len(content) // 4)),
    ],
)
def test_a_damaged_table_is_one_named_error(recorded, tmp_path, table, damage):
    folder = tmp_path / "one"
    folder.mkdir()
    for file in recorded.iterdir():
        content = file.read_bytes()
        (folder / file.name).write_bytes(damage(content) if file.stem == table else content)
    with raises(RecordError, folder, values=[f"'{table}'"]):
        RecordedEpisode(folder).table(table)


WRITE_FOR_EVER = """
    import sys
    from pathlib import Path
    from smarts.sim.episode_files import EpisodeStore
    from smarts.types.episode_schema import TABLE

    store = EpisodeStore(Path(sys.argv[1]))
    print("ready", flush=True)
    for number in range(int(sys.argv[2])):
        writer = store.begin("one")
        for name in TABLE:
            writer.append(name, {column: [] for column in TABLE[name].names})
        writer.finish()
    store.close()
"""


def writing(folder, episodes):
    command = [sys.executable, "-c", textwrap.dedent(WRITE_FOR_EVER), str(folder), str(episodes)]
    process = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE)
    assert process.stdout is not None
    assert process.stdout.readline() == b"ready\n"
    return process


def test_two_processes_write_episodes_of_one_name_into_one_folder(tmp_path):
    processes = [writing(tmp_path, 20) for _ in range(2)]
    assert [process.wait() for process in processes] == [0, 0]
    assert len(episodes_in(tmp_path)) == 40
    for folder in episodes_in(tmp_path):
        assert {file.stem for file in folder.iterdir()} == WRITTEN_WITHOUT_ROWS
    assert list(tmp_path.glob(".*")) == []


NEVER_CLOSED = """
    import atexit
    import sys
    import weakref
    from tests.unit.sim.test_recorder_in_trouble import Recording

    # At the end finalizers come first, as where another module has made one before.
    atexit.unregister(weakref.finalize._exitfunc)
    weakref.finalize._registered_with_atexit = True
    atexit.register(weakref.finalize._exitfunc)
    recording = Recording(sys.argv[1])
    recording.play(2, steps=60)
"""


def test_episodes_of_a_program_that_closes_nothing_are_written(tmp_path):
    subprocess.run([sys.executable, "-c", textwrap.dedent(NEVER_CLOSED), tmp_path], cwd=ROOT, check=True)
    kept = episodes_in(tmp_path)
    assert [RecordedEpisode(path).facts["steps"] for path in kept] == [60] * 2
    for path in kept:
        assert set(np.diff(np.unique(RecordedEpisode(path).table("vehicles")["step"]))) == {1}
    assert not [*tmp_path.glob(f"{PARTIAL}*")]
