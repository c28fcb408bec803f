"""Gymnasium's `make_vec`: PPO on a page, on eight simulations that one call steps together."""

from typing import Any

import gymnasium as gym
import numpy as np
import torch
from torch import nn
from torch.distributions import Categorical

DISCOUNT, LENGTH, ENVS, CLIP = 0.99, 64, 8, 0.2


class Agent(nn.Module):
    """Chooses among the legal actions, and expects a return."""

    def __init__(self, observation: int, actions: int) -> None:
        super().__init__()
        self.actor = nn.Sequential(nn.Linear(observation, 64), nn.Tanh(), nn.Linear(64, actions))
        self.critic = nn.Sequential(nn.Linear(observation, 64), nn.Tanh(), nn.Linear(64, 1))

    def policy(self, seen: torch.Tensor, mask: torch.Tensor) -> Categorical:
        """Return the distribution of actions."""
        return Categorical(logits=self.actor(seen).masked_fill(~mask, -1e9))

    def value(self, seen: Any) -> torch.Tensor:
        """Return the expected return."""
        return self.critic(torch.as_tensor(seen)).squeeze(-1)


@torch.no_grad()
def collect(envs: Any, agent: Agent, seen: Any, infos: Any, scores: list[float]) -> tuple[Any, Any, dict]:
    """Play `LENGTH` decisions; return where it stands and what was played, with the returns to learn."""
    names = ("seen", "mask", "action", "log_prob", "reward", "end", "next")
    played: dict[str, list] = {name: [] for name in names}
    for _ in range(LENGTH):
        now, mask = torch.as_tensor(seen), torch.as_tensor(infos["action_mask"], dtype=torch.bool)
        policy = agent.policy(now, mask)
        action = policy.sample()
        seen, reward, terminated, truncated, infos = envs.step(action.numpy())
        over, following = terminated | truncated, agent.value(seen)
        if over.any():
            scores += infos["episode"]["r"][over].tolist()
        for row in np.flatnonzero(over):
            # `seen` is the first observation of the next episode; the last one is in the infos.
            following[row] = 0.0 if terminated[row] else agent.value(infos["final_obs"][row])
        step = (now, mask, action, policy.log_prob(action), reward, over, following)
        for name, value in zip(names, step, strict=True):
            played[name].append(torch.as_tensor(value))
    batch = {name: torch.stack(values) for name, values in played.items()}
    target, targets = batch["next"][-1], []
    for step in reversed(range(LENGTH)):
        ahead = torch.where(batch["end"][step], batch["next"][step], target)
        target = batch["reward"][step].float() + DISCOUNT * ahead
        targets.insert(0, target)
    return seen, infos, {name: x.flatten(0, 1) for name, x in batch.items()} | {"target": torch.cat(targets)}


def learn(agent: Agent, optimiser: torch.optim.Optimizer, batch: dict[str, torch.Tensor]) -> None:
    """Take four passes of minibatches over what was played."""
    for rows in (rows for _ in range(4) for rows in torch.randperm(LENGTH * ENVS).split(128)):
        part = {name: values[rows] for name, values in batch.items()}
        policy = agent.policy(part["seen"], part["mask"])
        error = part["target"] - agent.value(part["seen"])
        advantage = (error.detach() - error.mean().detach()) / (error.std().detach() + 1e-6)
        ratio = (policy.log_prob(part["action"]) - part["log_prob"]).exp()
        gain = torch.minimum(ratio * advantage, ratio.clamp(1 - CLIP, 1 + CLIP) * advantage)
        loss = 0.5 * error.square() - gain - 0.01 * policy.entropy()
        optimiser.zero_grad()
        loss.mean().backward()
        optimiser.step()


def main(updates: int = 16) -> tuple[float, float]:
    """Train; return the mean returns of the first and of the last 100 episodes."""
    torch.manual_seed(0)
    envs: Any = gym.make_vec("smarts.env:hiway-single-v0", num_envs=ENVS, scenarios=["intersection"])
    envs = gym.wrappers.vector.RecordEpisodeStatistics(envs)
    agent = Agent(envs.single_observation_space.shape[0], int(envs.single_action_space.n))
    optimiser = torch.optim.Adam(agent.parameters(), 1e-3)
    scores: list[float] = []
    seen, infos = envs.reset(seed=42)
    for _ in range(updates):
        seen, infos, batch = collect(envs, agent, seen, infos, scores)
        learn(agent, optimiser, batch)
    envs.close()
    before, now = float(np.mean(scores[:100])), float(np.mean(scores[-100:]))
    print(f"mean return {before:.2f} of the first 100 episodes, {now:.2f} of the last 100 of {len(scores)}")
    return before, now


if __name__ == "__main__":
    main()
