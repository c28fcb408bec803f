"""Net-Q: joint actions and their max, the consensus, when it equals the centralised fit, and a game."""

import copy
import itertools
from dataclasses import replace

import numpy as np
import pytest
import torch
from rigs import Rig, moved, replayed

import algorithms
from algorithms.errors import SpaceError
from algorithms.networked_q import NetworkedQModule, node_links
from algorithms.parts.graph import consensus_rate
from tests.games.games import Game, Ragged, Target

REPLAY = {"learning_starts": 1, "capacity": 1000, "batch_size": 32}


@pytest.mark.parametrize("sharing", ["none", "all", {"odd": ["b"], "even": ["a", "c"]}])
def test_own_values_are_the_best_over_all_possible_joint_actions(sharing):
    """By enumeration; the dead can do nothing but action 0."""
    rig = Rig("networked_q", Ragged, sharing=sharing, consensus=sharing != "all")
    rollout = rig.rollout(20, epsilon=1.0)
    rig.learner.replay.add(rollout)
    batch = rig.learner.replay.sample(np.random.default_rng(0), 20)
    nets = [rig.learner.net(g.id) for g in rig.spec.groups]
    views = [batch.view(g) for g in rig.spec.groups]
    with torch.no_grad():
        found = NetworkedQModule.policies(nets, views)
        for net, group, values in zip(nets, rig.spec.groups, found, strict=True):
            order = [a for g in rig.spec.groups for a in g.agents]
            table = net.q(views)
            alive = torch.cat([v.alive for v in views], 1)
            for m in range(len(batch)):
                best = {}
                for number, joint in enumerate(itertools.product(range(3), repeat=3)):
                    if any(a and not alive[m, k] for k, a in enumerate(joint)):
                        continue
                    for agent in group.agents:
                        key = agent, joint[order.index(agent)]
                        best[key] = max(best.get(key, -np.inf), table[m, number].item())
                for (agent, action), value in best.items():
                    found_value = values[m, group.agents.index(agent), action].item()
                    assert found_value == pytest.approx(value, rel=1e-6)


def twins(graph, **settings):
    """Return a learner of independent nodes, and one of a single node of all agents, of equal weights."""
    several = Rig("networked_q", Ragged, {"crash": 0.0}, graph=graph, **REPLAY, **settings)
    alone = {**REPLAY, **settings, "sharing": "all", "consensus": False}
    single = Rig("networked_q", Ragged, {"crash": 0.0}, **alone)
    weights = copy.deepcopy(single.learner.net("shared").state_dict())
    # Alone, each agent's flag stands behind its observation; together, all flags stand at the end.
    order = [0, 1, 2, 9, 3, 4, 5, 10, 6, 7, 8, 11]
    for name in ("q.trunk.0.weight", "target_q.trunk.0.weight"):
        weights[name] = weights[name][:, order]
    for group in several.spec.groups:
        several.learner.net(group.id).load_state_dict(weights)
    return several, single


def test_on_a_complete_graph_every_node_takes_the_centralised_fits_steps():
    """Adapt-then-combine with weights 1/N averages the gradients in every step."""
    several, single = twins("all", fit_steps=4, lr=1e-2)
    several.learner.replay.add(several.rollout(60, epsilon=1.0))
    batch = several.learner.replay.sample(np.random.default_rng(0), 32)
    for update in range(1, 11):
        for rig in (several, single):
            rig.learner.updates = update
            rig.learner.update_minibatch(replace(batch, spec=rig.spec))
    for group in several.spec.groups:
        ours = q_of_all(several.learner.net(group.id), several, batch)
        theirs = q_of_all(single.learner.net("shared"), single, batch)
        torch.testing.assert_close(ours, theirs, rtol=1e-3, atol=1e-4)


def q_of_all(net, rig, batch):
    """Return a network's values of all joint actions."""
    with torch.no_grad():
        return net.q([batch.view(g) for g in rig.spec.groups])


