"""Each metric on episodes that can be worked out by hand."""

import math

import numpy as np
import pytest

from benchmark.metrics.registry import METRICS
from smarts.types.actions import ActionSpaceType, LaneAction
from smarts.types.agent_states import ChangePhase
from smarts.types.events import Outcome
from smarts.types.vehicles import VehicleKind
from tests.measuring import ROAD, following, sums, term, totals, value
from tests.recordings import DT, Drive, at_speed, at_speeds, episode_of


class TestStability:
    def index(self, folder, steps=100, **drive):
        return value(
            "stability",
            episode_of(
                folder, ROAD, Drive(["road_0"], at_speed(5.0, steps), agent="a", route=["road"], **drive)
            ),
        )

    def test_perfectly_smooth(self, tmp_path):
        assert self.index(tmp_path, acceleration=1.0) == 1.0

    def test_jerk_of_accelerations_averaged_over_half_a_second(self, tmp_path):
        # Rising by 0.2 m/s^2 each step: a jerk of 2 m/s^3, which halves the index.
        assert self.index(tmp_path, acceleration=0.2 * np.arange(101)) == pytest.approx(0.5)
        # To and fro each step: the average over five moves by 2 / 5 of the swing of 1 m/s^2.
        swings = np.where(np.arange(101) % 2, 0.5, -0.5)
        assert self.index(tmp_path, acceleration=swings) == pytest.approx(1 / (1 + 0.2 / DT / 2.0))

    def test_lateral_acceleration(self, tmp_path):
        assert self.index(tmp_path, acceleration=0.0, lateral_acceleration=-1.5) == pytest.approx(0.5)

    def test_offset_from_the_lane_and_not_that_of_lane_changes(self, tmp_path):
        sways = np.where(np.arange(101) % 2, 0.5, -0.5)
        assert self.index(tmp_path, acceleration=0.0, t=sways) == pytest.approx(0.5, abs=1e-3)
        changes = np.concatenate([np.zeros(40), np.linspace(0.8, 2.4, 20), np.full(41, 3.2)])
        assert self.index(tmp_path, acceleration=0.0, t=changes) == pytest.approx(1.0)

    @pytest.mark.parametrize(
        ("phase", "is_left_out"),
        [
            (ChangePhase.NONE, False),
            (ChangePhase.REQUESTED, True),
            (ChangePhase.MOVING, True),
            (ChangePhase.ABORTED, False),
        ],
    )
    def test_the_offset_leaves_out_commanded_lane_changes(self, tmp_path, phase, is_left_out):
        # Half of the time 1 m to the left, which never becomes a lane change: a deviation of 0.5 m.
        aside = np.arange(100) < 50
        index = self.index(
            tmp_path,
            steps=99,
            acceleration=0.0,
            t=np.where(aside, 1.0, 0.0),
            agents={"change_phase": np.where(aside, int(phase), int(ChangePhase.NONE))},
        )
        assert index == pytest.approx(1.0 if is_left_out else 0.5)

    @pytest.mark.parametrize(
        ("steps", "speed", "is_measured"),
        [(18, 5.0, False), (20, 5.0, True), (100, 0.9, False), (100, 1.1, True)],
        ids=["for 1.9 s", "for 2.1 s", "at 0.9 m/s", "at 1.1 m/s"],
    )
    def test_two_seconds_above_walking_pace_are_needed(self, tmp_path, steps, speed, is_measured):
        episode = episode_of(
            tmp_path, ROAD, Drive(["road_0"], at_speed(speed, steps), agent="a", route=["road"])
        )
        assert sums("stability", episode)["stable_agents"] == is_measured


class TestStabilityOfStopAndGo:
    """An agent that stands, or drives too slowly to count, between stretches at 5 m/s."""

    def sums(self, folder, speeds, acceleration, **drive):
        """Return the sums of Stability's columns; all arguments have a number for each step."""
        own = {"s": at_speeds(speeds), "acceleration": self.instants(acceleration)}
        own |= {name: self.instants(numbers) for name, numbers in drive.items()}
        driven = Drive(["road_0"], agent="a", route=["road"], **own)
        return sums("stability", episode_of(folder, ROAD, driven))

    def instants(self, numbers):
        # As speeds are: the number of an instant is that of the step which led to it.
        return np.concatenate((numbers[:1], numbers))

    @pytest.mark.parametrize(("go", "is_measured"), [(5, False), (6, True)], ids=["0.5 s", "0.6 s"])
    def test_a_stretch_has_a_jerk_if_it_is_longer_than_the_average(self, tmp_path, go, is_measured):
        # Stands for 0.3 s, drives with an acceleration that rises by 0.2 m/s^2 each step, ten times over:
        # 5 s and more on the move, with a jerk of 2 m/s^3 where there are two averages to compare.
        speeds = ([0.0] * 3 + [5.0] * go) * 10
        rising = ([-8.0] * 3 + [0.2 * step for step in range(go)]) * 10
        found = self.sums(tmp_path, speeds, rising)
        assert found["stable_agents"] == is_measured
        assert found["mean_jerk"] == pytest.approx(2.0 * is_measured)
        assert found["stability"] == pytest.approx(0.5 * is_measured)


