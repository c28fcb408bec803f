"""Progress for TensorBoard: what progress.csv says, over agent-steps."""

from benchmark.results.progress import COLUMNS as PROGRESS_COLUMNS
from benchmark.results.progress import add_progress, begin_progress
from benchmark.results.run_folder import RunFolder
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
