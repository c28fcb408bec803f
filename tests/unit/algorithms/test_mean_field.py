"""MF-Q and MF-AC: whose actions are in the mean, where it enters, and games that it decides."""

import numpy as np
import pytest
import torch
from gymnasium.spaces import Box, Discrete
from rigs import Rig, nightly_by_seed, replayed

from algorithms.errors import SpaceError
from algorithms.joint.adapter import JointVector
from algorithms.joint.conformance import check_vector_env
from algorithms.joint.env import AgentBlock, JointSpaces, JointStep
from algorithms.joint.features import MEAN_ACTION, WithMeanActions
from algorithms.joint.module import critic_of
from algorithms.joint.neighbours import Near, Neighbourhood
from algorithms.mf_q import mean_actions
from algorithms.parts.communication import mean_over
from algorithms.parts.distributions import BoltzmannHead, Exploration
from tests.games.games import Cues, Game, Ragged, Target

REPLAY = {"learning_starts": 1, "capacity": 1000, "batch_size": 32}
LEARN = {"learning_starts": 200, "updates_per_step": 0.5, "batch_size": 64, "lr": 3e-3, "gamma": 0.0}


class Linked(Ragged):
    """`Ragged`, with a random directed graph in every step."""

    def _infos(self):
        return {"__common__": {"graph": self.rng.random((3, 3)) < 0.5}}

    def reset(self, *, seed=None, options=None):
        return super().reset(seed=seed)[0], self._infos()

    def step(self, action_dict):
        return *super().step(action_dict)[:4], self._infos()


def mean_by_hand(rollout, t, b, i):
    """Return the mean one-hot action of i's living neighbours in step t of copy b."""
    alive, actions = rollout.views.alive[t, b], rollout.actions[0][t, b]
    heard = [j for j in range(3) if j != i and alive[j]]
    if rollout.views.graph is not None:
        heard = [j for j in heard if rollout.views.graph[t, b, i, j]]
    return np.eye(3)[actions[heard]].mean(0) if heard else np.zeros(3)


@pytest.mark.parametrize("game", [Ragged, Linked])
def test_agents_see_exactly_their_living_neighbours_mean_action_of_the_step_before(game):
    """And zeros where a life begins; final rows carry it too."""
    rollout = Rig("mf_q", game).rollout(80)
    chain, seen = rollout.masks().chain, rollout.views.observations[0][MEAN_ACTION]
    counted = 0
    for t, b, i in np.argwhere(rollout.views.alive[1:]):
        expected = mean_by_hand(rollout, t, b, i) if chain[t, b, i] else np.zeros(3)
        np.testing.assert_allclose(seen[t + 1, b, i], expected, rtol=0, atol=1e-6)
        counted += expected.any()
    assert counted > 50
    bootstrap, last = rollout.masks().bootstrap, rollout.final.observations[0][MEAN_ACTION]
    assert len(last) > 10
    for k, (t, b) in enumerate(rollout.final_at):
        for i in np.flatnonzero(bootstrap[t, b]):
            if not rollout.failed[min(t + 1, 79), b]:
                np.testing.assert_allclose(last[k, i], mean_by_hand(rollout, t, b, i), rtol=0, atol=1e-6)


@pytest.mark.parametrize("game", [Ragged, Linked])
def test_the_learners_mean_is_the_one_that_agents_see_next(game):
    rig = Rig("mf_q", game, {"crash": 0.0}, **REPLAY)
    batch = replayed(rig, 60, 300)
    means = mean_actions(batch, rig.learner.neighbourhood)
    seen = batch.next.observations[0][MEAN_ACTION]
    lives = batch.bootstrap & batch.next.alive
    torch.testing.assert_close(means[lives], seen[lives], rtol=0, atol=1e-6)
    assert (means[lives] != 0).any(-1).sum() > 50


def test_the_wrapped_environment_keeps_the_contract():
    check_vector_env(WithMeanActions(JointVector(lambda b: Linked({"crash": 0.0}), 3), "environment"))


