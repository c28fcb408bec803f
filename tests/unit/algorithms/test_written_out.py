"""Losses and steps written out a second time, with target networks that differ from their originals."""

import pytest
import torch
from rigs import EVERY, OFF_POLICY, Rig, cases, known, replayed

from algorithms.joint.features import MEAN_ACTION
from algorithms.maac import of_actions
from algorithms.maddpg import critic_of
from algorithms.mf_q import mean_actions
from algorithms.parts.distributions import CategoricalDistribution
from algorithms.parts.relaxation import straight_through_gumbel
from algorithms.qmix import MIXER
from tests.games.games import Constant, Ragged, Target

REPLAY = {"learning_starts": 1, "capacity": 1000, "batch_size": 32, "gamma": 0.9}


def unlike_targets(rig):
    """Fill every target network with numbers of its own."""
    for name in rig.learner.module.keys():  # noqa: SIM118 - RLlib's module is no dict
        net = rig.learner.net(name)
        for target in net.targets:
            for p in getattr(net, target).parameters():
                torch.nn.init.normal_(p, std=0.5)


def losses_of(rig, monkeypatch):
    """Record the losses instead of stepping."""
    found = {}
    monkeypatch.setattr(
        rig.learner, "step_optimizer", lambda loss, *names: found.update(dict.fromkeys(names, loss))
    )
    return found


@pytest.mark.parametrize("double", [True, False])
def test_dqns_loss(double, monkeypatch):
    rig = Rig("dqn", Ragged, sharing="all", double=double, reward_scale=2.0, tau=0.0, **REPLAY)
    unlike_targets(rig)
    batch, net = replayed(rig, 60, epsilon=1.0), rig.learner.net("shared")
    found = losses_of(rig, monkeypatch)
    rig.learner.update_minibatch(batch)
    seen, following = batch.observations[0], batch.next.observations[0]
    with torch.no_grad():
        values = net.target_q(following)
        best = (net.q(following) if double else values).argmax(-1)
        target = 2 * batch.rewards + 0.9 * batch.bootstrap * of_actions(values, best)
        error = (of_actions(net.q(seen), batch.actions[0]) - target).abs()
        huber = torch.where(error < 1, error**2 / 2, error - 0.5)
        assert (of_actions(values, best) - values.max(-1)[0]).abs().max() > 0 or not double
    assert found["shared"].item() == pytest.approx(huber[batch.alive].mean().item(), rel=1e-5)


def test_duelling_values_are_the_value_plus_centred_advantages():
    net = Rig("dqn", Constant).learner.net("agent_0").q
    features = torch.randn(5, 1, 16)
    torch.testing.assert_close(net.values(features, {}).mean(-1, keepdim=True), net.value(features))


@pytest.mark.parametrize("reward", ["sum", "mean"])
def test_vdns_loss(reward, monkeypatch):
    rig = Rig("vdn", Ragged, sharing="all", team_reward=reward, double=False, tau=0.0, **REPLAY)
    unlike_targets(rig)
    batch, net = replayed(rig, 60, epsilon=1.0), rig.learner.net("shared")
    found = losses_of(rig, monkeypatch)
    rig.learner.update_minibatch(batch)
    with torch.no_grad():
        best = net.target_q(batch.next.observations[0]).max(-1)[0]
        team = (batch.rewards * batch.alive).sum(-1)
        target = team / (batch.alive.sum(-1) if reward == "mean" else 1) + 0.9 * (
            best * batch.next.alive
        ).sum(-1)
        total = (of_actions(net.q(batch.observations[0]), batch.actions[0]) * batch.alive).sum(-1)
    assert found["shared"].item() == pytest.approx((total - target).square().mean().item(), rel=1e-5)


