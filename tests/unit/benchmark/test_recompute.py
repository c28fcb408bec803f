"""Rates that are recomputed apart are what a report says, and one that it says wrongly is found."""

import importlib.util
from pathlib import Path

from benchmark.report.writing import write_report
from tests.hand_made_results import agent_episodes, pack, write_experiment, write_run

SCRIPT = Path(__file__).parents[3] / "results" / "recompute.py"


def recompute(root):
    spec = importlib.util.spec_from_file_location("recompute", SCRIPT)
    assert spec
    assert spec.loader
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.main(root)


def test_rates_are_recomputed_and_a_wrong_one_is_found(tmp_path, capsys):
    write_experiment(tmp_path, algorithms=["dqn", "ppo"], seeds=[1, 2])
    for seed, ends in ((1, ["goal", "collision", "invalid"]), (2, ["goal", "time_out", "goal"])):
        tables = [agent_episodes([[end, "goal"] for end in ends], mode="greedy")]
        tables.append(agent_episodes([["off_road"]], mode="greedy", split="held_out", variation="mirrored"))
        write_run(tmp_path, "dqn", tables, seed=seed)
    write_report(tmp_path)
    assert recompute(tmp_path) == 0
    assert capsys.readouterr().out.startswith("10 rates of 1 cells compared")
    pack(tmp_path, tmp_path / "packed")
    write_report(tmp_path / "packed")
    assert recompute(tmp_path / "packed") == 0
    assert capsys.readouterr().out.startswith("10 rates of 1 cells compared")
    values = tmp_path / "report" / "values.csv"
    right = values.read_text()
    values.write_text(right.replace("collision_rate,0.0909091,", "collision_rate,0.0909191,"))
    assert values.read_text() != right
    assert recompute(tmp_path) == 1
    values.write_text("\n".join(line for line in right.splitlines() if "completion_rate" not in line))
    assert recompute(tmp_path) == 1
    assert "ended by goal, of which the report says nothing" in capsys.readouterr().out