class TestDecisions:
    def drive(self, folder, actions=(), extras=(), action_mask=15):
        return episode_of(
            folder,
            ROAD,
            Drive(
                ["road_1"],
                at_speed(5.0, 200),
                agent="a",
                route=["road"],
                actions=list(enumerate(actions)),
                extras=extras,
                action_mask=action_mask,
            ),
        )

    def test_control_diversity(self, tmp_path):
        slow, left, keep = LaneAction.slow_down, LaneAction.change_lane_left, LaneAction.keep_lane

        def diversity(actions, times=2):
            return value("control_diversity", self.drive(tmp_path, actions), times=times)

        assert diversity([slow] * 15 + [left] * 15 + [keep] * 50) == 1.0
        assert diversity([slow] * 25) == 0.0
        quarter = -(0.75 * math.log2(0.75) + 0.25 * math.log2(0.25))
        split = [slow] * 15 + [left] * 5
        assert diversity(split, times=3) == pytest.approx(quarter)
        assert term("control_diversity", "longitudinal_share", self.drive(tmp_path, split)) == 0.75
        # 20 commands on 100 m.
        assert term("control_diversity", "commands_per_100_m", self.drive(tmp_path, split)) == 20.0
        # 48 and 50 commands in all.
        assert math.isnan(diversity([slow] * 24))
        assert diversity([slow] * 25) == 0.0

    def commands(self, folder, decisions, **more):
        """Return how many commands were along the road, and how many across."""
        drive = Drive(
            ["road_1"], **{"s": at_speed(5.0, 250), **more}, agent="a", route=["road"], decisions=decisions
        )
        found = sums("control_diversity", episode_of(folder, ROAD, drive))
        return found["speed_commands"], found["steering_commands"]

    @pytest.mark.parametrize(
        ("rate", "change", "is_effective", "expected"),
        [
            pytest.param(0.4, 0, True, (40.0, 0.0), id="0.4 m/s^2"),
            pytest.param(0.2, 1, True, (0.0, 41.0), id="lane changes"),
            # The first decision has none before it, and so no change of speed.
            pytest.param(0.4, -1, True, (20.0, 21.0), id="both at once"),
            pytest.param(0.4, -1, False, (40.0, 0.0), id="lane changes that could not be"),
        ],
    )
    def test_target_speeds_count_by_their_change_per_second(
        self, tmp_path, rate, change, is_effective, expected
    ):
        # A decision every half second.
        kind = int(ActionSpaceType.LaneWithContinuousSpeed)
        rows = [
            dict(
                **dict(step=5 * number, action=kind, is_effective=is_effective),
                **dict(value_0=20.0 + rate * 0.5 * number, value_1=change),
            )
            for number in range(41)
        ]
        assert self.commands(tmp_path, rows) == expected

    @pytest.mark.parametrize(
        ("acceleration", "degrees", "expected"),
        [
            pytest.param(0.2, 1.9, (0.0, 0.0), id="0.2 m/s^2, 1.9 deg/s"),
            pytest.param(0.4, 1.9, (40.0, 0.0), id="0.4 m/s^2"),
            pytest.param(0.2, 2.1, (0.0, 40.0), id="2.1 deg/s"),
            pytest.param(0.4, -2.1, (20.0, 20.0), id="both at once"),
        ],
    )
    def test_other_actions_count_as_carried_out(self, tmp_path, acceleration, degrees, expected):
        kind = int(ActionSpaceType.Continuous)
        rows = [dict(step=5 * number, action=kind, is_effective=True) for number in range(40)]
        seconds = DT * np.arange(201)
        seen = self.commands(
            tmp_path,
            rows,
            s=at_speeds(5.0 + acceleration * seconds[1:]),
            agents={"steering": np.radians(degrees) * seconds},
        )
        assert seen == expected

    def test_stochasticity_is_entropy_over_that_of_the_legal_actions(self, tmp_path):
        even_of_two = [(0, "probabilities", (0.5, 0.5, 0.0, 0.0))]
        assert value(
            "stochasticity", self.drive(tmp_path, [0], even_of_two, action_mask=0b0011)
        ) == pytest.approx(1.0)
        assert value("stochasticity", self.drive(tmp_path, [0], even_of_two)) == pytest.approx(0.5)
        certain = [*even_of_two, (1, "probabilities", (1.0, 0.0, 0.0, 0.0))]
        assert value("stochasticity", self.drive(tmp_path, [0, 0], certain)) == pytest.approx(0.25)
        only_one = [(0, "probabilities", (1.0, 0.0, 0.0, 0.0))]
        assert math.isnan(value("stochasticity", self.drive(tmp_path, [0], only_one, action_mask=0b0001)))

    def test_stochasticity_of_continuous_actions_is_cut_at_one(self, tmp_path):
        extras = [(0, "std", (0.2, 0.4)), (1, "std", (3.0, 3.0))]
        assert value("stochasticity", self.drive(tmp_path, [0, 0], extras)) == pytest.approx(0.65)

    def test_decisions_per_second_and_return(self, tmp_path):
        extras = [(0, "reward", (0.5,)), (1, "reward", (-2.0,))]
        episode = self.drive(tmp_path, [0] * 40, extras)
        assert value("decision_rate", episode) == pytest.approx(2.0)
        assert value("return", episode) == pytest.approx(-1.5)


