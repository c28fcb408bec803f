"""Social agents in processes of their own: they drive as in this process, bit by bit."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from smarts.env.vector import VectorHiWayEnv

SOCIAL = [{"agent": "idm-v0", "count": 2}, {"agent": "random-v0", "count": 1}]


def drive(hosts: Mapping[str, Any], decisions: int = 40) -> np.ndarray:
    """Return where an ego that keeps its lane has come to, and what it has met."""
    env = VectorHiWayEnv(1, ["intersection"], 1, social_agents=SOCIAL, hosts=hosts)
    try:
        step = env.reset(seed=7)
        seen = []
        for _ in range(decisions):
            seen.append(np.concatenate([each.ravel() for each in step.observations[0].values()]))
            step = env.step([np.zeros((1, 1), int)])
            assert not step.social_failures
        return np.array(seen)
    finally:
        env.close()


def main() -> None:
    """Compare a run in one process with a run in three."""
    here, there = drive({}), drive({"*": "process"})
    late = drive({"*": {"where": "process", "delay_steps": 3}})
    print("equal in processes of their own:", np.array_equal(here, there))
    print("equal with a latency of 0.3 s:", np.array_equal(here, late))


if __name__ == "__main__":
    main()
