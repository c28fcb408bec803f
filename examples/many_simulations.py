"""Eight simulations in one process, stepped by one call: observations, actions and rewards are arrays."""

from time import perf_counter

import numpy as np

from smarts.env import VectorHiWayEnv


def main(decisions: int = 200) -> float:
    """Keep all lanes for some decisions; return the mean reward of a decision."""
    env = VectorHiWayEnv(num_envs=8, scenarios=["loop"], agents=4)
    try:
        env.reset(42)
        keep_lane = [np.zeros((8, 4), np.int64)]  # an array for each block of agents with equal spaces
        rewards, began = 0.0, perf_counter()
        for _ in range(decisions):
            step = env.step(keep_lane)  # simulations whose episode ends are reset at once
            rewards += step.rewards.sum()
        seconds = perf_counter() - began
    finally:
        env.close()
    mean = rewards / (decisions * 8 * 4)
    print(f"reward {mean:.4f} a decision; {decisions * 8 * 5 / seconds:,.0f} simulation steps a second")
    return mean


if __name__ == "__main__":
    main()