def test_a_continued_sampler_sees_the_same_means():
    rig, other = Rig("mf_q", Ragged), Rig("mf_q", Ragged, seed=3)
    rig.rollout(7)
    other.sampler.set_state(rig.sampler.get_state())
    other.policies._modules = rig.policies._modules
    other.policies.refresh()
    first, second = rig.rollout(9), other.rollout(9)
    for name in ("", MEAN_ACTION):
        np.testing.assert_array_equal(first.views.observations[0][name], second.views.observations[0][name])


def test_neighbours_by_distance_ring_and_pairs():
    spaces = JointSpaces((AgentBlock(("a", "b", "c", "d"), {"": Box(-9, 9, (3,))}, Discrete(2)),))
    seen = ({"": torch.tensor([[[0.0, 0.0, 8.0], [0.0, 3.0, 0.0], [0.0, 7.0, 0.0], [5.0, 0.0, 8.0]]])},)
    everybody, without_b = torch.ones(1, 4, dtype=torch.bool), torch.tensor([[True, False, True, True]])
    near = Neighbourhood(spaces, Near(4.0, components=(0, 1)))
    assert near(everybody, None, seen)[0].nonzero().tolist() == [[0, 1], [1, 0], [1, 2], [2, 1]]
    assert not near(without_b, None, seen).any()
    ring = Neighbourhood(spaces, "ring")(without_b, None, seen)[0]
    assert ring.nonzero().tolist() == [[0, 3], [2, 3], [3, 0], [3, 2]]
    pairs = Neighbourhood(spaces, [("a", "d")])(everybody, None, seen)[0]
    assert pairs.nonzero().tolist() == [[0, 3], [3, 0]]


@pytest.mark.parametrize(
    ("graph", "match"),
    [
        ("environment", "no communication graph"),
        ([("a", "x")], "links 'x'"),
    ],
)
def test_graphs_that_cannot_be_are_refused(graph, match):
    with pytest.raises(SpaceError, match=match):
        Rig("mf_q", Ragged, graph=graph)
    with pytest.raises(SpaceError, match="components"):
        Rig("mf_q", Ragged, graph=Near(1.0, components=(0, 7)))


@pytest.mark.parametrize("name", ["mf_q", "mf_ac"])
def test_actions_without_a_mean_are_refused(name):
    class Uneven(Game):
        def __init__(self, config=None):
            super().__init__()
            self.action_spaces = {"agent_0": Discrete(2), "agent_1": Discrete(3)}

    with pytest.raises(SpaceError, match=r"^action space: "):
        Rig(name, Uneven)
    with pytest.raises(SpaceError, match=r"^action space: "):
        Rig(name, Target)


def test_the_boltzmann_policy_is_the_papers():
    head, values = BoltzmannHead(Discrete(3), 0.5), torch.tensor([[[1.0, 2.0, 0.5]]])
    action_mask = torch.tensor([[[True, True, False]]])
    acting = head.act(values, action_mask, Exploration(), torch.Generator().manual_seed(0))
    expected = torch.tensor([np.exp(2.0), np.exp(4.0), 0.0])
    torch.testing.assert_close(acting.distribution[0, 0].double(), expected / expected.sum())


@pytest.mark.parametrize("update_at", ["acted_on", "same_step"])
def test_mf_qs_target_is_the_written_out_one(monkeypatch, update_at):
    """r + gamma sum_a pi(a | o', m) Q'(o', a, m), m of the step; Q at the m acted on, or it (0 after 0)."""
    rig = Rig("mf_q", Ragged, sharing="all", gamma=0.9, temperature=0.5, update_at=update_at, **REPLAY)
    batch, learner = replayed(rig, 60), rig.learner
    net, losses = learner.net("shared"), []
    for p in net.target_q.parameters():
        torch.nn.init.normal_(p, std=0.5)
    monkeypatch.setattr(learner, "step_optimizer", lambda loss, *modules: losses.append(loss.item()))
    with torch.no_grad():
        taken = torch.nn.functional.one_hot(batch.actions[0], 3).float() * batch.alive[..., None]
        others = taken.sum(1, keepdim=True) - taken
        count = batch.alive.sum(1)[:, None, None] - batch.alive[..., None].int()
        mean = {MEAN_ACTION: others / count.clamp(min=1)}
        following = net.target_q({**batch.next.observations[0], **mean})
        value = (torch.softmax(following / 0.5, -1) * following).sum(-1)
        target = batch.rewards + 0.9 * batch.bootstrap * value
        known = batch.observations[0][MEAN_ACTION].sum(-1, keepdim=True) > 0
        assert known.any()
        assert (~known[..., 0] & batch.alive & mean[MEAN_ACTION].any(-1)).any()
        seen = batch.observations[0]
        if update_at == "same_step":
            seen = {**seen, MEAN_ACTION: mean[MEAN_ACTION] * known}
        chosen = net.q(seen).gather(-1, batch.actions[0][..., None])[..., 0]
        expected = (chosen - target).square()[batch.alive].mean().item()
    learner.update_minibatch(batch)
    assert losses == [pytest.approx(expected, rel=1e-4)]


