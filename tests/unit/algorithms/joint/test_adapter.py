import copy
from typing import ClassVar

import gymnasium
import numpy as np
import pytest
from gymnasium.spaces import Box, Dict, Discrete, MultiDiscrete, Tuple
from pettingzoo import ParallelEnv
from ray.rllib.env.wrappers.pettingzoo_env import ParallelPettingZooEnv

from algorithms.errors import SpaceError
from algorithms.joint.adapter import COMMON, JointVector
from algorithms.joint.env import episode_seed
from algorithms.joint.spaces import Flattening, to_env
from algorithms.joint.spec import JointSpec
from algorithms.joint.tuple_env import TupleEnv
from tests.games.games import Cues, Game, Ragged, Target, TwoStep
from tests.vector_contract import check_vector_env


@pytest.mark.parametrize("game", [Cues, Target, TwoStep, Ragged])
def test_the_adapter_keeps_the_contract(game):
    check_vector_env(JointVector(lambda b: game({}), 3))


class Untrue(JointVector):
    def step(self, actions):
        return super().step(actions)._replace(final=None)


def test_missing_final_observations_are_found():
    with pytest.raises(AssertionError, match="reset without final observations"):
        check_vector_env(Untrue(lambda b: Cues(), 2))


def test_an_episode_depends_on_seed_and_world_alone():
    env = JointVector(lambda b: Cues(), 2)
    here = env.reset(5, np.array([3, 8])).observations[0][""].copy()
    there = env.reset(5, np.array([8, 3])).observations[0][""].copy()
    np.testing.assert_array_equal(here[0], there[1])
    np.testing.assert_array_equal(here[1], there[0])
    assert episode_seed(5, 3, 0) != episode_seed(5, 0, 3)


def test_leaves_of_nested_spaces():
    near, image = Box(0, 1, (4,), np.float32), Box(0, 255, (8, 8, 3), np.uint8)
    space = Dict({"lidar": Dict({"near": near}), "lane": Discrete(3), "image": image})
    flattening = Flattening(space, "a")
    assert {name: leaf.shape for name, leaf in flattening.leaves.items()} == {
        "lidar/near": (4,),
        "lane": (3,),
        "image": (8, 8, 3),
    }
    seen = {"lidar": {"near": np.ones(4)}, "lane": 2, "image": np.zeros((8, 8, 3), np.uint8)}
    leaves, mask = flattening.split(seen)
    assert leaves["lane"].tolist() == [0, 0, 1]
    assert mask is None


def test_spaces_without_arrays_are_refused():
    with pytest.raises(SpaceError, match="agent 'a'"):
        Flattening(Tuple([Discrete(2)]), "a")
    with pytest.raises(SpaceError, match="flatten a MultiDiscrete"):
        JointVector(lambda b: _with_action(MultiDiscrete([2, 2])), 1)


def _with_action(space):
    game = Cues()
    game.action_spaces = dict.fromkeys(game.agents, space)
    return game


def test_actions_in_the_units_of_the_environment():
    bounded = Box(np.array([0.0, -2.0], np.float32), np.array([4.0, 2.0], np.float32))
    np.testing.assert_allclose(
        to_env(bounded, np.array([[-1, 1], [0, 0.5], [3, -3]])), [[0, 2], [2, 1], [4, -2]]
    )
    half = Box(0.0, np.inf, (1,), np.float32)
    np.testing.assert_allclose(to_env(half, np.array([[-3.0], [7.0]])), [[0], [7]])
    assert to_env(Discrete(3, start=5), np.array([0, 2])).tolist() == [5, 7]


def test_turns_are_refused():
    class Turns(Cues):
        def observe(self):
            seen = super().observe()
            return {a: o for i, (a, o) in enumerate(seen.items()) if (i + self.t) % 2 == 0}

        def step(self, action_dict):
            return super().step({a: action_dict.get(a, 0) for a in self.agents})

    env = JointVector(lambda b: Turns(), 1)
    env.reset(0, np.array([0]))
    env.step((np.zeros((1, 2), np.int64),))
    with pytest.raises(SpaceError, match="turn"):
        env.step((np.zeros((1, 2), np.int64),))


def test_groups_cover_all_agents_with_equal_spaces():
    spaces = JointVector(lambda b: Ragged({}), 1).spaces
    spec = JointSpec.build(spaces, {"odd": ["b"], "even": ["a", "c"]})
    assert [(g.id, g.agents) for g in spec.groups] == [("even", ("a", "c")), ("odd", ("b",))]
    with pytest.raises(SpaceError, match="'b'"):
        JointSpec.build(spaces, {"x": ["bb", "a", "c"]})
    with pytest.raises(SpaceError, match=r"\['c'\]"):
        JointSpec.build(spaces, {"x": ["a", "b"]})


