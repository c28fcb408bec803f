"""Progress for TensorBoard: what progress.csv says, over agent-steps."""

from benchmark.results.run_folder import PROGRESS_COLUMNS, RunFolder
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
    folder.begin_progress(0)
    first = Scalars(folder.tensorboard, folder.read_progress())
    for number in (1, 2, 3):
        given = line(number, completion=number / 4, collision=float("nan"))
        folder.add_progress(given)
        first.add(given)
    first.close()
    seconds = {100: 2.0, 200: 4.0, 300: 6.0}
    assert read_scalars(folder.tensorboard) == {
        "completion": {100: 0.25, 200: 0.5, 300: 0.75},
        "seconds": seconds,
    }

    folder.begin_progress(2)  # killed, with a checkpoint of the second iteration
    second = Scalars(folder.tensorboard, folder.read_progress())
    second.add(line(3, completion=0.875, validation_return=-1.5))
    second.close()
    assert read_scalars(folder.tensorboard) == {
        "completion": {100: 0.25, 200: 0.5, 300: 0.875},
        "seconds": seconds,
        "validation_return": {300: -1.5},
    }
