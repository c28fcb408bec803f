"""Policies asked as RLlib's users ask them: `algo.get_module(...)`, and a batch of single agents."""

import numpy as np
import pytest
import torch
from rigs import SHARED, known

import algorithms
from algorithms.joint.env import MEMORY
from algorithms.joint.features import MEAN_ACTION
from algorithms.parts.distributions import Exploration
from algorithms.settings import ReplaySettings
from tests.games.games import Cues, Ragged
from tests.games.recall import Recall

pytestmark = pytest.mark.usefixtures("cluster")
LEARN = {"learning_starts": 32, "batch_size": 16, "capacity": 500}


def small(name, env: type = Cues, runners=0, **settings):
    config = algorithms.config(name).environment(env).debugging(seed=3)
    config.env_runners(num_env_runners=runners, num_envs_per_env_runner=2, rollout_fragment_length=16)
    replay = LEARN if issubclass(algorithms.entry(name).settings, ReplaySettings) else {}
    return config.training(**{"hidden": (16,), **replay, **settings})


def policy_of(algo, agent):
    group = next(group for group in algo.spec.groups if agent in group.agents)
    return algo.get_module(group.id)


@pytest.mark.parametrize("name", SHARED)
def test_every_algorithm_serves_observations_of_single_agents(build, name):
    algo = build(small(name, sharing="all", **known(name, {"consensus": False})))
    algo.train()
    seen = np.eye(4, dtype=np.float32)
    for agent in ("agent_0", "agent_1"):
        module = policy_of(algo, agent)
        batch = {"obs": torch.from_numpy(seen), "agent_id": [agent] * 4}
        greedy = module.forward_inference(batch)["actions"]
        assert greedy.shape == (4,)
        assert torch.equal(greedy, module.forward_inference(batch)["actions"])
        for k in range(4):
            one = {"obs": torch.from_numpy(seen[k : k + 1]), "agent_id": [agent]}
            assert torch.equal(module.forward_inference(one)["actions"], greedy[k : k + 1])
        explored = {tuple(module.forward_exploration(batch)["actions"].tolist()) for _ in range(200)}
        assert len(explored) > 1


@pytest.mark.parametrize("name", ["ppo", "mf_q", "networked_q"])
def test_served_actions_are_those_that_the_runner_takes(build, name):
    """Agents that share a network are told apart by their names."""
    algo = build(small(name, Ragged, sharing={"odd": ["b"], "even": ["a", "c"]}))
    algo.train()
    algo.get_module("odd")  # the runner acts with the newest weights from here on
    runner = algo.env_runner_group.local_env_runner
    view = runner._training_sampler()._now
    expected = runner._policies.act(view, Exploration(explore=False), torch.Generator())[0].actions
    for column, agent in enumerate(algo.spec.agents):
        module = policy_of(algo, agent)
        leaves = view.observations[0]
        rows = np.flatnonzero(view.alive[:, column])
        if name == "networked_q":  # it sees the others, too
            alone = view.alive.sum(1) == 1
            rows = np.flatnonzero(view.alive[:, column] & alone)
        batch = {"obs": torch.from_numpy(leaves[""][rows, column]), "agent_id": [agent] * len(rows)}
        if MEAN_ACTION in leaves:
            batch[MEAN_ACTION] = torch.from_numpy(leaves[MEAN_ACTION][rows, column])
        if len(rows):
            assert torch.equal(module.forward_inference(batch)["actions"], expected[rows, column])


def test_memory_goes_through_rllibs_states(build):
    """Step by step as a sequence, and as the runner acts."""
    algo = build(small("ppo", Recall, sharing="all", gru=8, sequence_length=8))
    algo.train()
    module = policy_of(algo, "agent_0")
    assert {k: tuple(v.shape) for k, v in module.get_initial_state().items()} == {"memory": (8,)}
    width = algo.spec.groups[0].observation[""].shape
    seen, agents = torch.randn(3, 5, *width), ["agent_0", "agent_1", "agent_0"]
    state: dict[str, torch.Tensor] = {}
    found = []
    for t in range(5):
        given = {"state_in": state} if state else {}
        told = module.forward_inference({"obs": seen[:, t], "agent_id": agents, **given})
        state = told["state_out"]
        found.append(told["actions"])
    start = {"memory": torch.zeros(3, 8)}
    whole = module.forward_inference({"obs": seen, "agent_id": agents, "state_in": start})
    assert torch.equal(whole["actions"], torch.stack(found, 1))
    torch.testing.assert_close(whole["state_out"]["memory"], state["memory"])
    assert (state["memory"] != 0).all()
    view = algo.env_runner_group.local_env_runner._training_sampler()._now
    runner = algo.env_runner_group.local_env_runner
    acting = runner._policies.act(view, Exploration(explore=False), torch.Generator())[0]
    leaves = {k: torch.from_numpy(x[:, 0]) for k, x in view.observations[0].items()}
    told = module.forward_inference({"obs": leaves[""], "state_in": {"memory": leaves[MEMORY]}})
    assert torch.equal(told["actions"], acting.actions[:, 0])
    torch.testing.assert_close(told["state_out"]["memory"], acting.memory[:, 0])


def test_masks_are_kept_and_densities_told(build):
    algo = build(small("ppo", sharing="all"))
    module = algo.get_module("shared")
    allowed = torch.tensor([[False, False, True, False]]).expand(50, 4)
    batch = {"obs": {"observations": torch.randn(50, 4), "action_mask": allowed}}
    told = module.forward_exploration(batch)
    assert (told["actions"] == 2).all()
    assert torch.equal(told["action_logp"], torch.zeros(50))
    free = module.forward_exploration({"obs": torch.randn(50, 4)})
    chosen = torch.log_softmax(free["action_dist_inputs"], -1).gather(-1, free["actions"][:, None])[:, 0]
    torch.testing.assert_close(chosen, free["action_logp"])