class Leaver(Game):
    """Agent 0 is left out, without a flag, of what the third step answers; both see the time."""

    length = 5
    flag = False

    def observe(self):
        seen = {a: np.full(1, self.t / 10, np.float32) for a in self.agents}
        return seen if self.t < 3 else {"agent_1": seen["agent_1"]}

    def step(self, action_dict):
        self.t += 1
        alive = list(action_dict)
        cuts = {"agent_0": self.flag and self.t == 3, "__all__": self.t == self.length}
        return self.observe(), dict.fromkeys(alive, 1.0), {"__all__": False}, cuts, {}


def test_who_leaves_without_a_flag_is_cut_and_valued_from_what_it_saw_last():
    env = JointVector(lambda b: Leaver(), 1)
    env.reset(0, np.array([0]))
    steps = [copy.deepcopy(env.step((np.zeros((1, 2), np.int64),))) for _ in range(4)]
    assert [s.truncated[0].tolist() for s in steps] == [[False, False]] * 2 + [[True, False], [False, False]]
    assert not any(s.terminated.any() for s in steps)
    assert [s.alive[0, 0] for s in steps] == [True, True, False, False]
    seen = [s.observations[0][""][0, :, 0].tolist() for s in steps]
    np.testing.assert_allclose(seen, [[0.1, 0.1], [0.2, 0.2], [0.2, 0.3], [0.0, 0.4]], rtol=1e-6)


class Latecomer(Game):
    """Masks are in the infos; agent 1 enters with the first step. Action 1 is always illegal."""

    length = 4

    def reset(self, *, seed=None, options=None):
        observations, _ = super().reset(seed=seed)
        return {"agent_0": observations["agent_0"]}, self.infos(["agent_0"])

    def step(self, action_dict):
        self.t += 1
        over = {"__all__": self.t == self.length}
        rewards = dict.fromkeys(action_dict, 0.0)
        return self.observe(), rewards, {"__all__": False}, over, self.infos(self.agents)

    def infos(self, agents):
        return {a: {"action_mask": np.array([1, 0], np.int8)} for a in agents}


def test_who_enters_later_is_masked_like_those_of_equal_spaces():
    env = JointVector(lambda b: Latecomer(), 1)
    (block,) = env.spaces.blocks
    assert block.agents == ("agent_0", "agent_1")
    assert block.masked
    assert env.reset(0, np.array([0])).masks[0][0].tolist() == [[True, False], [True, True]]
    assert env.step((np.zeros((1, 2), np.int64),)).masks[0][0].tolist() == [[True, False]] * 2


class Tuples(gymnasium.Env):
    """Three agents, tuples of spaces and lists of rewards: their actions; an episode has 4 steps."""

    observation_space = Tuple([Box(0, 1, (2,), np.float32)] * 3)
    action_space = Tuple([Discrete(4)] * 3)

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.t = 0
        return self.seen(), {}

    def step(self, action):
        self.t += 1
        return self.seen(), [float(each) for each in action], self.t == 4, False, {}

    def seen(self):
        return tuple(self.np_random.random((3, 2), np.float32))


def test_a_game_with_tuples_of_spaces_has_an_entry_for_each_agent():
    check_vector_env(JointVector(lambda b: TupleEnv(Tuples()), 3))
    game = TupleEnv(Tuples())
    assert [*game.reset(seed=3)[0]] == game.agents == ["agent_0", "agent_1", "agent_2"]
    _, rewards, ends, cuts, _ = game.step({"agent_2": 3, "agent_0": 1, "agent_1": 2})
    assert rewards == {"agent_0": 1.0, "agent_1": 2.0, "agent_2": 3.0}
    assert (ends, cuts) == ({"__all__": False}, {"__all__": False})


