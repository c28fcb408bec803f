"""Who is better than whom: what is paired, what is left out, and what is corrected together."""

import math

import pandas as pd
import pytest
from scipy.stats import t as student

from benchmark.metrics import compare, compute
from benchmark.report.ranking import SEED_COLUMNS, differences, ranks, with_seed_differences
from tests.hand_made_results import agent_episodes

GOOD, BAD = [["goal", "goal"]] * 12, [["collision", "collision"]] * 12


def difference(first, second, **labels):
    """Return the difference in completion of A, some tables, and B."""
    parts = [each.assign(algorithm=name) for name, side in (("A", first), ("B", second)) for each in side]
    return compare(pd.concat(parts, ignore_index=True), ["completion_rate"], **labels).iloc[0]


def seeds(outcomes, *numbers, **labels):
    return [agent_episodes(outcomes, training_seed=number, **labels) for number in numbers]


def test_the_unit_is_a_start_whatever_the_training_seeds():
    row = difference(seeds(GOOD, 1, 2, 3), seeds(BAD, 4, 5))
    assert (row["value"], row["pairs"], row["wins"], row["note"]) == (1.0, 12, "A", "")
    # Half the seeds arrive everywhere.
    row = difference(seeds(GOOD, 1) + seeds(BAD, 2), seeds(BAD, 1))
    assert (row["value"], row["pairs"]) == (0.5, 12)


def test_a_start_that_is_repeated_is_one():
    row = difference(seeds(GOOD, 1, starts_vary=False), seeds(BAD, 1, starts_vary=False))
    assert (row["pairs"], row["wins"]) == (1, "")
    assert math.isnan(row["corrected"])
    assert row["note"] == "11 episodes with the start of another"


def test_other_starts_are_named_and_not_paired():
    moved = agent_episodes(BAD, training_seed=1)
    moved.loc[moved["world"] >= 2_000_002, "start_x"] += 100.0
    row = difference(seeds(GOOD, 1), [moved])
    assert (row["pairs"], row["note"]) == (2, "10 episodes with other starts")
    row = difference(seeds(GOOD, 1), [moved[moved["world"] != 2_000_000]])
    assert (row["pairs"], row["note"]) == (1, "1 episodes played by one only, 10 episodes with other starts")


def table_of(**outcomes):
    parts = [agent_episodes(each, algorithm=name, training_seed=1) for name, each in outcomes.items()]
    return pd.concat(parts, ignore_index=True)


def test_families_of_corrections():
    some = [["goal", "goal"]] * 6 + [["collision", "goal"]] * 6
    answer = compare(
        table_of(a=GOOD, b=some, c=BAD, r=BAD, s=BAD), ["completion_rate", "collision_rate"], apart={"r", "s"}
    )
    found = answer[answer["metric"] == "completion_rate"].set_index(["first", "second"])
    assert ("r", "s") not in found.index
    # The largest of the three p-values among a, b and c is not corrected, the least one three times.
    own = found.loc[[("a", "b"), ("a", "c"), ("b", "c")]]
    assert own["corrected"].max() == own["p_value"].max()
    assert own["corrected"].min() == pytest.approx(3 * own["p_value"].min())
    rest = found.drop(own.index)
    assert rest["corrected"].min() == pytest.approx(6 * rest["p_value"].min())


def test_a_tie_is_of_entries_between_which_nothing_is_decided():
    """A is better than B and C than A; nothing is decided between B and C."""
    rows = [("A", "B", 0.01, "A"), ("A", "C", 0.01, "C"), ("B", "C", 0.5, "")]
    names = ("first", "second", "corrected", "wins")
    table = pd.DataFrame([dict(zip(names, row, strict=True)) for row in rows])
    found = ranks(table.assign(metric="completion_rate"), ["A", "B", "C"])
    assert {name: (each.rank, each.is_tied) for name, each in found.items()} == {
        **{"A": (2, False), "B": (2, False), "C": (1, False)}
    }


class TestGeneralization:
    def table(self, *, train=10, **held_out):
        """Return 10 training episodes of one agent, `train` of them at the goal, and held-out ones."""

        def episodes(goals, count=10):
            return [["goal"]] * goals + [["time_out"]] * (count - goals)

        tables = [agent_episodes(episodes(train))]
        for name, goals in held_out.items():
            tables.append(agent_episodes(episodes(goals), split="held_out", variation=name))
        return pd.concat(tables, ignore_index=True)

    def test_is_the_mean_over_variations_and_names_the_worst(self):
        row = compute(self.table(train=8, dense=6, wet=2, dark=10), metrics=["generalization"]).iloc[0]
        # 6 / 8, 2 / 8, and no credit above 1.
        assert row["value"] == pytest.approx((0.75 + 0.25 + 1.0) / 3)
        assert row["worst"] == "intersection@wet"
        assert (row["terms"]["train_completion"], row["terms"]["held_out_completion"]) == (0.8, 0.2)
        assert row["low"] < row["value"] < row["high"]


def shares(good, total):
    """Return outcomes of episodes of which `good` arrive."""
    return [["goal", "goal"]] * good + [["collision", "collision"]] * (total - good)


def of_algorithm(name, goods, total):
    parts = [
        agent_episodes(shares(good, total), training_seed=seed) for seed, good in enumerate(goods, start=1)
    ]
    return pd.concat(parts, ignore_index=True).assign(
        algorithm=name, task="t", task_traffic="no", mode="greedy"
    )


class TestByTrainingSeeds:
    def row(self, first, second, total=8):
        """Return the difference in completion of A and B, each with a share of `total` for each seed."""
        parts = [of_algorithm("A", first, total), of_algorithm("B", second, total)]
        table = pd.concat(parts, ignore_index=True)
        found = differences(table, "greedy", ["completion_rate"])
        return with_seed_differences(found, table, "greedy").iloc[0]

    def test_is_welchs(self):
        # Rates 1, 0.75, 0.5 and 0, 0.25, 0: means 0.75 and 1/12, variances 1/16 and 1/48, so that the error
        # is sqrt(1/48 + 1/144) = 1/6 with 3.2 degrees of freedom.
        row = self.row([8, 6, 4], [0, 2, 0])
        reach = float(student.ppf(0.975, 3.2)) / 6
        assert (row["value"], row["seeds_low"]) == pytest.approx((2 / 3, 2 / 3 - reach))
        assert row["seeds_high"] == 1.0 < 2 / 3 + reach
        assert row["seeds_p_value"] == pytest.approx(2 * float(student.sf(4.0, 3.2)))
        assert row["seeds_corrected"] == row["seeds_p_value"]

    @pytest.mark.parametrize(("first", "second"), [([8, 8, 8], [0, 0, 0]), ([8, 6], [0, 2, 0])])
    def test_there_is_none_of_seeds_that_agree_or_are_few(self, first, second):
        row = self.row(first, second)
        assert math.isfinite(row["p_value"])
        assert all(math.isnan(row[name]) for name in SEED_COLUMNS)
