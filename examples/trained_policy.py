"""A training of half a minute from Python, and its policy in your own loop."""

import tempfile
from pathlib import Path

from benchmark import Experiment, load_policy, run
from smarts.env import hiway_parallel_env


def main(agent_steps: int = 20_000) -> dict[str, str]:
    """Train PPO on the loop and let it drive; return how the agents' episodes ended."""
    experiment = Experiment(
        name="mine",
        algorithms=["ppo"],
        tasks=["loop"],
        seeds=[1],
        traffic=["no_social_vehicles"],
        training={"sharing": "all"},
        budget={"agent_steps": agent_steps},
        evaluation={"episodes": 2, "modes": ["greedy"], "held_out_episodes": 0, "validations": 1},
        scripted=[],
    )
    with tempfile.TemporaryDirectory() as root:
        run(experiment, out=root)
        policy = load_policy(Path(root) / "mine/ppo/loop/no_social_vehicles/seed_1")
    env = hiway_parallel_env(["loop"], 4, traffic=["no_social_vehicles"])
    outcomes = {}
    try:
        observations, infos = env.reset(seed=42)
        policy.reset()
        while env.agents:
            acting = {agent: observations[agent] for agent in env.agents}
            observations, _, terminated, truncated, infos = env.step(policy.act(acting, infos))
            for agent in terminated:
                if terminated[agent] or truncated[agent]:
                    outcomes[agent] = infos[agent]["outcome"]
    finally:
        env.close()
    print(", ".join(f"{agent}: {outcome}" for agent, outcome in sorted(outcomes.items())))
    return outcomes


if __name__ == "__main__":
    main()
