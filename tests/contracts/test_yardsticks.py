"""The games of `perf/yardstick_games` equal those of the published packages."""

import gymnasium
import lbforaging  # noqa: F401 - registers the game
import numpy as np
import pytest
from mpe2 import simple_spread_v3

from algorithms.joint.env import episode_seed
from algorithms.joint.making import check_environment
from perf.yardstick_games.foraging import LOAD, Foraging
from perf.yardstick_games.matrices import Matrices, scaled
from perf.yardstick_games.recipes import RECIPES, YARDSTICKS
from perf.yardstick_games.spread import Spread
from perf.yardsticks import configured
from tests.vector_contract import check_vector_env

SEED = 7


def fresh_foraging(row, episode):
    """Return a new game of the package (a reset would mind the last places) and what it shows."""
    env = gymnasium.make("Foraging-8x8-2p-2f-coop-v3").unwrapped
    return env, np.array(env.reset(seed=episode_seed(SEED, row, episode))[0])


def together(seen, rng):
    """Return actions (2,) of agents that mostly walk to the first food and load it, else act at random."""
    actions = rng.integers(6, size=2)
    for agent in np.flatnonzero(rng.random(2) < 0.8):
        down, right = seen[agent][:2] - seen[agent][6:8]
        if abs(down) + abs(right) == 1:
            actions[agent] = LOAD
        elif abs(down) > abs(right):
            actions[agent] = 2 if down > 0 else 1
        else:
            actions[agent] = 4 if right > 0 else 3
    return actions


def test_foraging_equals_the_packages_game_step_by_step():
    copies = 3
    game, rng = Foraging(copies), np.random.default_rng(0)
    now = game.reset(SEED, np.arange(copies))
    theirs = [fresh_foraging(row, 0) for row in range(copies)]
    episodes, loads = [0] * copies, 0
    for _ in range(250):
        seen = now.observations[0][""].copy()
        assert np.array_equal(seen, [shown for _, shown in theirs])
        actions = np.stack([together(each, rng) for each in seen])
        now = game.step((actions,))
        for row, (env, _) in enumerate(theirs):
            shown, rewards, over, _, _ = env.step(actions[row])
            assert now.rewards[row] == pytest.approx(rewards)
            assert now.reset[row] == over
            assert now.terminated[row].all() == (not env.field.any())
            loads += sum(rewards) > 0
            theirs[row] = env, np.array(shown)
            if over:
                place = now.final.rows.tolist().index(row)
                assert np.array_equal(now.final.observations[0][""][place], shown)
                episodes[row] += 1
                theirs[row] = fresh_foraging(row, episodes[row])
    assert loads > 10
    assert min(episodes) > 2


def test_spread_equals_the_packages_game_step_by_step():
    copies = 2
    game, rng = Spread(copies), np.random.default_rng(0)
    now = game.reset(SEED, np.arange(copies))
    theirs = [simple_spread_v3.parallel_env() for _ in range(copies)]
    shown = [env.reset(seed=episode_seed(SEED, row, 0))[0] for row, env in enumerate(theirs)]
    for t in range(1, 101):
        seen = np.array([list(each.values()) for each in shown])
        np.testing.assert_allclose(now.observations[0][""], seen, atol=1e-6)
        actions = rng.integers(5, size=(copies, 3))
        now = game.step((actions,))
        for row, env in enumerate(theirs):
            given = dict(zip(env.agents, actions[row].tolist(), strict=True))
            shown[row], rewards, _, cut, _ = env.step(given)
            np.testing.assert_allclose(now.rewards[row], list(rewards.values()), atol=1e-5)
            assert now.truncated[row].tolist() == list(cut.values())
            if now.reset[row]:
                shown[row] = env.reset(seed=episode_seed(SEED, row, t // 25))[0]


def test_matrices_pay_the_team_1_for_the_best_actions_and_0_on_average():
    payoffs = scaled(np.array([[[1.0, 2.0], [3.0, 6.0]]]))
    assert np.allclose(payoffs, [[[-2 / 3, -1 / 3], [0, 1]]])
    game = Matrices(4)
    game.reset(SEED, np.arange(4))
    best = [np.unravel_index(game.payoffs[k].argmax(), (5, 5)) for k in game.number]
    step = game.step((np.array(best),))
    assert step.rewards.sum(1) == pytest.approx(1)
    assert step.terminated.all()


@pytest.mark.parametrize("name", YARDSTICKS)
def test_games_keep_the_contract_and_a_row_equals_the_run_alone(name):
    check_vector_env(YARDSTICKS[name].make(3), steps=60)
    many, alone = YARDSTICKS[name].make(3), YARDSTICKS[name].make(1)
    rng = np.random.default_rng(1)
    steps = many.reset(SEED, np.arange(3)), alone.reset(SEED, np.array([2]))
    for _ in range(60):
        assert np.array_equal(steps[0].observations[0][""][2:], steps[1].observations[0][""])
        actions = rng.integers(many.num_actions, size=(3, many.num_agents))
        steps = many.step((actions,)), alone.step((actions[2:],))
        assert np.array_equal(steps[0].rewards[2:], steps[1].rewards)


@pytest.mark.parametrize("game", YARDSTICKS)
def test_recipes_set_what_algorithms_have_and_suit_the_game(game):
    for name, recipe in RECIPES[game].items():
        config = configured(game, name, 1, recipe)
        check_environment(config, config.algo_class.runner_class)
