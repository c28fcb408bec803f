"""What infos and records say of bubbles that look for names that never appear, in every environment."""

from contextlib import closing

import numpy as np
import pytest

from smarts.agents.benchmark import benchmark_interface
from smarts.env import (
    VectorHiWayEnv,
)
from smarts.types.bubbles import COUNTS
from tests.unit.sstudio import sources

SCENARIO = """
bubbles=[
    t.Bubble(t.PositionalZone((0, 0), (9, 9)), t.SocialAgentActor("idm", "smarts.zoo:idm-v0"), id="lost",
        follow_actor_id="nobody", follow_offset=(0, 9)),
    t.Bubble(t.PositionalZone((0, 0), (9, 9)), t.SocialAgentActor("idm", "smarts.zoo:idm-v0"), id="waits",
        active_condition=-t.DependeeActorCondition("nothing"),
        airlock_condition=t.DependeeActorCondition("nothing")),
],
ego_missions=[t.Mission(south_north)],
"""
MISSING = {"lost": 1, "waits": 1}
ME = {"me": benchmark_interface(max_episode_steps=40)}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = sources.write_cross(tmp_path_factory.mktemp("names"))
    (folder / "scenario.py").write_text(sources.scenario(SCENARIO))
    return folder


def missing(info):
    """Return how many names each bubble misses; nothing else has happened in them."""
    assert all({*counts} == {*COUNTS} for counts in info["bubbles"].values())
    others = [counts[name] for counts in info["bubbles"].values() for name in COUNTS[:-1]]
    assert not any(others)
    return {bubble: counts["never_appeared"] for bubble, counts in info["bubbles"].items()}


def arrays(folder):
    with closing(VectorHiWayEnv(2, [folder], ME)) as env:
        step = env.reset(1)
        yield from step.social_infos.values()
        was_reset = False
        while not was_reset:
            step = env.step([np.zeros((2, 1), int)])
            was_reset = step.reset.all()
            assert [*step.social_infos] == [0, 1]
            yield from step.social_infos.values()


def test_infos_count_what_never_appeared(folder):
    infos = [*arrays(folder)]
    assert len(infos) >= 2
    assert all(missing(info) == MISSING for info in infos)
