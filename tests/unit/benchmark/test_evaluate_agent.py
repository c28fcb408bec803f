"""Agents that drive the egos of the benchmark's test: in process and at an address."""

from dataclasses import replace

import pandas as pd
import pytest

from benchmark.running.evaluating import Asked, evaluate_agent
from smarts.agents.hosting.options import HostError
from smarts.errors import OwnCodeError, SmartsError
from tests.served_agents import served

DRAWING, MISBEHAVING = "tests.hosted_agents:drawing-v0", "tests.hosted_agents:misbehaving-v0"
TEST = Asked(["intersection"], "no_social_vehicles", episodes=2, agents=2)


def test_an_agent_at_an_address_scores_exactly_what_it_scores_in_process(tmp_path):
    here = evaluate_agent(DRAWING, replace(TEST, out=tmp_path))
    assert len(here) == 4
    with served("-m", "benchmark.cli", "serve", DRAWING, "--address", "127.0.0.1:0") as address:
        there = evaluate_agent(address, TEST)
    columns = [name for name in here.columns if name != "algorithm"]
    pd.testing.assert_frame_equal(here[columns], there[columns], check_exact=True)


def test_an_agent_that_fails_has_no_score():
    serve = ("-m", "benchmark.cli", "serve", MISBEHAVING, "--address", "127.0.0.1:0")
    command = (*serve, "--set", "how=answer_too_few")
    with served(*command) as address, pytest.raises(HostError) as raised:
        evaluate_agent(address, TEST)
    assert address in raised.value.place


def test_actions_of_another_shape_are_named():
    with pytest.raises(OwnCodeError, match=r"answered by int64 of shape \(1, 1\)"):
        evaluate_agent(MISBEHAVING, replace(TEST, agents=1), {"how": "answer_a_column"})


@pytest.mark.parametrize("locator", ["tests.hosted_agents:describing-v0", "no-such-v0", "tcp://127.0.0.1:1"])
def test_agents_that_cannot_be_evaluated_are_errors(locator):
    with pytest.raises(SmartsError):
        evaluate_agent(locator, TEST)