class TestOutcomes:
    def test_rates_and_shares_sum_to_one(self, tmp_path):
        ends = [outcome for outcome in Outcome if outcome not in (Outcome.NONE, Outcome.INVALID)]
        drives = [
            Drive(["road_0"], at_speed(5.0, 10, 20.0 * number), agent=f"a{number}", outcome=outcome)
            for number, outcome in enumerate(ends)
        ]
        found = totals(episode_of(tmp_path, ROAD, *drives))
        shares = [
            "collision_rate",
            "completion_rate",
            *(name for name in METRICS if name.startswith("ended_")),
        ]
        assert [float(METRICS[name].value(found)) for name in shares] == [pytest.approx(1 / 10)] * 10

    def test_agility_and_progress(self, tmp_path):
        done = episode_of(
            tmp_path,
            ROAD,
            Drive(["road_0"], at_speed(5.0, 100), agent="a", outcome=Outcome.GOAL, free_flow_time=4.0),
            Drive(["road_2"], at_speed(2.0, 100), agent="b", outcome=Outcome.TIME_OUT, remaining=30.0),
        )
        assert value("agility", done) == pytest.approx(0.4)
        assert value("progress_speed", done) == pytest.approx(3.5)
        assert value("goal_distance", done) == pytest.approx(15.0)

    @pytest.mark.parametrize(
        ("gap", "least"),
        [pytest.param(20.5, 1.6, id="2.1 s at first"), pytest.param(50.0, 3.0, id="5 s at first")],
    )
    def test_least_time_to_collision(self, tmp_path, gap, least):
        # 15 m/s behind 5 m/s for half a second.
        episode = following(tmp_path, speed=15.0, steps=5, gap=gap)
        assert value("least_time_to_collision", episode) == pytest.approx(least)


def test_generalization_is_the_smaller_of_two_ratios():
    names = ("train_agents", "train_goals", "train_collisions", "held_out_agents", "held_out_goals")
    found = dict(zip(names, (100.0, 90.0, 10.0, 50.0, 25.0), strict=True)) | {"held_out_collisions": 0.0}
    measure = METRICS["generalization"]
    # Completion falls from 0.9 to 0.5; there are fewer collisions, which makes up for nothing.
    assert measure.value(found) == pytest.approx(0.5 / 0.9)
    # Non-collision falls from 0.9 to 0.4.
    assert measure.value(found | {"held_out_collisions": 30.0}) == pytest.approx(0.4 / 0.9)
    assert np.isnan(measure.value(found | {"train_goals": 49.0}))
    assert np.isnan(measure.value(found | {"held_out_agents": 0.0}))


@pytest.mark.parametrize(
    ("kind", "rate"), [(VehicleKind.TRUCK, np.nan), (VehicleKind.BICYCLE, 1.0), (VehicleKind.PEDESTRIAN, 1.0)]
)
def test_collisions_with_vulnerable_road_users(tmp_path, kind, rate):
    own = Drive(
        ["road_0"], at_speed(5.0, 10), agent="a", outcome=Outcome.COLLISION, partner=1, route=["road"]
    )
    episode = episode_of(tmp_path, ROAD, own, Drive(["road_0"], at_speed(0.0, 10, 10.0), kind=int(kind)))
    assert value("vulnerable_collision_rate", episode) == pytest.approx(rate, nan_ok=True)
    assert value("collision_rate", episode) == 1.0
