"""Independent PPO against RLlib's own; centralised-V with local critics against independent PPO."""

from types import SimpleNamespace
from typing import Any

import pytest
import torch
from ray.rllib.algorithms.ppo import PPOConfig as StockConfig
from ray.rllib.algorithms.ppo.torch.ppo_torch_learner import PPOTorchLearner
from ray.rllib.core.columns import Columns
from ray.rllib.core.distribution.torch.torch_distribution import TorchCategorical
from ray.rllib.evaluation.postprocessing import Postprocessing
from ray.rllib.utils.metrics.metrics_logger import MetricsLogger
from rigs import Rig

from algorithms.centralised_v import CRITIC
from algorithms.joint.module import critic_of
from tests.games.games import Cues


def test_losses_and_gradients_are_those_of_rllibs_ppo(monkeypatch):
    rig = Rig("ppo", Cues, clip=0.2, entropy_coeff=0.03)
    rig.learner.update_joint(rig.rollout(32))
    batch = rig.learner.prepare(rig.rollout(32))
    # Old probabilities that put some ratios beyond the clip.
    generator = torch.Generator().manual_seed(0)
    shift = 0.4 * torch.randn(batch.log_prob.shape, generator=generator)
    batch = type(batch)(**{**vars(batch), "log_prob": batch.log_prob + shift})
    losses, ours = [], {}

    def watched(loss, *modules):
        losses.append(loss.item())
        for module in modules:
            parameters = rig.learner.net(module).trained_parameters()
            ours[module] = torch.autograd.grad(loss, parameters, retain_graph=True)

    monkeypatch.setattr(rig.learner, "step_optimizer", watched)
    rig.learner.update_minibatch(batch)
    config = StockConfig().training(
        clip_param=0.2, use_kl_loss=False, vf_clip_param=float("inf"), vf_loss_coeff=1.0
    )
    total = 0.0
    for group, own in batch.groups():
        policy, critic = rig.learner.net(group.id), rig.learner.net(critic_of(group))
        logits = policy.policy(own)[:, 0]
        module = SimpleNamespace(
            get_train_action_dist_cls=lambda: TorchCategorical,
            get_exploration_action_dist_cls=lambda: TorchCategorical,
            compute_values=lambda batch, embeddings, critic=critic, own=own: critic.value(own)[:, 0],
        )
        stock = SimpleNamespace(
            module={"p": SimpleNamespace(unwrapped=lambda module=module: module)},
            entropy_coeff_schedulers_per_module={"p": SimpleNamespace(get_current_value=lambda: 0.03)},
            metrics=MetricsLogger(),
        )
        theirs: Any = PPOTorchLearner.compute_loss_for_module(
            stock,  # type: ignore[arg-type] - the learner's state that the loss reads
            module_id="p",
            config=config,
            batch={
                Columns.ACTION_DIST_INPUTS: logits.detach(),
                Columns.ACTIONS: own.actions[:, 0],
                Columns.ACTION_LOGP: own.log_prob[:, 0],
                Postprocessing.ADVANTAGES: own.advantages[:, 0],
                Postprocessing.VALUE_TARGETS: own.targets[:, 0],
            },
            fwd_out={Columns.ACTION_DIST_INPUTS: logits},
        )
        total += theirs.item()
        for name, net in ((group.id, policy), (critic_of(group), critic)):
            slopes = torch.autograd.grad(theirs, net.trained_parameters(), retain_graph=True)
            for mine, other in zip(ours[name], slopes, strict=True):
                torch.testing.assert_close(mine, other, rtol=1e-4, atol=1e-7)
    assert sum(losses) == pytest.approx(total, rel=1e-5)


def test_centralised_v_with_local_critics_is_independent_ppo(monkeypatch):
    """The central network made block-diagonal: agent i's value from agent i's observation alone."""
    ppo = Rig("ppo", Cues, epochs=2)
    central = Rig("centralised_v", Cues, epochs=2, normalize_values=False)
    first, last = torch.nn.Linear(10, 32), torch.nn.Linear(32, 2)
    with torch.no_grad():
        for layer in (first, last):
            layer.weight.zero_()
        for i, group in enumerate(ppo.spec.groups):
            central.learner.net(group.id).load_state_dict(ppo.learner.net(group.id).state_dict())
            body, own = ppo.learner.net(critic_of(group)).body, slice(16 * i, 16 * i + 16)
            first.weight[own, 4 * i : 4 * i + 4], first.bias[own] = body[0].weight, body[0].bias
            last.weight[i, own], last.bias[i] = body[2].weight[0], body[2].bias[0]
    central.learner.net(CRITIC).body = torch.nn.Sequential(first, torch.nn.Tanh(), last)
    rollout = ppo.rollout(32)
    slopes = {}

    def watched(rig, parameters):
        original = rig.learner.step_optimizer

        def step(loss, *modules):
            if not modules[0].endswith("__critic"):
                return original(loss, *modules)
            for name in modules:
                found = torch.autograd.grad(loss, parameters(name), retain_graph=True)
                slopes.setdefault(name, found)

        return step

    monkeypatch.setattr(
        ppo.learner, "step_optimizer", watched(ppo, lambda name: ppo.learner.net(name).trained_parameters())
    )
    monkeypatch.setattr(
        central.learner, "step_optimizer", watched(central, lambda name: [first.weight, last.weight])
    )
    ppo.learner.update_joint(rollout)
    central.learner.update_joint(rollout)
    for i, group in enumerate(ppo.spec.groups):
        for mine, theirs in zip(
            central.learner.net(group.id).parameters(), ppo.learner.net(group.id).parameters(), strict=True
        ):
            torch.testing.assert_close(mine, theirs, rtol=0, atol=1e-6)
        # The central loss is the mean over agents, so each agent's part counts 1/N.
        alone = slopes[critic_of(group)]
        rows = slice(16 * i, 16 * i + 16)
        torch.testing.assert_close(
            2 * slopes[CRITIC][0][rows, 4 * i : 4 * i + 4], alone[0], rtol=1e-4, atol=1e-7
        )
        torch.testing.assert_close(2 * slopes[CRITIC][1][i, rows], alone[2][0], rtol=1e-4, atol=1e-7)
