"""The single-agent environment passes the checks of Stable-Baselines3."""

import pytest
from stable_baselines3.common.env_checker import check_env

from smarts.env import SingleHiWayEnv


@pytest.mark.parametrize("action_mask", [False, True])
@pytest.mark.filterwarnings("error::UserWarning")
def test_single(action_mask):
    env = SingleHiWayEnv(["intersection"], action_mask=action_mask)
    try:
        check_env(env)
    finally:
        env.close()
