"""The single-agent environment passes the checks of Stable-Baselines3."""

from contextlib import closing

import pytest
from stable_baselines3.common.env_checker import check_env

from smarts.env import SingleHiWayEnv


@pytest.mark.parametrize("action_mask", [False, True])
@pytest.mark.filterwarnings("error::UserWarning")
def test_single(action_mask):
    with closing(SingleHiWayEnv(["intersection"], action_mask=action_mask)) as env:
        check_env(env)