@pytest.mark.parametrize("name", ["mf_q", "mf_ac"])
def test_an_agents_loss_feels_its_neighbours_actions_and_not_its_own_in_the_mean(name):
    rig = Rig(name, Linked, **REPLAY)
    batch = replayed(rig, 60)
    taken = {g: a.requires_grad_() for g, a in batch.encoded_actions().items()}
    neighbours = rig.learner.neighbourhood.of(batch)
    means = mean_over(neighbours, batch.join(taken))
    for k, group in enumerate(rig.spec.groups):
        net = rig.learner.net(group.id if name == "mf_q" else critic_of(group))
        seen = {**batch.view(group).observations, MEAN_ACTION: means[:, group.columns]}
        slopes = torch.autograd.grad(net.q(seen).sum(), list(taken.values()), retain_graph=True)
        felt = torch.cat([(slope != 0).any(-1) for slope in slopes], 1)
        assert torch.equal(felt, neighbours[:, k])
        assert not felt[:, k].any()


class Follow(Game):
    """Agent 0 is blind; agents 1 and 2 are paid to show their shared cue, agent 0 to do as they just did.

    The cue stays for five steps, so what they did a step ago is what they will do. Agent 3 plays at random
    (it is paid for nothing), and is nobody's neighbour.
    """

    length = 20
    actions = 4

    def __init__(self, config=None):
        super().__init__(agents=4, actions=self.actions, width=self.actions)
        self.links = np.zeros((4, 4), bool)
        self.links[0, 1] = self.links[0, 2] = True

    def reset(self, *, seed=None, options=None):
        seen, _ = super().reset(seed=seed)
        return seen, {"__common__": {"graph": self.links}}

    def step(self, action_dict):
        return *super().step(action_dict)[:4], {"__common__": {"graph": self.links}}

    def observe(self):
        if self.t % 5 == 0:
            self.cue = int(self.rng.integers(self.actions))
        shown, blank = np.eye(self.actions, dtype=np.float32)[self.cue], np.zeros(self.actions, np.float32)
        return {"agent_0": blank, "agent_1": shown, "agent_2": shown, "agent_3": blank}

    def reward(self, actions):
        cue = self.cue
        return [float(actions[0] == cue), float(actions[1] == cue), float(actions[2] == cue), 0.0]


def test_the_value_that_a_lifes_first_action_follows_is_learned():
    """Lives of one step: all act on the mean 0, and are paid for their own action."""

    class Once(Game):
        length = 1

        def reward(self, actions):
            return [float(a == 0) for a in actions]

    rig = Rig("mf_q", Once, sharing="all", **LEARN)
    for _ in range(60):
        rig.learner.update_joint(rig.rollout(8))
    batch = rig.learner.replay.sample(np.random.default_rng(0), 200)
    (group,) = rig.spec.groups
    seen = batch.view(group).observations
    assert not seen[MEAN_ACTION].any()
    paid = torch.zeros(group.action.n)
    paid[0] = 1
    values = rig.learner.net("shared").policy(batch.view(group))
    torch.testing.assert_close(values, paid.expand_as(values), rtol=0, atol=0.1)


def follow_score(seed, graph):
    """Return what agent 0 earns a step after learning, greedily."""
    rig = Rig("mf_q", Follow, seed=seed, graph=graph, **LEARN)
    rig.learn(4_000)
    return rig.rollout(200, explore=False).rewards[..., 0].mean()


