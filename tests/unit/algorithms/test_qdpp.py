"""Q-DPP: determinants by enumeration, the sampler's probabilities, VDN as a special case, and two games."""

from itertools import product

import numpy as np
import pytest
import torch
from rigs import Rig, replayed
from test_qtran import matrix_score

from algorithms.parts.distributions import CategoricalDistribution, Exploration
from algorithms.qdpp import Items, QDPPModule, choose_in_turn, greedy_in_turn, log_volume
from tests.games.games import Ragged

REPLAY = {"learning_starts": 1, "capacity": 1000, "batch_size": 32}


def random_items(agents=3, actions=4, size=5, rows=1, seed=0):
    """Return what agents can do in some rows, in double precision."""
    generator = torch.Generator().manual_seed(seed)
    kind = {"generator": generator, "dtype": torch.float64}
    vectors = torch.randn(rows, agents, actions, size, **kind)
    quality = torch.randn(rows, agents, actions, **kind)
    return Items(quality, torch.nn.functional.normalize(vectors, dim=-1), None)


def kernel_determinants(items):
    """Return det L_Y of all joint actions of the first row, from the whole kernel of all pairs."""
    _, agents, actions = items.quality.shape
    root = np.exp(items.quality[0].flatten().numpy() / 2)
    every = items.vectors[0].flatten(0, 1).numpy()
    kernel = root[:, None] * (every @ every.T) * root[None, :]
    found = {}
    for joint in product(range(actions), repeat=agents):
        rows = [i * actions + a for i, a in enumerate(joint)]
        found[joint] = np.linalg.det(kernel[np.ix_(rows, rows)])
    return found


def weigh(items, joint):
    """Return Q(o, a) of a joint action in all rows."""
    actions = torch.tensor(joint).expand(items.quality.shape[:2])
    quality, vectors = items.of(actions)
    return quality.sum(-1) + log_volume(vectors)


def in_turn_probabilities(items):
    """Return by joint action the probability that the sampler draws it, from its conditional ones."""
    found = {}
    for joint in product(range(items.quality.shape[2]), repeat=items.quality.shape[1]):
        forced = iter(joint)
        (drawn,) = choose_in_turn([items], lambda weights, f=forced: torch.tensor([next(f)]))
        assert drawn.actions[0].tolist() == list(joint)
        chances = drawn.distribution[0]
        found[joint] = float(np.prod([chances[i, a] for i, a in enumerate(joint)]))
    return found


def test_the_value_of_a_joint_action_is_the_logarithm_of_its_minor_of_the_whole_kernel():
    items = random_items()
    for joint, determinant in kernel_determinants(items).items():
        assert weigh(items, joint).item() == pytest.approx(np.log(determinant), rel=1e-9)


def test_the_gradient_of_the_diversity_is_that_of_finite_differences():
    vectors = random_items(rows=2).vectors[:, :, 0].clone().requires_grad_()
    assert torch.autograd.gradcheck(log_volume, vectors)


def test_the_sampler_draws_joint_actions_by_their_determinants_over_its_normalisers():
    """One action of each agent; what is drawn after an agent depends on its action through its vector."""
    items = random_items()
    determinants, found = kernel_determinants(items), in_turn_probabilities(items)
    assert sum(found.values()) == pytest.approx(1)
    for joint, chance in found.items():
        norm = 1.0
        for i in range(3):
            before = items.vectors[0, torch.arange(i), torch.tensor(joint[:i], dtype=torch.int64)]
            projection = torch.eye(5, dtype=torch.float64) - torch.linalg.pinv(before) @ before
            left = items.vectors[0, i] @ projection
            norm *= float((items.quality[0, i].exp() * left.square().sum(-1)).sum())
        assert chance == pytest.approx(determinants[joint] / norm, rel=1e-9)


def test_frequencies_follow_the_probabilities_and_masked_actions_are_not_drawn():
    items, count = random_items(agents=2, actions=3), 20_000
    mask = torch.ones(count, 2, 3, dtype=torch.bool)
    many = Items(items.quality.expand(count, -1, -1), items.vectors.expand(count, -1, -1, -1), mask)
    generator = torch.Generator().manual_seed(0)
    draw = lambda weights: CategoricalDistribution(weights).sample(generator)  # noqa: E731
    (drawn,) = choose_in_turn([many], draw)
    for (a, b), chance in in_turn_probabilities(items).items():
        share = (drawn.actions == torch.tensor([a, b])).all(-1).double().mean().item()
        assert abs(share - chance) < 5 * (chance * (1 - chance) / count) ** 0.5 + 1e-4
    (drawn,) = choose_in_turn([many], draw, temperature=0.3)
    shares = torch.nn.functional.one_hot(drawn.actions[:, 0], 3).double().mean(0)
    torch.testing.assert_close(shares, drawn.distribution[0, 0], rtol=0, atol=0.02)
    mask[:, 1, 2] = False
    (drawn,) = choose_in_turn([many], draw)
    assert (drawn.actions[:, 1] != 2).all()


