"""One agent that keeps its lane on the loop: the paper's "Building Agents", run to the end of an episode."""

from typing import Any

import gymnasium as gym

from smarts.agents import AgentInterface, AgentPolicy, AgentSpec, AgentType


def main(max_steps: int = 100) -> float:
    """Play one episode; return the metres that were driven."""
    agent_spec = AgentSpec(
        interface=AgentInterface.from_type(AgentType.Laner, max_episode_steps=max_steps),
        policy_params={"policy_function": lambda _: "keep_lane"},
        policy_builder=AgentPolicy.from_function,
    )
    env = gym.make("smarts.env:hiway-v0", scenarios=["loop"], agent_specs={"Agent-007": agent_spec})
    agent = agent_spec.build_agent()
    try:
        observations, _ = env.reset(seed=42)
        infos, is_over = {}, {"__all__": False}
        while not is_over["__all__"]:
            actions = {name: agent.act(seen) for name, seen in observations.items()}
            step: Any = env.step(actions)
            observations, _, is_over, _, infos = step
    finally:
        env.close()
    info = infos["Agent-007"]
    print(f"{info['outcome']} after {info['score']:.0f} m")
    return info["score"]


if __name__ == "__main__":
    main()
