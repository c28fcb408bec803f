"""TorchRL on PettingZoo's interface: PPO with one network for four agents at the intersection.

TorchRL comes with BenchMARL, whose task is in `examples/benchmarl_task.py`.
"""

import torch
from tensordict.nn import TensorDictModule
from torchrl.collectors import Collector
from torchrl.envs import PettingZooWrapper, RewardSum, TransformedEnv
from torchrl.envs.utils import MarlGroupMapType
from torchrl.modules import MaskedCategorical, MultiAgentMLP, ProbabilisticActor
from torchrl.objectives import ClipPPOLoss, ValueEstimators

from smarts.env import BlackDeath, hiway_parallel_env

KEYS = {name: ("agents", name) for name in ("reward", "action", "done", "terminated")}


def made() -> TransformedEnv:
    """Return the environment; agents that have ended stay in the batch without effect."""
    env = PettingZooWrapper(
        BlackDeath(hiway_parallel_env(["intersection"], 4)),
        group_map=MarlGroupMapType.ALL_IN_ONE_GROUP,
        done_on_any=False,
        categorical_actions=True,
    )
    return TransformedEnv(env, RewardSum([KEYS["reward"]], [("agents", "episode_reward")]))


def network(size: int, outputs: int) -> MultiAgentMLP:
    """Return a network that the agents share."""
    return MultiAgentMLP(size, outputs, 4, centralized=False, share_params=True, num_cells=[64, 64])


def main(batches: int = 20, frames: int = 512) -> tuple[float, float]:
    """Train; return the mean returns of the agents in the first and in the last batches."""
    torch.manual_seed(0)
    env = made()
    size = env.observation_spec["agents", "observation"].shape[-1]
    logits = TensorDictModule(network(size, 4), [("agents", "observation")], [("agents", "logits")])
    actor = ProbabilisticActor(
        logits,
        in_keys={"logits": ("agents", "logits"), "mask": ("agents", "action_mask")},
        out_keys=[KEYS["action"]],
        distribution_class=MaskedCategorical,
        return_log_prob=True,
    )
    critic = TensorDictModule(network(size, 1), [("agents", "observation")], [("agents", "state_value")])
    loss = ClipPPOLoss(actor, critic, entropy_coeff=0.01)
    loss.set_keys(**KEYS, value=("agents", "state_value"), sample_log_prob=("agents", "action_log_prob"))
    loss.make_value_estimator(ValueEstimators.GAE, gamma=0.99, lmbda=0.95)
    optimiser = torch.optim.Adam(loss.parameters(), 1e-3)
    collector = Collector(env, actor, frames_per_batch=frames, total_frames=batches * frames)
    scores = []
    for batch in collector:
        with torch.no_grad():
            loss.value_estimator(batch, params=loss.critic_network_params)
        ended = batch["next", "agents", "done"] & ~batch["agents", "done"]
        scores.append(batch["next", "agents", "episode_reward"][ended].mean().item())
        played = batch.reshape(-1)
        for rows in (rows for _ in range(4) for rows in torch.randperm(frames).split(128)):
            parts = loss(played[rows])
            optimiser.zero_grad()
            sum(part for name, part in parts.items() if name.startswith("loss_")).backward()
            optimiser.step()
    collector.shutdown()
    first, last = sum(scores[:3]) / 3, sum(scores[-3:]) / 3
    print(f"mean return {first:.2f} in the first batches, {last:.2f} in the last")
    return first, last


if __name__ == "__main__":
    main()
