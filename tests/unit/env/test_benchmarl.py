"""BenchMARL's task: all agents stay in the batch until the last one has ended."""

from itertools import combinations

import pytest
import torch
from torchrl.envs.utils import check_env_specs

from smarts.env.benchmarl import GROUP, HiWayTask


@pytest.fixture(scope="module")
def env():
    task = HiWayTask(["intersection"], 3, traffic=["no_social_vehicles"])
    made = task.get_env_fun(1, continuous_actions=False, seed=4, device="cpu")()
    yield made
    made.close()


def test_specs_are_those_of_what_it_returns(env):
    check_env_specs(env)


def test_agents_that_have_ended_stay_without_effect(env):
    absences = 0
    for _ in range(3):  # of random play, in which all may end together
        batch = env.rollout(400, break_when_any_done=True)
        following = batch["next", GROUP]
        ended = following["done"][:, :, 0].cumsum(0) > 0
        assert following["done"][-1].all()
        assert batch["next", "done"][:-1].sum() == 0
        assert (ended == following["done"][:, :, 0]).all()  # once ended, always ended
        was_there = ~torch.cat([torch.zeros_like(ended[:1]), ended[:-1]])
        assert following["reward"][..., 0][~was_there].abs().sum() == 0
        assert following["observation"][~was_there].abs().sum() == 0
        # Of the last observation, on which no agent acts, TorchRL makes no mask.
        masks = following["action_mask"][:-1][~was_there[:-1]]
        assert (masks == torch.tensor([True, False, False, False])).all()
        absences += int((~was_there).sum())
    assert absences


def test_actions_keep_to_the_masks(env):
    batch = env.rollout(60, break_when_any_done=True)
    allowed = batch[GROUP, "action_mask"].gather(-1, batch[GROUP, "action"][..., None])
    assert allowed.all()


def test_each_environment_plays_episodes_of_its_own():
    task = HiWayTask(["intersection"], 2)
    training, evaluation = (task.get_env_fun(2, False, 7, "cpu") for _ in range(2))
    envs = [training(), training(), evaluation()]
    first = [env.reset()[GROUP, "observation"] for env in envs]
    assert not any(torch.equal(a, b) for a, b in combinations(first, 2))
    again = HiWayTask(["intersection"], 2).get_env_fun(2, False, 7, "cpu")()
    assert torch.equal(again.reset()[GROUP, "observation"], first[0])  # by the run's seed
    for env in [*envs, again]:
        env.close()
