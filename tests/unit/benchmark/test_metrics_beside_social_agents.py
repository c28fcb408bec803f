"""Metrics measure egos: other agents' holds change nothing, and learners may have a column in turn."""

import dataclasses

import numpy as np
import pytest

from benchmark.metrics.registry import METRICS
from smarts.types.agent_states import AgentStatus
from smarts.types.events import Outcome
from tests.measuring import value
from tests.recordings import Drive, at_speed, episode_of, straight

ROAD = straight(lanes=2)


def assert_same_metrics(one, other):
    for name in METRICS:
        if name != "generalization":  # of two splits
            assert value(name, one) == pytest.approx(value(name, other), nan_ok=True, rel=1e-12), name


def test_holds_and_transfers_of_others_change_no_metric(tmp_path):
    """The same drive, once of traffic, once of a social agent that ends, and whose vehicle is released."""
    ego = Drive(["road_0"], at_speed(5.0, 40), agent="ego", outcome=Outcome.GOAL, actions=[(0, 0), (5, 2)])
    at = at_speed(4.0, 40, begin=30.0)
    social = Drive(
        ["road_0"],
        at,
        agent="social",
        actions=[(10, 1), (20, 3)],
        extras=[(10, "probabilities", [0.5, 0.5])],
        columns={"interface": 0, "end_step": 29},
        agents={
            "state": [AgentStatus.SHADOWING] * 10 + [AgentStatus.ACTIVE] * 20 + [AgentStatus.LEAVING] * 11
        },
    )
    texts = {"name": "social", "policy": "zoo"}
    tables = {
        "holds": [{"agent": 1, "agent_id": 1, "last_step": 40, "slot": 1, "generation": 1, **texts}],
        "transfers": [{"step": 10, "slot": 1, "generation": 1, "name": "car", "to_agent": 1}],
        "agent_failures": [{"step": 25, "agent": 1, "text": "NaN"}],
    }
    alone = episode_of(tmp_path / "alone", ROAD, ego, Drive(["road_0"], at))
    beside = episode_of(tmp_path / "beside", ROAD, ego, social, tables=tables)
    assert_same_metrics(alone, beside)


def test_learners_that_have_one_column_in_turn_are_measured_each(tmp_path):
    first = Drive(["road_0"], at_speed(5.0, 20), agent="first", actions=[(0, 0)], outcome=Outcome.GOAL)
    second = Drive(["road_0"], at_speed(8.0, 20), agent="second", begin=21, outcome=Outcome.COLLISION)
    decisions = [{"step": step, "action": 3, "value_0": 2} for step in (21, 26)]
    second.decisions = decisions
    in_turn = dataclasses.replace(
        second,
        columns={"agent_id": 0},
        agents={"agent_id": 0},
        decisions=[decision | {"agent_id": 0} for decision in decisions],
    )
    both, apart = (
        episode_of(tmp_path / name, ROAD, first, drive)
        for name, drive in (("both", in_turn), ("apart", second))
    )
    assert both.count == 2
    assert np.flatnonzero(both.driving[:, 1]).tolist() == list(range(21, 42))
    assert np.nanmax(both.agent_column("distance_travelled"), 0) == pytest.approx([10.0, 16.0])
    assert [both.decisions(agent).step.tolist() for agent in (0, 1)] == [[0], [21, 26]]
    assert_same_metrics(both, apart)