def test_mixing_keeps_the_mean_and_respects_the_graph():
    rig = Rig("networked_q", Ragged, graph=[("a", "b"), ("b", "c")], **REPLAY)
    batch = replayed(rig, 60, epsilon=1.0)
    mixing = rig.learner.mixing(batch)
    assert mixing[0, 2] == mixing[2, 0] == 0
    before = torch.stack([torch.nn.utils.parameters_to_vector(p) for p in rig.learner._fitted.values()])
    rig.learner.average(mixing)
    after = torch.stack([torch.nn.utils.parameters_to_vector(p) for p in rig.learner._fitted.values()])
    torch.testing.assert_close(after.mean(0), before.mean(0))
    torch.testing.assert_close(after, mixing @ before)
    assert 0 < consensus_rate(mixing) < 1


def test_an_agents_gradient_feels_its_own_rewards_only():
    rig = Rig("networked_q", Ragged, **REPLAY)
    batch = replayed(rig, 60, epsilon=1.0)
    first = rig.learner.local_gradients(batch)
    batch.rewards[:, 1] += batch.alive[:, 1] * torch.linspace(-3, 3, len(batch))
    second = rig.learner.local_gradients(batch)
    assert (first != second).any(1).tolist() == [False, True, False]


@pytest.mark.parametrize("consensus", [True, False])
def test_another_agents_reward_reaches_a_node_through_the_graph_only(consensus):
    rig, other = (Rig("networked_q", Ragged, graph="all", consensus=consensus, **REPLAY) for _ in range(2))
    batch = replayed(rig, 60, epsilon=1.0)
    rig.learner.update_minibatch(batch)
    batch.rewards[:, 1] += batch.alive[:, 1] * torch.linspace(-3, 3, len(batch))
    other.learner.update_minibatch(batch)
    assert moved(rig.weights(), other.weights()) == ({"a", "b", "c"} if consensus else {"b"})


def test_groups_are_linked_where_two_agents_hear_each_other():
    groups = Rig("networked_q", Ragged, sharing={"odd": ["b"], "even": ["a", "c"]}).spec.groups
    one_way = torch.zeros(3, 3, dtype=torch.bool)
    one_way[0, 1] = True
    assert not node_links(one_way, groups).any()
    one_way[1, 0] = True
    assert node_links(one_way, groups).tolist() == [[False, True], [True, False]]


def test_what_cannot_be_fitted_is_refused():
    with pytest.raises(SpaceError, match="27"):
        Rig("networked_q", Ragged, max_joint_actions=20)
    with pytest.raises(SpaceError, match="graph="):
        Rig("networked_q", Ragged, graph=[("a", "b")])
    with pytest.raises(SpaceError, match=r"^action space: "):
        Rig("networked_q", Target)
    assert algorithms.entry("networked_q").communication


class Gifts(Game):
    """Four agents; each pays 1 for its own hit, and gets 2 for that of the agent opposite on the ring.

    The team earns 1 a head where everybody hits; who minds his own reward never hits: 0. Guessing: 0.5.
    """

    def __init__(self, config=None):
        super().__init__(agents=4, width=2)

    def observe(self):
        self.cue = self.rng.integers(2, size=4)
        return {f"agent_{i}": np.eye(2, dtype=np.float32)[c] for i, c in enumerate(self.cue)}

    def reward(self, actions):
        hits = [float(a == c) for a, c in zip(actions, self.cue, strict=True)]
        return [2 * hits[(i + 2) % 4] - hits[i] for i in range(4)]


def gifts_score(seed, **settings):
    """Return what an agent earns a step after learning, greedily."""
    learn = {"learning_starts": 200, "updates_per_step": 0.25, "batch_size": 64, "lr": 3e-3, "gamma": 0.0}
    rig = Rig("networked_q", Gifts, seed=seed, hidden=(64,), graph="ring", fit_steps=25, **learn, **settings)
    rig.learn(4_000, explore=lambda done: {"epsilon": max(1 - done / 3_000, 0.1)})
    return rig.rollout(200, explore=False).rewards.mean()


def test_agents_on_a_ring_serve_the_team():
    """1.0; without consensus 0, by guessing 0.5."""
    assert gifts_score(1) > 0.75
