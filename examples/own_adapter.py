"""Two ways to change observations and rewards: adapters of a spec, and a feature and a reward for arrays."""

import numpy as np
from gymnasium.spaces import Box

from smarts.agents import AgentSpec
from smarts.agents.benchmark import benchmark_interface
from smarts.env import VectorHiWayEnv, hiway_parallel_env
from smarts.observations.feature import Feature


def speed_and_gap(observation) -> np.ndarray:
    """Return speed [m/s] and distance to the nearest vehicle, at most 50 [m]."""
    ego = observation.ego_vehicle_state
    near = observation.neighborhood_vehicle_states
    gap = np.hypot(*np.subtract(near[0].position, ego.position)[:2]) if near else 50.0
    return np.array([ego.speed, min(gap, 50.0)], np.float32)


def go_or_brake(action) -> str:
    """Return a lane action for 0 or 1."""
    return "slow_down" if action else "keep_lane"


def by_spec(decisions: int = 20) -> float:
    """Drive one agent by adapters of its spec, beside one of the benchmark; return the first one's reward."""
    spec = AgentSpec(
        interface=benchmark_interface(neighborhood_vehicle_states=True),
        observation_adapter=speed_and_gap,
        observation_space=Box(0.0, 100.0, (2,), np.float32),
        action_adapter=go_or_brake,
        reward_adapter=lambda observation, reward: reward + 0.01 * observation.ego_vehicle_state.speed,
    )
    env = hiway_parallel_env(["loop"], {"mine": spec, "other": benchmark_interface()})
    total = 0.0
    try:
        observations, _ = env.reset(seed=42)
        for _ in range(decisions):
            actions = dict.fromkeys(env.agents, 0)
            if "mine" in actions:
                actions["mine"] = int(observations["mine"][1] < 8.0)
            observations, rewards, *_ = env.step(actions)
            total += rewards.get("mine", 0.0)
    finally:
        env.close()
    return total


class Acceleration(Feature):
    """Acceleration along the heading, 1 at 10 m/s^2."""

    def bind(self, *out):
        """Return the function that writes the numbers of the agents in its mask, shape (B, n, 1)."""
        (numbers,) = out
        world, agent_ids = self.context.scene.world, self.context.agent_ids

        def observe(observe_mask):
            rows, agents = np.nonzero(observe_mask)
            slots = world.agents.slot[rows, agent_ids[agents]]
            numbers[rows, agents, 0] = np.clip(world.vehicles.acceleration[rows, slots] / 10.0, -1.0, 1.0)

        return observe


def hurried(step) -> np.ndarray:
    """Return the reward of a step of 0.1 s: what is missing to 10 m/s is a cost."""
    return -0.002 * np.maximum(0.0, 10.0 - step.speed)


def by_arrays(decisions: int = 20) -> float:
    """Drive eight agents of two simulations, which observe their acceleration; return the rewards' sum."""
    observation = {"base": "benchmark", "features": [Acceleration]}
    env = VectorHiWayEnv(2, ["loop"], adapter_options={"observation": observation, "reward": hurried})
    total = 0.0
    try:
        env.reset(42)
        for _ in range(decisions):
            total += float(env.step([np.zeros((2, 4), np.int64)]).rewards.sum())
    finally:
        env.close()
    return total


def main() -> tuple[float, float]:
    """Run both; return their rewards."""
    rewards = by_spec(), by_arrays()
    print(f"by spec {rewards[0]:.2f}, by arrays {rewards[1]:.2f}")
    return rewards


if __name__ == "__main__":
    main()
