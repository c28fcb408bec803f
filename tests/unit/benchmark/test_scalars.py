"""Progress for TensorBoard: what progress.csv says, over agent-steps."""

import resource

from benchmark.results.progress import COLUMNS as PROGRESS_COLUMNS
from benchmark.results.progress import add_progress, begin_progress
from benchmark.results.run_folder import RunFolder
from benchmark.running import scalars
from benchmark.running.scalars import Scalars
from tests.scalar_files import read_scalars


def line(iteration, **columns):
    return {
        **dict.fromkeys(PROGRESS_COLUMNS, ""),
        "iteration": iteration,
        "agent_steps": 100 * iteration,
        "seconds": 2.0 * iteration,
        **columns,
    }


def test_the_files_hold_the_columns_of_progress_and_nothing_that_is_made_again(tmp_path):
    folder = RunFolder(tmp_path)
    first = Scalars(folder.tensorboard, begin_progress(folder.progress, 0))
    for number in (1, 2, 3):
        given = line(number, completion=number / 4, collision=float("nan"))
        add_progress(folder.progress, given)
        first.add(given)
    first.close()
    seconds = {100: 2.0, 200: 4.0, 300: 6.0}
    assert read_scalars(folder.tensorboard) == {
        "completion": {100: 0.25, 200: 0.5, 300: 0.75},
        "seconds": seconds,
    }

    # Killed, with a checkpoint of the second iteration.
    second = Scalars(folder.tensorboard, begin_progress(folder.progress, 2))
    second.add(line(3, completion=0.875, validation_return=-1.5))
    second.close()
    assert read_scalars(folder.tensorboard) == {
        "completion": {100: 0.25, 200: 0.5, 300: 0.875},
        "seconds": seconds,
        "validation_return": {300: -1.5},
    }


def test_a_folder_that_is_a_link_is_written_to(tmp_path):
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "tensorboard").symlink_to(tmp_path / "elsewhere")
    lines = [line(1, completion=0.25), line(2, completion=0.5)]
    Scalars(tmp_path / "tensorboard", lines).close()
    Scalars(tmp_path / "tensorboard", lines[:1]).close()
    assert read_scalars(tmp_path / "elsewhere")["completion"] == {100: 0.25}


def test_a_full_disk_costs_the_files_and_not_the_run(tmp_path, monkeypatch, capsys):
    """However long it stays full, nothing waits for it."""
    monkeypatch.setattr(scalars, "SECONDS", -1)
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    written = Scalars(tmp_path / "tensorboard", [])
    written.add(line(1, completion=0.5))
    resource.setrlimit(resource.RLIMIT_FSIZE, (100, before[1]))
    try:
        written.add(line(2, completion=0.5))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    for number in range(3, 30):
        written.add(line(number, completion=0.5))
    written.close()
    assert capsys.readouterr().err.count("no more curves for TensorBoard") == 1
    (tmp_path / "file").touch()
    Scalars(tmp_path / "file", [line(1)]).close()
    again = Scalars(tmp_path / "tensorboard", [line(1, completion=0.25)])
    again.close()
    assert read_scalars(tmp_path / "tensorboard")["completion"] == {100: 0.25}
