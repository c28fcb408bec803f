"""Runs whose policies are untrained."""

from benchmark.experiment.config import read_experiment
from benchmark.experiment.runs import runs_of
from benchmark.results.run_folder import RunFolder
from benchmark.running.training import algorithm_of, checkpoint_files


def write_untrained(root, experiment):
    """Return the first run of an experiment's text, and its folder with a checkpoint."""
    (root / "tiny.yaml").write_text(experiment)
    run = next(iter(runs_of(read_experiment(root / "tiny.yaml"))))
    folder = RunFolder(root / "run")
    folder.open(run.content())
    with algorithm_of(run) as algo:
        folder.keep("checkpoint", checkpoint_files(algo, {}))
    return run, folder
