"""Every logger shows the lines that it is given, of a training that continues, without a network."""

import struct
import sys
from threading import Event

import pytest

from benchmark.experiment.config import read_experiment
from benchmark.experiment.loggers import LOGGERS
from benchmark.experiment.models import Experiment
from benchmark.experiment.runs import runs_of
from benchmark.results.run_folder import RunFolder
from benchmark.running import logger_threads
from benchmark.running.messages import Began, Kept, Line
from benchmark.running.writing import RunWriter
from smarts.config import ConfigError
from tests.scalar_files import read_scalars

EXPECTED = {10: 0.5, 20: 0.25, 30: 0.75}
"""Agent-steps -> completion."""


def of_tensorboard(folder):
    return read_scalars(folder.path / "tensorboard")["completion"]


def of_wandb(folder):
    import wandb  # pyright: ignore[reportMissingImports]
    from wandb.proto.wandb_internal_pb2 import Record  # pyright: ignore[reportMissingImports]

    wandb.teardown()  # its own process writes the files
    found = {}
    for file in sorted((folder.path / "wandb").glob("offline-run-*/run-*.wandb")):
        content, at = file.read_bytes(), 7  # behind the file's own mark
        while at < len(content):
            _, length, kind = struct.unpack_from("<IHB", content, at)
            assert kind == 1  # a whole record, as in short files
            items = Record.FromString(content[at + 7 : at + 7 + length]).history.item
            row = {each.key or each.nested_key[0]: each.value_json for each in items}
            if "completion" in row:
                found[int(row["agent_steps"])] = float(row["completion"])
            at += 7 + length
    return found


def of_mlflow(folder):
    from mlflow import MlflowClient  # pyright: ignore[reportMissingImports]

    client = MlflowClient()
    (run,) = client.search_runs([client.get_experiment_by_name("far").experiment_id])
    assert run.data.params["algorithm"] == "ppo"
    return {each.step: each.value for each in client.get_metric_history(run.info.run_id, "completion")}


READERS = {"tensorboard": of_tensorboard, "wandb": of_wandb, "mlflow": of_mlflow}


def line(iteration):
    values = {"iteration": iteration, "agent_steps": 10 * iteration, "seconds": 1.5 * iteration}
    return Line({**values, "completion": EXPECTED[10 * iteration], "validation_return": ""})


@pytest.mark.parametrize("name", LOGGERS)
def test_a_logger_shows_each_line_of_a_training_that_continues(tmp_path, monkeypatch, name):
    if name != "tensorboard":
        pytest.importorskip(name)
    monkeypatch.setenv("WANDB_MODE", "offline")
    monkeypatch.setenv("MLFLOW_TRACKING_URI", f"sqlite:///{tmp_path}/mlflow.db")
    (run,) = runs_of(Experiment(name="far", algorithms=["ppo"], tasks=["loop"], traffic=["light"], seeds=[1]))
    folder = RunFolder(tmp_path / "far" / run.folder)
    writer = RunWriter(run, folder, [name])
    checkpoint = Kept("checkpoint", {"training.json": b'{"iteration": 1}'})
    for message in (Began({"begun": "now"}, {}), line(1), checkpoint, line(2)):
        writer.take(message)
    writer.close()
    again = RunWriter(run, folder, [name])  # the process was lost after its second iteration
    for message in (Began({}, {}), line(2), line(3)):
        again.take(message)
    again.close()
    assert READERS[name](folder) == pytest.approx(EXPECTED)


class Broken:
    """A logger whose server goes away."""

    def __init__(self, logged, lines):
        pass

    def add(self, line):
        raise ConnectionError("no route")

    def close(self):
        raise AssertionError("left out before")


def test_a_logger_that_fails_does_not_end_the_training(tmp_path, capsys):
    (run,) = runs_of(Experiment(name="far", algorithms=["ppo"], tasks=["loop"], traffic=["light"], seeds=[1]))
    writer = RunWriter(run, RunFolder(tmp_path / "run"), [f"{__name__}:Broken"])
    writer.take(Began({}, {}))
    writer.take(line(1))
    writer.take(line(2))
    writer.close()
    assert capsys.readouterr().err.count("Broken has failed: no route") == 1


def test_a_server_that_does_not_answer_holds_up_nothing(monkeypatch, capsys):
    monkeypatch.setattr(logger_threads, "MOST_WAITING", 2)
    thread, began, answered, kept, left_out = (
        logger_threads.LoggerThread("far"),
        *(Event() for _ in range(4)),
    )
    thread.add(lambda: began.set() or answered.wait())
    assert began.wait(10)
    thread.wait(0.05)
    thread.add(kept.set)
    for _ in range(5):
        thread.add(left_out.set)
        thread.wait()  # not again
    answered.set()
    assert kept.wait(10)
    assert not left_out.is_set()
    assert capsys.readouterr().err.count("does not answer") == 2


def test_a_logger_that_is_not_installed_is_one_sentence(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "wandb", None)
    monkeypatch.delitem(sys.modules, "benchmark.running.loggers.for_wandb", raising=False)
    file = tmp_path / "mine.yaml"
    file.write_text("algorithms: [ppo]\ntasks: [loop]\nlog: [tensorboard, wandb]\n")
    with pytest.raises(ConfigError, match=r"log\[1\].*wandb is not installed.*pip install wandb"):
        read_experiment(file)
    with pytest.raises(ConfigError, match="did you mean 'mlflow'"):
        read_experiment(file, ["log=[mlflov]"])
