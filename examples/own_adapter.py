"""Two ways to say what agents see and are paid for: adapters of a spec, and an adapter for arrays."""

import numpy as np
from gymnasium.spaces import Box

from smarts.agents import AgentSpec
from smarts.env import VectorHiWayEnv, hiway_parallel_env
from smarts.env.adapters.benchmark import BenchmarkAdapter, benchmark_interface


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


class HurriedAdapter(BenchmarkAdapter):
    """The benchmark's observation; a decision also costs what is missing to 10 m/s."""

    def collect(self, frame, is_last):
        """Take the speed off the reward of those whose decision ends."""
        settle = self._served.present(frame) if is_last else self._served.ended(frame)
        before = self._is_new.copy()
        super().collect(frame, is_last)
        rows, agents = np.nonzero(settle & ~before)
        slots = frame.world.agents.slot[rows, self._served.agent_ids[agents]]
        missing = np.maximum(0.0, 10.0 - frame.world.vehicles.speed[rows, slots])
        self.rewards[rows, agents] -= 0.01 * missing


def by_arrays(decisions: int = 20) -> float:
    """Drive eight agents of two simulations with an array adapter; return the sum of their rewards."""
    env = VectorHiWayEnv(2, ["loop"], adapter=HurriedAdapter)
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
