"""Scripts about results: rates recomputed apart, and the tables of README and docs."""

from benchmark.report.writing import write_report
from tests.hand_made_results import SCRIPTS, agent_episodes, pack, script, write_experiment, write_run


def test_the_tables_are_those_of_the_results_and_a_changed_figure_is_found():
    tables = script("tables")
    values = tables.read_values()
    for name, named in tables.FILES.items():
        text = (SCRIPTS.parent / name).read_text(encoding="utf-8")
        assert tables.with_tables(text, named, values, name) == text, f"{name}: python results/tables.py"
        row = next(line for line in text.splitlines() if line.startswith("| PPO | "))
        changed = text.replace(row, row.replace(" 0.", " 0.9", 1))
        assert changed != text
        assert tables.with_tables(changed, named, values, name) == text


def test_rates_are_recomputed_and_a_wrong_one_is_found(tmp_path, capsys):
    recompute = script("recompute").main
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