def test_qmixs_target_asks_the_target_mixer(monkeypatch):
    rig = Rig("qmix", Ragged, sharing="all", double=False, tau=0.0, **REPLAY)
    unlike_targets(rig)
    batch, net, mixer = replayed(rig, 60, epsilon=1.0), rig.learner.net("shared"), rig.learner.net(MIXER)
    found = losses_of(rig, monkeypatch)
    rig.learner.update_minibatch(batch)
    following = batch.next
    with torch.no_grad():
        best = net.target_q(following.observations[0]).max(-1)[0] * following.alive
        value = mixer.target_mixer(best, following) * following.alive.any(-1)
        target = (batch.rewards * batch.alive).sum(-1) + 0.9 * value
        chosen = of_actions(net.q(batch.observations[0]), batch.actions[0]) * batch.alive
        total = mixer.mixer(chosen, batch)
    assert found[MIXER].item() == pytest.approx((total - target).square().mean().item(), rel=1e-5)


@pytest.mark.parametrize("double", [True, False])
def test_networked_qs_loss(double, monkeypatch):
    """The loss equals that of an enumeration of the active agents' joint actions."""
    rig = Rig("networked_q", Ragged, sharing="all", consensus=False, double=double, **REPLAY)
    unlike_targets(rig)
    batch, net, found = replayed(rig, 60, epsilon=1.0), rig.learner.net("shared"), {}
    monkeypatch.setattr(rig.learner, "log", lambda module, name, value: found.update({name: value}))
    rig.learner.local_gradients(batch)
    (group,) = rig.spec.groups
    joint = torch.cartesian_prod(*[torch.arange(3)] * 3)
    with torch.no_grad():
        now, following = net.q([batch.view(group)]), batch.next.view(group)
        values = net.target_q([following])
        ranking = net.q([following]) if double else values
        possible = ((joint == 0) | following.alive[:, None]).all(-1)
        best = of_actions(values, torch.where(possible, ranking, -torch.inf).argmax(-1))
        target = batch.rewards * batch.alive + 0.9 * (best * batch.bootstrap.any(-1))[:, None]
        taken = of_actions(now, batch.actions[0] @ torch.tensor([9, 3, 1]))
        expected = (taken[:, None] - target).square().mean()
    assert found["fit_loss"].item() == pytest.approx(expected.item(), rel=1e-5)


@pytest.mark.parametrize("game", [Ragged, Target])
def test_maddpgs_critic_loss(game, monkeypatch):
    rig = Rig("maddpg", game, sharing="all", **REPLAY)
    unlike_targets(rig)
    batch, net = replayed(rig, 60), rig.learner.net("shared")
    critic = rig.learner.net(critic_of(rig.spec.groups[0]))
    found, state = losses_of(rig, monkeypatch), rig.learner.generator.get_state()
    rig.learner.fit_critics(batch, batch.encoded_actions())
    rig.learner.generator.set_state(state)
    there = batch.next.alive[..., None]
    with torch.no_grad():
        outputs = net.target_actor(batch.next.observations[0])
        if game is Target:
            chosen = outputs.tanh() * there
        else:
            chosen = straight_through_gumbel(outputs, None, rig.learner.generator) * there
        following = critic.target_q(batch.next, {"shared": chosen})
        target = batch.rewards + 0.9 * batch.bootstrap * following
        error = critic.q(batch, batch.encoded_actions()) - target
    expected = error[batch.alive].square().mean().item()
    assert found[critic_of(rig.spec.groups[0])].item() == pytest.approx(expected, rel=1e-5)


def test_gumbel_samples_follow_the_policy():
    logits = torch.tensor([0.0, 1.0, 2.0]).log_softmax(-1)
    drawn = straight_through_gumbel(logits.expand(20_000, 3), None, torch.Generator().manual_seed(0)).mean(0)
    torch.testing.assert_close(drawn, logits.exp(), rtol=0, atol=0.015)