class Late(ParallelEnv):
    """PettingZoo: 'late' comes with step 2 and leaves with step 4; an episode has 6 steps."""

    metadata: ClassVar = {"name": "late_v0"}
    possible_agents: ClassVar = ["first", "late"]

    def observation_space(self, agent):
        return Box(0, 10, (1,), np.float32)

    def action_space(self, agent):
        return Discrete(2)

    def reset(self, seed=None, options=None):
        self.t, self.agents = 0, ["first"]
        return self.seen(self.agents), {"first": {}}

    def step(self, actions):
        assert set(actions) == set(self.agents)
        self.t += 1
        acted = list(self.agents)
        ends = {a: a == "late" and self.t == 4 for a in acted}
        cuts = {a: self.t == 6 for a in acted}
        self.agents = ["first", "late"] if 2 <= self.t < 4 else ["first"]
        there = {*acted, *self.agents}
        flags = [{a: False for a in there} | given for given in (ends, cuts)]
        return self.seen(there), {a: 1.0 for a in acted}, *flags, {a: {} for a in there}

    def seen(self, agents):
        return {a: np.full(1, self.t, np.float32) for a in agents}


def test_agents_that_come_late_in_pettingzoo_are_there():
    env = JointVector(lambda b: ParallelPettingZooEnv(Late()), 1)
    assert env.spaces.blocks[0].agents == ("first", "late")
    alive = [env.reset(0, np.zeros(1, int)).alive[0].tolist()]
    for _ in range(5):
        step = env.step((np.zeros((1, 2), int),))
        assert step.terminated[0].tolist() == [False, len(alive) == 4]
        alive.append(step.alive[0].tolist())
        assert not step.failed
    assert alive == [[True, 2 <= t < 4] for t in range(6)]


class Gaps(Game):
    """Agent 0 is there from step 2 to 4, agent 1 from step 6 on; an episode has 8 steps."""

    length = 8
    stranger = False

    def reset(self, *, seed=None, options=None):
        self.agents = self.possible_agents
        return super().reset(seed=seed)

    def observe(self):
        there = {"agent_0": 2 <= self.t <= 4, "agent_1": self.t >= 6, "stranger": self.stranger}
        return {agent: np.full(1, self.t / 10, np.float32) for agent in there if there[agent]}

    def step(self, action_dict):
        self.t += 1
        self.agents = self.possible_agents[self.t >= 4 :]
        ends = {"agent_0": self.t == 4, "__all__": self.t == self.length}
        return self.observe(), dict.fromkeys(action_dict, 1.0), ends, {"__all__": False}, {}


def test_an_episode_goes_on_while_no_agent_is_there():
    env = JointVector(lambda b: Gaps(), 1)
    alive = [env.reset(0, np.zeros(1, int)).alive[0].tolist()]
    steps = [copy.deepcopy(env.step((np.zeros((1, 2), int),))) for _ in range(8)]
    alive += [step.alive[0].tolist() for step in steps]
    assert alive == [[2 <= t < 4, 6 <= t < 8] for t in range(9)]
    assert [step.reset[0] for step in steps] == [False] * 7 + [True]
    check_vector_env(JointVector(lambda b: Gaps(), 2))


class Mixed(Game):
    """Agents 0 and 2 observe one number, agent 1 two; agent 0 hears agent 1, and agent 1 hears agent 2."""

    def __init__(self, config=None):
        super().__init__(agents=3)
        self.observation_spaces["agent_1"] = Box(-1, 1, (2,), np.float32)

    def reset(self, *, seed=None, options=None):
        return super().reset(seed=seed)[0], self.infos()

    def step(self, action_dict):
        *result, _ = super().step(action_dict)
        return *result, self.infos()

    def observe(self):
        return {a: np.zeros(space.shape, np.float32) for a, space in self.observation_spaces.items()}

    def reward(self, actions):
        return [0.0] * 3

    def infos(self):
        return {COMMON: {"graph": np.array([[0, 1, 0], [0, 0, 1], [0, 0, 0]], bool)}}


def test_a_graph_in_the_order_of_possible_agents_links_them_in_their_columns():
    env = JointVector(lambda b: Mixed(), 2)
    agents = JointSpec.build(env.spaces).agents
    assert agents == ("agent_0", "agent_2", "agent_1")
    for graph in (env.reset(0, np.arange(2)).graph, env.step((np.zeros((2, 2)), np.zeros((2, 1)))).graph):
        for one in graph:
            heard = {(agents[i], agents[j]) for i, j in np.argwhere(one)}
            assert heard == {("agent_0", "agent_1"), ("agent_1", "agent_2")}


def test_environments_that_cannot_be_pickled_begin_new_episodes():
    class Unpicklable(Cues):
        def __reduce__(self):
            raise TypeError("not to be shared")

    env = JointVector(lambda b: Unpicklable(), 1)
    env.reset(0, np.zeros(1, int))
    assert env.get_state() is None