@nightly_by_seed
def test_mf_q_follows_its_neighbours(seed):
    """0.8 and a guess in the first of five steps; the mean action of the wrong agent tells nothing: 0.25."""
    assert follow_score(seed, "auto") > (0.85 + 0.25) / 2


@nightly_by_seed
def test_the_mean_action_of_the_wrong_agent_fails(seed):
    """The ablation that must fail."""
    assert follow_score(seed, [("agent_0", "agent_3"), ("agent_1", "agent_2")]) < (0.85 + 0.25) / 2


class Together(Game):
    """In every second step, which agents see, two have to act at once; in between they have to rest."""

    length = 20

    def __init__(self, config=None):
        super().__init__(agents=2, actions=2, width=1)

    def observe(self):
        return {a: np.full(1, self.t % 2, np.float32) for a in self.agents}

    def reward(self, actions):
        if self.t % 2:
            return [float(a * (1.0 if all(actions) else -0.1)) for a in actions]
        return [1.0 - a for a in actions]


def together_score(seed, update_at="acted_on"):
    """Return what an agent earns a step after learning, greedily."""
    rig = Rig("mf_q", Together, seed=seed, sharing="all", update_at=update_at, **LEARN)
    for _ in range(130):
        rig.learner.update_joint(rig.rollout(8))
    return rig.rollout(200, explore=False).rewards.mean()


@nightly_by_seed
@pytest.mark.parametrize(("update_at", "expected"), [("acted_on", 1.0), ("same_step", 0.5)])
def test_agents_that_act_on_the_mean_they_learned_at_begin_together(update_at, expected, seed):
    """At the mean of the same step, an action is worth what it is while the other still rests."""
    assert together_score(seed, update_at) == pytest.approx(expected, abs=0.1)


class Echo(Game):
    """An agent is paid for what the next one does, whom it hears."""

    def __init__(self, config=None):
        super().__init__(agents=3)
        self.links = np.roll(np.eye(3, dtype=bool), (config or {}).get("hears", 1), 1)

    def reset(self, *, seed=None, options=None):
        return super().reset(seed=seed)[0], {"__common__": {"graph": self.links}}

    def step(self, action_dict):
        return *super().step(action_dict)[:4], {"__common__": {"graph": self.links}}

    def reward(self, actions):
        return [float(actions[(i + 1) % 3] == 0) for i in range(3)]


@nightly_by_seed
@pytest.mark.parametrize("name", ["mf_q", "mf_ac"])
def test_critics_explain_what_neighbours_cause_and_not_what_others_do(name, seed):
    """Error 0; with the mean action of the wrong agents the variance of a coin, 1/4."""
    errors, calm = {}, {"entropy_coeff": 1.0}
    if name == "mf_q":
        calm = {"temperature": 10.0, "update_at": "same_step"}
    for hears in (1, 2):
        rig = Rig(name, Echo, {"hears": hears}, seed=seed, sharing="all", **LEARN, **calm)
        for _ in range(60):
            rig.learner.update_joint(rig.rollout(8))
        own = rig.learner
        batch = own.replay.sample(np.random.default_rng(0), 500)
        means, first = mean_actions(batch, own.neighbourhood), rig.spec.groups[0]
        net = own.net(first.id if name == "mf_q" else critic_of(first))
        values = net.q({**batch.view(first).observations, MEAN_ACTION: means})
        chosen = values[:, 0].gather(-1, batch.actions[0][:, :1])[:, 0]
        errors[hears] = (chosen - batch.rewards[:, 0]).square().mean().item()
    assert errors[1] < 0.125 < errors[2]


def cues_score(seed, entropy_coeff=0.1):
    """Return what the worse agent earns a step after learning, greedily."""
    # With the default entropy some policies settle on one action before the critic knows the cues.
    rig = Rig("mf_ac", Cues, seed=seed, entropy_coeff=entropy_coeff, **{**LEARN, "gamma": 0.5})
    for _ in range(130):
        rig.learner.update_joint(rig.rollout(8))
    return rig.rollout(200, explore=False).rewards.mean((0, 1)).max()


