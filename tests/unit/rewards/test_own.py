"""Rewards of one's own: what they are called with, and what their values become."""

from contextlib import closing

import numpy as np
import pytest

from smarts.env import VectorHiWayEnv
from smarts.errors import OwnCodeError
from smarts.rewards.own import RewardStep
from smarts.types.events import Outcome
from tests.raising import raises

HERE = __file__


def play(reward, decisions=60, agents=2, scenario="loop"):
    """Drive two simulations of lane-keeping agents; yield which agents acted, and the step's result."""
    with closing(VectorHiWayEnv(2, [scenario], agents, reward=reward, seed=5)) as env:
        alive = env.reset(5).alive.copy()
        for _ in range(decisions):
            step = env.step([np.zeros((2, agents), np.int64)])
            yield alive, step._replace(rewards=step.rewards.copy())  # which the next step writes over
            alive = step.alive.copy()


def one(step: RewardStep):
    return np.ones(step.driving.shape)


def test_a_decision_is_worth_the_sum_of_its_steps():
    seen = 0
    for alive, step in play(one):
        went_on = alive & ~(step.terminated | step.truncated)
        assert (step.rewards[went_on] == 5.0).all()
        ended = step.terminated | step.truncated
        assert ((step.rewards[ended] >= 1.0) & (step.rewards[ended] <= 5.0)).all()
        assert (step.rewards[~alive] == 0.0).all()
        seen += int(went_on.sum())
    assert seen > 50


class NothingMore:
    weights = "paper"

    def __call__(self, step):
        return 0.0


class PaperAndGoal:
    weights = {"goal": 2.0}  # noqa: RUF012

    def __call__(self, step):
        return 3.0 * (step.outcome == Outcome.GOAL) - 7.0 * (step.outcome == Outcome.COLLISION)


def test_weights_are_added():
    paper, own = (
        np.array([step.rewards for _, step in play(reward, 60)]) for reward in ("paper", NothingMore)
    )
    assert paper.any()
    np.testing.assert_array_equal(own, paper)
    weighted, both = (
        np.array([step.rewards for _, step in play(reward, 160, agents=4, scenario="two_way")])
        for reward in ({"goal": 5.0, "collision": -7.0}, PaperAndGoal)
    )
    assert {*np.unique(weighted)} >= {-7.0, 0.0, 5.0}
    np.testing.assert_array_equal(both, weighted)


def broken(step):
    return step.no_such_thing


@pytest.mark.parametrize(
    ("reward", "values"),
    [(lambda step: np.ones(7), [(7,), (2, 2)]), (lambda step: np.full((2, 2), np.inf), ["inf", "'agent-0'"])],
)
def test_what_is_no_reward_is_named(reward, values):
    with raises(OwnCodeError, values=values):
        [*play(reward, 2)]


def test_a_reward_that_raises_is_named_by_its_line():
    with raises(OwnCodeError, f"{HERE}:{broken.__code__.co_firstlineno + 1}", values=["AttributeError"]):
        [*play(broken, 2)]
