"""Environments with social agents in processes of their own."""

from contextlib import closing

import numpy as np

from smarts.env.vector import VectorHiWayEnv

DRAWING, MISBEHAVING = "tests.hosted_agents:drawing-v0", "tests.hosted_agents:misbehaving-v0"
MIXED = [{"agent": "idm-v0", "count": 1}, {"agent": DRAWING, "count": 1}]


def environment(social, hosts, num_envs=1, scenario="intersection", **more):
    """Return an environment with social agents, decisions in each step, and no traffic."""
    return VectorHiWayEnv(
        num_envs, [scenario], 1, social_agents=social, hosts=hosts, decision_interval=1, traffic=None, **more
    )


def state(env):
    """Return the bits of the vehicles' states."""
    vehicles = env._runner.world.vehicles
    return vehicles.position.tobytes(), vehicles.speed.tobytes(), vehicles.alive.tobytes()


def steps(env, count):
    """Yield the results of steps in which the egos keep their lanes."""
    for _ in range(count):
        actions = [
            np.zeros((env.num_envs, len(block.agents), *block.action.shape), block.action.dtype)
            for block in env.spaces.blocks
        ]
        yield env.step(actions)


def played(social, hosts, count=60, **more):
    """Return the states after each step, and the failures."""
    with closing(environment(social, hosts, **more)) as env:
        first, failures = env.reset(), {}
        states = [state(env)]
        failures.update(first.social_failures)
        for result in steps(env, count):
            states.append(state(env))
            for row, named in result.social_failures.items():
                failures.setdefault(row, {}).update(named)
        return states, failures


def hosted(how, **host):
    """Return one agent that misbehaves at its third request, and where it acts."""
    social = [{"agent": MISBEHAVING, "count": 2, "options": {"how": how}}, {"agent": DRAWING, "count": 1}]
    return social, {MISBEHAVING: {"where": "process", "patience": 30.0, **host}}


def host_of(env):
    """Return where an environment's social agents act."""
    return env._runner._requests._host
