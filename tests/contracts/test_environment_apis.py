"""Every environment API passes the checks of its library, on three scenarios."""

from contextlib import closing

import gymnasium
import pytest
from gymnasium.utils.env_checker import check_env
from pettingzoo.test import parallel_api_test, parallel_seed_test
from ray.rllib.utils.pre_checks.env import check_multiagent_environments

from smarts.agents import AgentInterface, AgentPolicy, AgentSpec, AgentType
from smarts.env import RLlibHiWayEnv, SingleHiWayEnv, hiway_parallel_env
from smarts.observations.lists import observation_names

SCENARIOS = (
    "intersection",
    *(pytest.param(name, marks=pytest.mark.nightly) for name in ("double_merge", "two_way")),
)


@pytest.fixture(params=SCENARIOS)
def scenario(request):
    return request.param


@pytest.mark.parametrize("observation", observation_names())
def test_pettingzoo(scenario, observation):
    with closing(hiway_parallel_env([scenario], 3, observation=observation)) as env:
        parallel_api_test(env, num_cycles=60)


def test_pettingzoo_seeds(scenario):
    made = []

    def make():
        made.append(hiway_parallel_env([scenario]))
        return made[-1]

    parallel_seed_test(make, num_cycles=20)
    for env in made:
        env.close()


@pytest.mark.filterwarnings("ignore::UserWarning")
@pytest.mark.parametrize("observation", observation_names())
def test_gymnasium(scenario, observation):
    with closing(SingleHiWayEnv([scenario], observation=observation)) as env:
        check_env(env, skip_render_check=True)


@pytest.mark.parametrize("masks", [{}, {"action_mask": True}], ids=["default", "action_mask"])
def test_rllib(scenario, masks):
    with closing(
        RLlibHiWayEnv({"scenarios": [scenario], "agent_specs": 2, "seed": 1, "headless": True, **masks})
    ) as env:
        check_multiagent_environments(env)


def test_the_papers_listing():
    agent_id = "Agent-007"
    agent_spec = AgentSpec(
        interface=AgentInterface.from_type(AgentType.Laner, max_episode_steps=30),
        policy_params={"policy_function": lambda _: "keep_lane"},
        policy_builder=AgentPolicy.from_function,
    )
    env = gymnasium.make(
        "smarts.env:hiway-v0", scenarios=["scenarios/loop"], agent_specs={agent_id: agent_spec}
    )
    agent = agent_spec.build_agent()
    with closing(env):
        for _ in range(2):
            observations, _ = env.reset()
            is_over, steps = False, 0
            while not is_over:
                action = agent.act(observations[agent_id])
                observations, rewards, terminateds, truncateds, infos = env.step({agent_id: action})
                is_over, steps = terminateds["__all__"], steps + 1
            assert steps == 30
            assert truncateds[agent_id]
            assert infos[agent_id]["outcome"] == "time_out"
            assert rewards[agent_id] >= 0.0
            assert observations[agent_id].events.reached_max_episode_steps
