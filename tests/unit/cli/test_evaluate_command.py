"""What `smarts-bench evaluate` prints of a test."""

import pandas as pd

from benchmark.cli.experiments import show_metrics
from tests.hand_made_results import agent_episodes


def test_each_of_several_scenarios_has_a_row(capsys):
    one = agent_episodes([["goal", "goal"], ["goal", "collision"]], mode="greedy", returns=1.0)
    two = agent_episodes([["collision", "collision"]], mode="greedy", task="loop", returns=1.0)
    show_metrics(one)
    assert "intersection: " not in capsys.readouterr().out
    show_metrics(pd.concat([one, two], ignore_index=True))
    rows = [line.strip() for line in capsys.readouterr().out.splitlines()]
    (first,) = [row for row in rows if row.startswith("intersection: ")]
    (second,) = [row for row in rows if row.startswith("loop: ")]
    assert "collision_rate 0.250" in first
    assert "completion_rate 0.750" in first
    assert "4 agent-episodes" in first
    assert "collision_rate 1.000" in second
    assert "2 agent-episodes" in second
