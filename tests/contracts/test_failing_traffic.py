"""If SUMO fails during an episode, every environment API raises one error, and the next reset works."""

from contextlib import closing

import numpy as np
import pytest

from smarts.agents import AgentInterface, AgentSpec, AgentType
from smarts.env import HiWayEnv, SingleHiWayVectorEnv, VectorHiWayEnv
from smarts.errors import TrafficError
from smarts.sim.assembly import Options
from smarts.sim.episode_files import RecordedEpisode, episodes_in
from smarts.sstudio.build import build_scenario
from tests.unit.sstudio.sources import scenario, write_cross

LANER = AgentSpec(interface=AgentInterface.from_type(AgentType.Laner))
FAILURE = "SUMO failed in mid-run: Vehicle 'broken' has no valid route"


@pytest.fixture(scope="module")
def doomed(tmp_path_factory):
    """Return a scenario in which one of two traffic variations has a vehicle without a valid route.

    The vehicle departs one second after the warm-up.
    """
    folder = write_cross(tmp_path_factory.mktemp("scenarios") / "doomed")
    body = """
        traffic={"sound": t.Traffic(flows=[flow()], warm_up=5.0),
                 "unsound": t.Traffic(flows=[flow()], warm_up=5.0)},
        ego_missions=[t.Mission(south_north)],
    """
    (folder / "scenario.py").write_text(scenario(body))
    built = build_scenario(folder)
    routes = built.traffic_files("unsound").routes[0]
    broken = '<vehicle id="broken" depart="6"><route edges="to_north from_south"/></vehicle></routes>'
    routes.write_text(routes.read_text().replace("</routes>", broken))
    return folder


def until_failure(env, action, seed):
    """Play up to two episodes until SUMO fails; return the number of steps before the failure."""
    for episode in range(2):
        env.reset(seed=seed if episode == 0 else None)
        steps = []
        try:
            steps += (env.step(action) for _ in range(5))
        except TrafficError as error:
            failure = error
            break
    else:
        pytest.fail("neither episode failed")
    assert FAILURE in str(failure)
    assert "other simulations are not affected" in failure.remedy
    return len(steps)


def test_dict_environments_raise_one_error_and_can_be_reset(doomed):
    env, fresh = (HiWayEnv([doomed], {"agent-0": LANER}, decision_interval=5) for _ in range(2))
    try:
        assert until_failure(env, {"agent-0": 0}, seed=3) >= 1
        assert until_failure(env, {"agent-0": 0}, seed=4) >= 1
        assert repr(env.reset(seed=5)) == repr(fresh.reset(seed=5))
        assert repr(env.step({"agent-0": 0})) == repr(fresh.step({"agent-0": 0}))
    finally:
        env.close()
        fresh.close()


def test_vector_environments_report_the_failure_and_continue(doomed, tmp_path):
    env = VectorHiWayEnv(3, [doomed], 1, simulation=Options(record=tmp_path))
    keep = [np.zeros((3, 1), int)]
    with closing(env):
        env.reset(1)
        failures = set()
        for _ in range(60):
            before = [(start.world, start.episode, start.traffic_name) for start in env.episodes]
            now = env.step(keep)
            for row, error in now.failed.items():
                world, episode, traffic = before[row]
                failures.add((world, episode))
                assert FAILURE in str(error)
                assert traffic == "unsound"
                # The step has no result, and the next episode has begun.
                assert not now.rewards[row].any()
                assert not now.terminated[row].any()
                assert not now.truncated[row].any()
                assert not now.reset[row]
                assert now.alive[row].all()
                assert env.episodes[row].episode == episode + 1
                assert now.observations[0][""][row].any()
        assert {world for world, _ in failures} == {0, 1, 2}
    recorded = {
        (int(facts["world"]), int(facts["episode"]))
        for facts in (RecordedEpisode(folder).facts for folder in episodes_in(tmp_path))
        if facts["is_invalid"] and FAILURE in facts["remark"]
    }
    assert recorded == failures


def test_gymnasium_vector_environments_truncate_the_episode(doomed):
    with closing(SingleHiWayVectorEnv(3, [doomed])) as env:
        last, _ = env.reset(seed=1)
        cut = np.zeros(3, bool)
        for _ in range(60):
            seen, rewards, terminated, truncated, infos = env.step(np.zeros(3, int))
            outcomes = infos["final_info"]["outcome"] if "final_info" in infos else [None] * 3
            for number in np.flatnonzero([outcome == "invalid" for outcome in outcomes]):
                cut[number] = True
                assert truncated[number]
                assert not terminated[number]
                assert rewards[number] == 0.0
                np.testing.assert_array_equal(infos["final_obs"][number], last[number])
            last = seen
        assert cut.all()
