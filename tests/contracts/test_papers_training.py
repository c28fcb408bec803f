"""The paper's listing of multi-agent training: RLlib's PPO with a policy per agent, run by Ray Tune."""

from types import SimpleNamespace

import pytest
from ray import tune

from smarts.agents import ActionSpaceType, AgentInterface, AgentPolicy, AgentSpec
from smarts.env import RLlibHiWayEnv


@pytest.mark.nightly
def test_the_papers_listing(tmp_path):
    config = SimpleNamespace(
        agent={
            "policy_builder": AgentPolicy.from_function,
            "policy_params": {"policy_function": lambda _: "keep_lane"},
        },
        interface={"action": ActionSpaceType.Lane, "waypoints": True, "max_episode_steps": 50},
        policy=(None, None, None, {}),
    )
    agent_ids = ["Agent-0", "Agent-1"]
    scenario_path = "intersection"
    args = SimpleNamespace(headless=True)

    # initializing multiple agents
    agents = {
        agent_id: AgentSpec(**config.agent, interface=AgentInterface(**config.interface))
        for agent_id in agent_ids
    }

    # initializing environment with one or more scenarios
    env_config = {
        "seed": 42,
        "scenarios": [str(scenario_path)],
        "headless": args.headless,
        "agent_specs": agents,
    }

    policies = {k: config.policy for k in agents}

    tune_config = {
        "env": RLlibHiWayEnv,
        "env_config": env_config,
        "multiagent": {
            "policies": policies,
            # Newer versions of RLlib also pass the episode.
            "policy_mapping_fn": lambda agent_id, episode, **_: agent_id,
        },
        "num_env_runners": 0,
        "train_batch_size": 100,
        "minibatch_size": 50,
        "num_epochs": 1,
    }

    # run experiment
    analysis = tune.run(
        "PPO", config=tune_config, stop={"training_iteration": 1}, storage_path=str(tmp_path), verbose=0
    )
    (trial,) = analysis.trials
    assert trial.status == "TERMINATED"
    assert trial.last_result["env_runners"]["num_env_steps_sampled"] >= 100
    assert trial.last_result["learners"].keys() >= {*agent_ids}
