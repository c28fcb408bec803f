"""Whether a cell with social vehicles is one."""

import numpy as np
import pytest
from typer.testing import CliRunner

from benchmark.cli import app
from benchmark.report.traffic_check import traffic_checks
from benchmark.results.reading import read_results
from tests.hand_made_results import ALONE, SOCIAL, agent_episodes, write_experiment, write_run
from tests.measuring import CROSS, ROAD, SOUTH_NORTH, WEST_EAST, following, meeting, sums
from tests.recordings import LENGTH, Drive, across, at_speed, episode_of


def met(episode):
    return sums("social_encounters", episode)["met_social"]


class TestEncounters:
    def test_a_conflict_with_a_social_vehicle_counts(self, tmp_path):
        assert met(meeting(tmp_path, [10.0] * 60, [10.0] * 60)) == 1.0

    def test_a_conflict_with_an_agent_does_not(self, tmp_path):
        drives = [
            Drive(across(CROSS, *WEST_EAST), at_speed(10.0, 60, 30.0), agent="a", route=WEST_EAST),
            Drive(across(CROSS, *SOUTH_NORTH), at_speed(10.0, 60, 20.0), agent="b", route=SOUTH_NORTH),
        ]
        assert met(episode_of(tmp_path, CROSS, *drives)) == 0.0

    @pytest.mark.parametrize(("gap", "found"), [(9.9, 1.0), (10.1, 0.0)])
    def test_a_leader_counts_within_two_seconds(self, tmp_path, gap, found):
        # Both at 5 m/s.
        assert met(following(tmp_path, speed=5.0, steps=10, gap=gap)) == found

    @pytest.mark.parametrize(("behind", "found"), [(17.0, 1.0), (25.0, 0.0)])
    def test_a_lane_change_counts_near_a_social_vehicle(self, tmp_path, behind, found):
        moves_over = np.clip((np.arange(61) - 20) * 0.25, 0.0, 3.2)
        own = Drive(["road_0"], at_speed(10.0, 60, 100.0), t=moves_over, agent="a", route=["road"])
        other = Drive(["road_1"], at_speed(10.0, 60, 100.0 - behind - LENGTH / 4), route=["road"])
        assert met(episode_of(tmp_path, ROAD, own, other)) == found


def write(root, *, collisions, share):
    """Write scripted policies' runs: keep-lane collides in so many of 100 episodes more with traffic."""
    write_experiment(root, traffic=[ALONE, SOCIAL], scripted=["keep_lane", "gap_acceptance"])
    for traffic, count in ((ALONE, 10), (SOCIAL, 10 + collisions)):
        outcomes = [["collision"]] * count + [["goal"]] * (100 - count)
        table = agent_episodes(outcomes, mode="scripted", task_traffic=traffic)
        write_run(root, "keep_lane", [table], traffic=traffic, seed=-1)
        drove = agent_episodes([["goal"]] * 100, mode="scripted", task_traffic=traffic)
        drove["met_social"] = (np.arange(100) < 100 * share) * float(traffic == SOCIAL)
        write_run(root, "gap_acceptance", [drove], traffic=traffic, seed=-1)


@pytest.mark.parametrize(
    ("collisions", "share", "is_one"), [(30, 0.8, True), (9, 0.8, False), (30, 0.79, False), (0, 0.0, False)]
)
def test_what_a_cell_with_social_vehicles_is(tmp_path, collisions, share, is_one):
    write(tmp_path, collisions=collisions, share=share)
    (check,) = traffic_checks(read_results(tmp_path))
    assert (check.task, check.traffic, check.is_one) == ("intersection", SOCIAL, is_one)
    assert check.differences["keep_lane"].value == pytest.approx(collisions / 100)
    assert check.differences["keep_lane"].pairs == 100
    assert check.share == pytest.approx(share)
    done = CliRunner().invoke(app, ["check-traffic", str(tmp_path)])
    assert done.exit_code == (0 if is_one else 1)
    assert "intersection" in done.stdout
