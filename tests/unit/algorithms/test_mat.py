"""MAT: what is heard, acting in turn equals learning at once, and thieves that choose the same door."""

import pytest
import torch
from rigs import Rig

from algorithms.joint.batch import GroupView, encode
from algorithms.parts.attention import MultiHeadAttention
from tests.games.doors import Doors
from tests.games.games import Ragged, Target

GONE = 1


def network(rows=6, agents=3):
    """Return MAT's network for three agents, and what they see: one of them is gone in the first rows."""
    net = Rig("mat", Ragged, blocks=2, attention_heads=4).learner.net("shared")
    seen = torch.randn(rows, agents, 3, requires_grad=True)
    alive = torch.ones(rows, agents, dtype=torch.bool)
    alive[: rows // 2, GONE] = False
    return net, seen, GroupView({"": seen}, alive, None)


def felt(outputs, source):
    """Return which of the agents j in `source` (M, n, d) change the outputs of agent i, (M, i, j)."""
    columns = [
        (torch.autograd.grad(outputs[:, i].square().sum(), source, retain_graph=True)[0] != 0).any(-1)
        for i in range(outputs.shape[1])
    ]
    return torch.stack(columns, 1)


def test_the_place_of_an_absent_agents_action_is_not_heard():
    """Place i + 1 holds the action of agent i; agent i + 1 itself decides there."""
    net, _, view = network()
    alive = view.alive.roll(-GONE, 1)  # the first agent is gone
    places = torch.randn(6, 3, net.act[0].out_features, requires_grad=True)
    net.act.forward = lambda before: places
    outputs = net.decide(net.represent(view).detach(), torch.zeros(6, 3, 3), alive)
    wanted = torch.ones(6, 3, 3).bool().tril()
    wanted[:3, 2, 1] = False
    assert torch.equal(felt(outputs, places), wanted)


class Walls(Target):
    """`Target` for agents that share a network of one kind of space."""


@pytest.mark.parametrize("game", [Ragged, Walls])
def test_learning_at_once_gives_the_probabilities_of_acting_one_after_another(game):
    rig = Rig("mat", game, blocks=2, attention_heads=4)
    rig.learner.update_joint(rig.rollout(32))
    batch = rig.learner.prepare(rig.rollout(32))
    ((group, own),) = batch.groups()
    net = rig.learner.net(group.id)
    outputs = net.decide(net.represent(own), encode(group, own.actions), own.alive)
    policy = net.head.distribution(outputs, own.action_mask)
    found = policy.log_prob(own.actions)
    torch.testing.assert_close(found[own.alive], own.log_prob[own.alive], rtol=0, atol=1e-5)


def test_the_network_is_that_of_the_authors_code():
    """Written out: actions that enter and both heads are normalised as the blocks are."""
    net, _, view = network()
    for parameter in net.parameters():
        torch.nn.init.normal_(parameter, std=0.4)
    gelu, taken = torch.nn.functional.gelu, torch.nn.functional.one_hot(torch.randint(3, (6, 3)), 3).float()
    acted = torch.cat([torch.ones(6, 1, dtype=torch.bool), view.alive[:, :-1]], -1)
    heard = [each[:, None] | torch.eye(3).bool() for each in (view.alive, acted)]
    heard[1] = heard[1] & torch.ones(3, 3).bool().tril()

    def normed(x, norm):
        x = (x - x.mean(-1, keepdim=True)) / (x.var(-1, correction=0, keepdim=True) + 1e-5).sqrt()
        return x * norm.weight + norm.bias

    def linear(x, layer):
        return x @ layer.weight.T + (0 if layer.bias is None else layer.bias)

    def two(x, layers):
        return linear(gelu(linear(x, layers[0])), layers[2])

    def head(x, layers):
        return linear(normed(gelu(linear(x, layers[0])), layers[2]), layers[3])

    with torch.no_grad():
        x = normed(gelu(linear(net.see(view.observations), net.first[0])), net.first[2])
        for block in net.encoder:
            x = normed(x + block.attention(x, x, heard[0]), block.norms[0])
            x = normed(x + two(x, block.body), block.norms[1])
        torch.testing.assert_close(net.value(net.represent(view)), head(x, net.baseline)[..., 0])
        seen = x * view.alive[..., None]
        before = torch.zeros(6, 3, 4)
        before[:, 0, 0], before[:, 1:, 1:] = 1, (taken * view.alive[..., None])[:, :-1]
        x = normed(gelu(linear(before, net.act[0])), net.act[2])
        for block in net.decoder:
            x = normed(x + block.actions(x, x, heard[1]), block.norms[0])
            x = normed(seen + block.agents(seen, x, heard[1]), block.norms[1])
            x = normed(x + two(x, block.body), block.norms[2])
        found = net.decide(net.represent(view), taken, view.alive)
        torch.testing.assert_close(found, head(x, net.last), rtol=1e-4, atol=1e-4)


def test_attention_is_that_of_torch():
    ours, theirs = MultiHeadAttention(8, 2), torch.nn.MultiheadAttention(8, 2, batch_first=True)
    with torch.no_grad():
        theirs.in_proj_weight.copy_(torch.cat([x.weight for x in (ours.query, ours.key, ours.value)]))
        theirs.in_proj_bias.copy_(torch.cat([x.bias for x in (ours.query, ours.key, ours.value)]))
        theirs.out_proj.weight.copy_(ours.join.weight)
        theirs.out_proj.bias.copy_(ours.join.bias)
        queries, places = torch.randn(5, 4, 8), torch.randn(5, 4, 8)
        heard = torch.ones(4, 4, dtype=torch.bool).tril()
        expected = theirs(queries, places, places, attn_mask=~heard, need_weights=False)[0]
        torch.testing.assert_close(ours(queries, places, heard), expected, rtol=1e-5, atol=1e-6)


def test_the_loss_is_the_clipped_surrogate_the_values_error_and_the_entropy(monkeypatch):
    settings = {"clip": 0.1, "entropy_coeff": 0.03, "value_coeff": 0.5, "normalize_values": False}
    rig, losses = Rig("mat", Ragged, **settings), []
    rig.learner.update_joint(rig.rollout(32))
    batch = rig.learner.prepare(rig.rollout(32))
    batch = type(batch)(
        **{**vars(batch), "log_prob": batch.log_prob + 0.3 * torch.randn(batch.log_prob.shape)}
    )
    monkeypatch.setattr(rig.learner, "step_optimizer", lambda loss, *modules: losses.append((loss, modules)))
    rig.learner.update_minibatch(batch)
    ((group, own),) = batch.groups()
    net, total, there = rig.learner.net("shared"), 0.0, 0
    with torch.no_grad():
        represented = net.represent(own)
        outputs = net.decide(represented, encode(group, own.actions), own.alive)
        shares, values = outputs.softmax(-1), net.value(represented)
        for m, i in own.alive.nonzero().tolist():
            ratio = (shares[m, i, own.actions[m, i]].log() - own.log_prob[m, i]).exp()
            gain = own.advantages[m, i]
            clipped = min(ratio * gain, ratio.clamp(0.9, 1.1) * gain)
            entropy = -(shares[m, i] * shares[m, i].log()).sum()
            total += -clipped - 0.03 * entropy + 0.5 * (values[m, i] - own.targets[m, i]) ** 2
            there += 1
    ((loss, modules),) = losses
    assert modules == ("shared",)
    assert loss.item() == pytest.approx((total / there).item(), rel=1e-4)


def doors_score(name, seed, updates=60):
    """Return how often thieves that draw their actions choose the same new door."""
    own = {"blocks": 1} if name == "mat" else {"sharing": "all"}
    rig = Rig(name, Doors, seed=seed, gamma=0.0, lr=3e-3, entropy_coeff=0.03, minibatch_size=None, **own)
    for _ in range(updates):
        rig.learner.update_joint(rig.rollout(64))
    return rig.rollout(1000).rewards.mean()


@pytest.mark.nightly
def test_thieves_that_see_the_firsts_choice_are_random_and_equal():
    """3/4; 1/4 where actions are independent."""
    assert doors_score("mat", 1) > 0.5
