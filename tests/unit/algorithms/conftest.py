import os
from pathlib import Path

import pytest


@pytest.fixture(scope="session", autouse=True)
def _one_thread():
    """Threads that wait for each other on busy cores cost a factor of ten."""
    import torch

    torch.set_num_threads(1)


@pytest.fixture(scope="module")
def cluster():
    """A Ray instance of two processes, whose workers can import the tests' games."""
    import ray

    root = Path(__file__).resolve().parents[3]
    path = os.pathsep.join([str(root), os.environ.get("PYTHONPATH", "")])
    ray.init(
        num_cpus=2,
        include_dashboard=False,
        logging_level="ERROR",
        log_to_driver=False,
        runtime_env={"env_vars": {"PYTHONPATH": path}},
    )


@pytest.fixture
def build():
    """Provide what builds an algorithm from a config, and restores it from a checkpoint if one is given."""
    built = []

    def make(config, checkpoint=None):
        built.append(config.build_algo())
        if checkpoint is not None:
            built[-1].restore_from_path(str(checkpoint))
        return built[-1]

    yield make
    for algo in built:
        algo.stop()
