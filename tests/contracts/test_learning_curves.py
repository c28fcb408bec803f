"""Trainings that are killed and continued, and their curves."""

import pytest
from PIL import Image

from algorithms.registry import ALGORITHMS
from perf import algorithms_table, learning_curves
from perf.learning_curves import Continuation, continuation, panels


def lines(*steps):
    return [
        {"iteration": number, "agent_steps": each, "completion": float("nan")}
        for number, each in enumerate(steps, start=1)
    ]


CHECKPOINT = {"iteration": 2, "agent_steps": 200}
BEFORE = lines(100, 200, 310)


def test_what_comes_after_the_checkpoint_may_differ():
    after = lines(100, 200, 290, 400)
    assert continuation("ppo", BEFORE, CHECKPOINT, after, 12) == Continuation("ppo", 310, 200, 290, 400, 12)


@pytest.mark.parametrize(
    "after",
    [
        lines(100, 200),  # nothing after the checkpoint
        lines(100, 210, 300, 400),  # another line before it
        lines(100, 200, 190, 400),  # began again from less
    ],
)
def test_a_training_that_did_not_continue_is_named(after):
    with pytest.raises(RuntimeError, match="ppo"):
        continuation("ppo", BEFORE, CHECKPOINT, after, 12)


def test_every_algorithm_has_a_place_in_one_panel():
    found = panels(list(ALGORITHMS))
    assert sorted(name for own in found.values() for name in own) == sorted(ALGORITHMS)
    assert max(map(len, found.values())) <= learning_curves.PANEL


def test_the_table_is_read_as_it_was_written_in_the_order_of_the_registry(tmp_path):
    file = tmp_path / "continued.csv"
    rows = [Continuation("vdn", 4, 3, 4, 9, 7), Continuation("ppo", 30_000, 20_000, 25_000, 60_000, 1_234)]
    assert learning_curves.read(file) == []
    learning_curves.write(rows, file)
    assert learning_curves.read(file) == rows[::-1]
    section = algorithms_table.continued(file)
    assert "| `ppo` | 30,000 | 20,000 | 25,000 | 60,000 | 1,234 |" in section
    assert "| `vdn` | 4 | 3 | 4 | 9 | 7 |" in section
    assert f"2 of {len(ALGORITHMS)} algorithms" in section


def test_curves_are_drawn_from_progress(tmp_path):
    text = "iteration,agent_steps,seconds,agent_steps_per_second,return,completion,collision"
    text += ",validation_return,validation_completion,validation_collision\n"
    for name in ("ppo", "vdn"):
        folder = learning_curves.run_folder(tmp_path, name)
        folder.mkdir(parents=True)
        rows = (f"{k},{1000 * k},{k},1000,0.0,{k / 10},0.1,,,\n" for k in range(1, 8))
        (folder / "progress.csv").write_text(text + "".join(rows))
    learning_curves.draw(tmp_path, ["ppo", "vdn"], tmp_path / "curves.png")
    with Image.open(tmp_path / "curves.png") as picture:
        colours = {colour for _, colour in picture.convert("RGB").getcolors(picture.width * picture.height)}
    assert tuple(bytes.fromhex(learning_curves.PALETTE[0][1:])) in colours