def test_the_greedy_choice_in_turn_maximises_each_agents_share_of_the_value():
    items = random_items(rows=30)
    (chosen,) = greedy_in_turn([items])
    for row in range(30):
        each = Items(items.quality[row : row + 1], items.vectors[row : row + 1], None)
        prefix: list[int] = []
        for i in range(3):
            part = Items(each.quality[:, : i + 1], each.vectors[:, : i + 1], None)
            gains = [weigh(part, [*prefix, a]).item() for a in range(4)]
            prefix.append(int(np.argmax(gains)))
        assert chosen.actions[row].tolist() == prefix


def test_greedy_agents_act_in_turn_and_one_that_is_asked_alone_takes_its_own_best_action():
    rig = Rig("qdpp", Ragged, sharing="all")
    net, view = rig.learner.net("shared"), replayed(rig, 60).view(rig.spec.groups[0])
    with torch.no_grad():
        for parameter in net.parameters():
            parameter.copy_(torch.randn(parameter.shape, generator=torch.Generator().manual_seed(0)))
        (told,) = QDPPModule.act_jointly([net], [view], Exploration(explore=False), torch.Generator())
        (expected,) = greedy_in_turn([net.items(view, net.q)])
        own_best = net.policy(view).argmax(-1)
        alone = net.forward_inference({"obs": view.observations[""][:, 0]})["actions"]
    assert torch.equal(told.actions, expected.actions)
    assert not torch.equal(told.actions, own_best)
    assert torch.equal(alone, own_best[:, 0])


@pytest.mark.parametrize("double", [False, True])
@pytest.mark.parametrize("sharing", ["none", "all", {"odd": ["b"], "even": ["a", "c"]}])
def test_the_temporal_difference_is_written_out(sharing, double, monkeypatch):
    """Over active agents only: an inactive one adds neither quality nor rows to the determinant."""
    settings = {"gamma": 0.9, "reward_scale": 2.0, "double": double, "own_share": 0.1}
    rig, found = Rig("qdpp", Ragged, sharing=sharing, **settings, **REPLAY), []
    rig.learner.update_joint(rig.rollout(60))
    batch = replayed(rig, 60)
    assert not batch.alive.all()
    monkeypatch.setattr(rig.learner, "step_optimizer", lambda loss, *names: found.append(loss.item()))
    monkeypatch.setattr(rig.learner, "polyak_update", lambda *names, tau: None)
    rig.learner.update_minibatch(batch)
    groups, expected = [g for g, _ in batch.groups()], []
    with torch.no_grad():
        now, following = rig.learner.items(batch, "q"), rig.learner.items(batch.next, "target_q")
        quality = batch.join({name: each.quality for name, each in now.items()})
        vectors = batch.join({name: each.vectors.flatten(2) for name, each in now.items()})
        vectors = vectors.unflatten(2, (3, -1))
        taken, chosen = batch.actions[0], rig.learner.items(batch.next, "q" if double else "target_q")
        chosen = [each.actions for each in greedy_in_turn(list(chosen.values()))]
        after = {g.id: following[g.id].of(own) for g, own in zip(groups, chosen, strict=True)}
        after_quality = batch.next.join({name: part[0] for name, part in after.items()})
        after_vectors = batch.next.join({name: part[1] for name, part in after.items()})

    def value(there, qualities, own):
        active = there.nonzero()[:, 0]
        gram = own[active] @ own[active].T
        return float(qualities[active].sum() + torch.logdet(gram)) if len(active) else 0.0

    for m in range(len(batch)):
        if batch.alive[m].any():
            rows = torch.arange(3)
            present = value(batch.alive[m], quality[m, rows, taken[m]], vectors[m, rows, taken[m]])
            target = 2 * float(batch.rewards[m][batch.alive[m]].sum())
            target += 0.9 * value(batch.next.alive[m], after_quality[m], after_vectors[m])
            expected.append((present - target) ** 2)
    assert found == [pytest.approx(np.mean(expected), rel=1e-4)]


@pytest.mark.parametrize("double", [True, False])
def test_with_orthogonal_vectors_it_is_vdn(double):
    """`own_share=1`: each agent's vectors are a direction of its own; one step moves both alike."""
    settings = {"double": double, "lr": 1e-3, **REPLAY}
    rig, vdn = Rig("qdpp", Ragged, own_share=1.0, **settings), Rig("vdn", Ragged, **settings)
    for agent in "abc":
        ours = rig.learner.net(agent).state_dict()
        vdn.learner.net(agent).load_state_dict({k: v for k, v in ours.items() if "diversity" not in k})
    batch = replayed(rig, 60)
    rig.learner.update_minibatch(batch)
    vdn.learner.update_minibatch(batch)
    for agent, weights in vdn.weights().items():
        for name, weight in weights.items():
            torch.testing.assert_close(weight, rig.weights()[agent][name], rtol=1e-4, atol=1e-6)


@pytest.mark.nightly
def test_qdpp_finds_the_optimum_of_a_matrix_that_is_not_monotonic():
    assert matrix_score(1, "qdpp", reward_scale=0.1) == 8