def test_mf_acs_losses(monkeypatch):
    rig = Rig("mf_ac", Ragged, sharing="all", entropy_coeff=0.1, tau=0.0, **REPLAY)
    unlike_targets(rig)
    batch, net = replayed(rig, 60), rig.learner.net("shared")
    name = critic_of(rig.spec.groups[0])
    critic, means = rig.learner.net(name), mean_actions(batch, rig.learner.neighbourhood)
    found = losses_of(rig, monkeypatch)
    rig.learner.update_minibatch(batch)
    seen = {**batch.observations[0], MEAN_ACTION: means}
    with torch.no_grad():
        following = critic.target_q({**batch.next.observations[0], MEAN_ACTION: means})
        policy = CategoricalDistribution(net.target_actor(batch.next.observations[0])).log_probs.exp()
        target = batch.rewards + 0.9 * batch.bootstrap * (policy * following).sum(-1)
        error = of_actions(critic.q(seen), batch.actions[0]) - target
        own = CategoricalDistribution(net.actor(batch.observations[0])).log_probs
        gain = (own.exp() * (critic.q(seen) - 0.1 * own)).sum(-1)
    assert found[name].item() == pytest.approx(error[batch.alive].square().mean().item(), rel=1e-5)
    assert found["shared"].item() == pytest.approx(-gain[batch.alive].mean().item(), rel=1e-5)


@pytest.mark.parametrize("name", cases(OFF_POLICY))
def test_target_networks_follow_by_tau_in_every_update(name):
    own = known(name, {"tau": 0.25})
    tau = own.get("tau", 1.0)  # networked_q copies, every so often
    rig = Rig(name, Constant, **own, **REPLAY)
    unlike_targets(rig)
    batch, before = replayed(rig, 16), rig.weights()
    rig.learner.update_minibatch(batch)
    after, followed = rig.weights(), 0
    for module, own in after.items():
        for key in (k for k in own if k.startswith("target_")):
            expected = (1 - tau) * before[module][key] + tau * own[key.removeprefix("target_")]
            torch.testing.assert_close(own[key], expected)
            followed += 1
    assert followed


class Single(Constant):
    """One step, which is the end: whoever values what follows gets more than 1."""

    length, ends = 1, True


class Double(Single):
    """The same, paid double."""

    def reward(self, actions):
        return [2.0, 2.0]


@pytest.mark.parametrize("name", cases(OFF_POLICY))
def test_nothing_follows_an_end(name):
    """Weights move alike whatever target networks, discount and next moments say."""
    moves = []
    for gamma in (0.0, 0.9):
        rig = Rig(name, Single, **{**REPLAY, "gamma": gamma})
        torch.manual_seed(5)
        unlike_targets(rig)
        rig.learner.update_minibatch(replayed(rig, 8))
        moves.append(rig.weights())
    for module, own in moves[0].items():
        for key, weight in own.items():
            torch.testing.assert_close(weight, moves[1][module][key], rtol=0, atol=0)


@pytest.mark.parametrize("name", EVERY)
def test_scaled_rewards_are_paid_rewards(name):
    settings = known(name, {**REPLAY, "normalize_advantages": False})
    weights = []
    for game, scale in ((Constant, 2.0), (type("Paid", (Double,), {"length": 10, "ends": False}), 1.0)):
        rig = Rig(name, game, reward_scale=scale, grad_clip=None, **settings)
        before = rig.weights()
        rig.learner.update_joint(rig.rollout(16))
        weights.append(rig.weights())
    assert any(
        not torch.equal(before[m][k], own) for m, part in weights[0].items() for k, own in part.items()
    )
    for module, own in weights[0].items():
        for key, weight in own.items():
            torch.testing.assert_close(weight, weights[1][module][key], rtol=0, atol=0)


def test_the_entropy_bonus_follows_its_schedule(monkeypatch):
    from algorithms.joint.training_data import JointTrainingData

    rig = Rig("ppo", Constant, entropy_coeff=[[0, 1e5], [100, 0.0]])
    learner, losses = rig.learner, []
    step = learner.step_optimizer

    def watched(loss, *modules):
        losses.append(abs(loss.item()))
        step(loss, *modules)

    monkeypatch.setattr(learner, "step_optimizer", watched)
    largest = []
    for steps in (0, 50, 100, 1000):
        losses.clear()
        timesteps = {"num_env_steps_sampled_lifetime": steps}
        learner.update(training_data=JointTrainingData(rig.rollout(8)), timesteps=timesteps)
        largest.append(max(losses))
    # The bonus outweighs all else, or is not there.
    assert largest[0] > largest[1] > 10_000 > 100 > max(largest[2:])
