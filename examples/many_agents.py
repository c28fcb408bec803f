"""Four agents through PettingZoo: each draws a possible lane action, until all episodes have ended."""

from smarts.env import hiway_parallel_env


def main() -> dict[str, float]:
    """Play one episode; return the agents' returns."""
    env = hiway_parallel_env(["intersection"], agents=4)
    try:
        observations, infos = env.reset(seed=42)
        for agent in env.agents:
            env.action_space(agent).seed(7)
        returns = dict.fromkeys(env.agents, 0.0)
        outcomes = {}
        while env.agents:
            actions = {
                agent: env.action_space(agent).sample(infos[agent]["action_mask"]) for agent in observations
            }
            observations, rewards, terminations, truncations, infos = env.step(actions)
            for agent, reward in rewards.items():
                returns[agent] += reward
                if terminations[agent] or truncations[agent]:
                    outcomes[agent] = infos[agent]["outcome"]
            observations = {agent: observations[agent] for agent in env.agents}
    finally:
        env.close()
    for agent, outcome in sorted(outcomes.items()):
        print(f"{agent}: {outcome}, return {returns[agent]:.2f}")
    return returns


if __name__ == "__main__":
    main()
