"""Makes the environments that RLlib's `environment()` is given, and checks one before Ray starts."""

from __future__ import annotations

import logging
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from ray.rllib.env.env_context import EnvContext
from ray.rllib.env.utils import _gym_env_creator
from ray.tune.registry import ENV_CREATOR, _global_registry

from algorithms.errors import AlgorithmError, EnvironmentFailure

if TYPE_CHECKING:
    from algorithms.joint.config import JointConfig

logger = logging.getLogger(__name__)


def creator_of(name: Any) -> Callable[[EnvContext], Any]:
    """Return what makes an environment.

    Args:
        name: A name that Ray or Gymnasium knows, or a class.
    """
    if isinstance(name, str) and _global_registry.contains(ENV_CREATOR, name):
        return _global_registry.get(ENV_CREATOR, name)
    return lambda context: _gym_env_creator(env_context=context, env_descriptor=name)


def check_environment(config: JointConfig, runner: Callable[..., Any]) -> None:
    """Make one environment in this process and raise if the algorithm cannot handle its agents or spaces.

    Remote runners may have what this process lacks: where there are some, an environment that cannot be made
    here is left to them.

    Args:
        config: Config of the training.
        runner: What makes the environment.

    Raises:
        SpaceError: The algorithm, or names of policies in its settings, do not fit the environment.
        EnvironmentFailure: It cannot be started.
    """
    alone = config.copy(copy_frozen=False)
    alone.num_env_runners, alone.num_envs_per_env_runner = 0, 1
    try:
        trial = runner(config=alone, worker_index=0, num_workers=0)
    except Exception as error:
        needed_here = isinstance(error, AlgorithmError) and not isinstance(error, EnvironmentFailure)
        if needed_here or not config.num_env_runners:
            raise
        logger.info("no environment could be made in this process: %r", error)
        return
    try:
        config.get_multi_rl_module_spec(spaces=trial.get_spaces())
    finally:
        trial.stop()
