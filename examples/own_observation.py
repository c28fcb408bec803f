"""What an agent sees, does and gets as reward, by functions of its spec: two numbers instead of 200."""

import numpy as np
from gymnasium.spaces import Box

from smarts.agents import AgentSpec
from smarts.agents.benchmark import benchmark_interface
from smarts.env import hiway_parallel_env


def speed_and_gap(observation) -> np.ndarray:
    """Return speed [m/s] and distance to the nearest vehicle, at most 50 [m]."""
    ego = observation.ego_vehicle_state
    near = observation.neighborhood_vehicle_states
    gap = np.hypot(*np.subtract(near[0].position, ego.position)[:2]) if near else 50.0
    return np.array([ego.speed, min(gap, 50.0)], np.float32)


def go_or_brake(action) -> str:
    """Return a lane action for 0 or 1."""
    return "slow_down" if action else "keep_lane"


def main(decisions: int = 20) -> float:
    """Drive an agent with two numbers beside one of the benchmark; return its return."""
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
    print(f"return {total:.2f}")
    return total


if __name__ == "__main__":
    main()