@nightly_by_seed
def test_mf_ac_hits_the_cues_for_its_own_reward(seed):
    """-1 a step where everybody hits his own; a team-sum or swapped reward makes it 0."""
    assert cues_score(seed) < -0.5


class Spins:
    """Ising's model on a torus of L x L agents: r_i = 0.5 * s_i * the sum of the four neighbours' spins."""

    side = 10

    def __init__(self, copies: int):
        self.num_envs = copies
        agents = tuple(f"spin_{i}" for i in range(self.side**2))
        self.spaces = JointSpaces(
            (AgentBlock(agents, {"": Box(0.0, 1.0, (1,), np.float32)}, Discrete(2)),), has_graph=True
        )
        place = np.arange(self.side**2).reshape(self.side, self.side)
        self.links = np.zeros((self.side**2, self.side**2), bool)
        for shift, axis in ((1, 0), (-1, 0), (1, 1), (-1, 1)):
            self.links[place.ravel(), np.roll(place, shift, axis).ravel()] = True

    def reset(self, seed, worlds, *, stride=0):
        return self._stand(np.zeros((self.num_envs, self.side**2), np.float32))

    def step(self, actions):
        spins = 2.0 * actions[0] - 1
        return self._stand((0.5 * spins * (spins @ self.links)).astype(np.float32))

    def recreate(self, failures):
        raise RuntimeError("spins do not break") from next(iter(failures.values()))

    def close(self):
        pass

    def _stand(self, rewards):
        never = np.zeros(rewards.shape, bool)
        graph = np.broadcast_to(self.links, (self.num_envs, *self.links.shape)).copy()
        seen = {"": np.zeros((*rewards.shape, 1), np.float32)}
        return JointStep((seen,), rewards, never, never, ~never, never[:, 0], graph=graph)


def magnetisation(net, links, temperature, sweeps=300):
    """Return the mean |magnetisation| of the two sublattices, over the second half of synchronous sweeps.

    Each agent acts on the mean action of the sweep before, so the two sublattices never meet.
    """
    side = Spins.side
    even = torch.tensor([(i // side + i % side) % 2 == 0 for i in range(side**2)])
    head, generator = BoltzmannHead(Discrete(2), temperature), torch.Generator().manual_seed(0)
    weights = torch.tensor(links, dtype=torch.float32) / 4
    spins, found = torch.ones(8, side**2, dtype=torch.long), []
    with torch.no_grad():
        for sweep in range(sweeps):
            mean = weights @ torch.nn.functional.one_hot(spins, 2).float()
            values = net.q({"": torch.zeros(8, side**2, 1), MEAN_ACTION: mean})
            spins = head.distribution(values, None).sample(generator)
            if sweep >= sweeps // 2:
                signs = 2.0 * spins - 1
                found += [signs[:, even].mean(1).abs(), signs[:, ~even].mean(1).abs()]
    return torch.stack(found).mean().item()


@pytest.mark.nightly
def test_mf_q_finds_isings_transition():
    """The infinite lattice orders below temperature 1.1346; Onsager's magnetisation at 0.9 is 0.96."""
    game = Spins(2)
    learn = {**LEARN, "learning_starts": 16, "capacity": 200, "batch_size": 16}
    rig = Rig("mf_q", game, sharing="all", hidden=(32,), temperature=1.2, update_at="same_step", **learn)
    for _ in range(100):
        rig.learner.update_joint(rig.rollout(8))
    net = rig.learner.net("shared")
    ups = torch.arange(5) / 4
    mean = torch.stack([1 - ups, ups], -1).unsqueeze(1).expand(-1, 100, -1)
    with torch.no_grad():
        values = net.q({"": torch.zeros(5, 100, 1), MEAN_ACTION: mean}).mean(1)
    expected = 0.5 * torch.stack([4 * (1 - 2 * ups), 4 * (2 * ups - 1)], -1)
    torch.testing.assert_close(values, expected, rtol=0, atol=0.3)
    assert magnetisation(net, game.links, 0.9) > 0.85
    assert magnetisation(net, game.links, 1.05) > 0.7
    assert magnetisation(net, game.links, 1.4) < 0.5
    assert magnetisation(net, game.links, 2.0) < 0.3
