"""Verdicts on submissions: nothing of others is lost, nothing false confirmed, nothing honest marked."""

import itertools
import math
import shutil

import numpy as np
import pytest

from benchmark.metrics import read_table
from benchmark.report.leaderboard import (
    MAY_EXCHANGE,
    Submitted,
    by_entry,
    make_leaderboard,
    may_be_ranked,
    write_leaderboard,
)
from benchmark.results.files import ResultsError, read_json, write_json
from benchmark.results.release import CONFIRMED, MANIFEST, MARKED, REFUSED, Entry, episode_digests, scores_of
from benchmark.results.run_folder import RunFolder
from benchmark.running import verifying
from benchmark.running.verifying import compared_digests, differences, memorized, p_value
from smarts.agents.hosting.options import HostError
from smarts.errors import TrafficError
from tests.hand_made_results import ALONE, agent_episodes
from tests.hand_made_submissions import freeze, verified, write_policy, write_submission
from tests.raising import raises

frozen = pytest.fixture(autouse=True)(freeze)

LIES = {"scores": {"completion_rate": 1.0}, "episodes": {"loop": ["x"]}}


def place_of(out, seed=1):
    return out / "mine" / "loop" / ALONE / f"seed_{seed}"


def written_at(out, *seeds):
    """Return when the tables of some seeds were written."""
    return [RunFolder(place_of(out, seed)).table.stat().st_mtime_ns for seed in seeds]


def statuses(*roots):
    return {
        each.algorithm: (each.status, each.completion.seeds) for each in make_leaderboard([*roots]).places
    }


def test_an_honest_submission_gets_its_claims_and_is_confirmed_and_listed(tmp_path):
    """Its claims hold two files of each policy, and nothing else of their folders."""
    root, out = write_submission(tmp_path / "theirs", (1, 2, 3)), tmp_path / "out"
    (tmp_path / "secret").write_text("a private key")
    (root / "1" / "mine" / "notes.txt").symlink_to(tmp_path / "secret")
    assert [each.reasons for each in verified(root, tmp_path / "own")] == [["claims no episodes"]] * 3
    claims = tmp_path / "own" / "submission"
    names = [f"policies/mine_loop_{ALONE}_{seed}" for seed in (1, 2, 3)]
    found = {each.relative_to(claims).as_posix() for each in claims.rglob("*") if each.is_file()}
    assert found == {MANIFEST} | {f"{name}/policy.{end}" for name in names for end in ("json", "npz")}
    verdicts = verified(claims, out, fresh=None)
    assert [each.status for each in verdicts] == [CONFIRMED] * 3
    assert [(each.digests, each.fresh) for each in verdicts] == [([1, 1], verdicts[0].scores)] * 3
    assert verdicts[0].scores == verdicts[0].claimed
    before = written_at(out, 1, 2, 3)
    assert [each.status for each in verified(claims, out, fresh=None)] == [CONFIRMED] * 3
    assert written_at(out, 1, 2, 3) == before
    assert statuses(out) == {"mine": (CONFIRMED, 3)}
    write_leaderboard([out], tmp_path / "page.html", "greedy")
    assert "theirs, A. Author" in (tmp_path / "page.html").read_text()


def test_observations_that_the_task_does_not_declare_are_refused(tmp_path):
    out = tmp_path / "out"
    (verdict,) = verified(write_submission(tmp_path / "theirs", features=("speed", "neighbor_rows")), out)
    assert (verdict.status, "does not declare: neighbor_rows" in verdict.reasons[0]) == (REFUSED, True)
    board = make_leaderboard([out])
    assert (board.places, [each.status for each in board.submitted]) == ((), [REFUSED])
    write_leaderboard([out], tmp_path / "page.html", "greedy")
    assert "neighbor_rows" in (tmp_path / "page.html").read_text()


def test_the_results_of_trainings_are_never_removed(tmp_path):
    root, place = write_submission(tmp_path / "theirs"), place_of(tmp_path / "results")
    (place / "checkpoint").mkdir(parents=True)
    write_json(place / "run.json", {"format": 2, "status": "finished"})
    with raises(ResultsError, tmp_path / "results", values=["holds something else: mine"]):
        verified(root, tmp_path / "results")
    assert (place / "checkpoint").exists()


def test_a_folder_is_of_one_submission_and_keeps_its_marks(tmp_path):
    out = tmp_path / "out"
    (verdict,) = verified(write_submission(tmp_path / "liar", claims=LIES), out)
    assert not (out / "submission").exists()
    assert verdict.status == MARKED
    with raises(ResultsError, out, values=["holds the evaluation of another submission"]):
        verified(write_submission(tmp_path / "other", name="other"), out)
    assert statuses(out) == {"mine": (MARKED, 1)}


def test_what_is_not_judged_is_not_listed_and_not_played_again(tmp_path, monkeypatch):
    root, out = write_submission(tmp_path / "theirs", (1, 2)), tmp_path / "out"

    def killed(*given):
        raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr(verifying, "memorized", killed)
        with pytest.raises(KeyboardInterrupt):
            verified(root, out)
    board = make_leaderboard([out])
    assert not board.places
    assert "2 of 2 runs are not finished" in board.problems[0]
    before = written_at(out, 1, 2)
    verified(root, out)
    assert statuses(out) == {"mine": (MARKED, 2)}
    assert written_at(out, 1, 2) == before


def test_other_files_and_other_fresh_episodes_are_played_again(tmp_path):
    root, out = write_submission(tmp_path / "theirs"), tmp_path / "out"
    (first,) = verified(root, out)
    driven = read_table(RunFolder(place_of(out)).table)["distance_travelled"]
    shutil.rmtree(root / "1" / "mine")
    write_policy(root / "1" / "mine", action=1)
    (second,) = verified(root, out)
    braked = read_table(RunFolder(place_of(out)).table)["distance_travelled"]
    assert (braked < driven).all()
    (third,) = verified(root, out, fresh=2)
    assert (first.fresh, second.fresh, [*third.fresh]) == ({}, {}, ["completion_rate", "collision_rate"])
    table = read_table(RunFolder(place_of(out) / "fresh").table)
    assert (table["world"].nunique(), {*table["seed"]}) == (
        2,
        {read_json(out / "verdicts.json")["fresh_seed"]},
    )


def entry_of(table, **changes):
    claims = {"scores": scores_of(table), "episodes": episode_digests(table)} | changes
    given = {"algorithm": "mine", "task": "intersection", "scenarios": ["intersection"], "traffic": ALONE}
    return Entry(**given, seed=1, benchmark_version=1, agent="policies/mine", **claims)


def played(outcomes, **given):
    return agent_episodes(
        outcomes, mode="greedy", distance_travelled=1.0, duration=2.0, **{"training_seed": 1} | given
    )


def reasons(entry, table):
    return [*differences(entry, scores_of(table), episode_digests(table))]


def test_false_claims_are_marked_however_many_episodes_they_name():
    table = played([["collision", "collision"]] * 4)
    digests = episode_digests(table)["intersection"]
    assert not reasons(entry_of(table), table)
    assert reasons(entry_of(table, episodes={}, scores={}), table) == ["claims no episodes"]
    for episodes in ([*digests, "0" * 12], digests[:3]):
        (reason,) = reasons(entry_of(table, episodes={"intersection": episodes}), table)
        assert reason.startswith(f"claims {len(episodes)} test episodes, 4 were played")
    foreign = {"intersection": digests, "loop": ["0" * 12]}
    assert "claims episodes of loop, which it does not play" in reasons(
        entry_of(table, episodes=foreign), table
    )
    scores = scores_of(table)
    assert reasons(entry_of(table, scores=scores | {"completion_rate": 0.987}), table) == [
        "claims completion_rate 0.987; its episodes give 0.000"
    ]
    assert reasons(entry_of(table, scores=scores | {"safety": 1.0}), table) == [
        "claims safety 1.000, which its episodes do not give"
    ]


def test_one_other_episode_of_two_hundred_is_no_mark_and_three_are():
    """Training computes in 32 bits, an exported policy in 64."""
    outcomes = [["goal", "goal"]] * 150 + [["collision", "goal"]] * 50
    trained = played(outcomes)

    def exported(count):
        return played([["collision", "time_out"]] * count + outcomes[count:])

    assert not reasons(entry_of(trained), exported(1))
    assert not reasons(entry_of(trained), exported(2))
    assert reasons(entry_of(trained), exported(3)) == [
        "other episodes than claimed: 3 of 200 digests differ",
        "claims completion_rate 0.875; its episodes give 0.860",
        "claims collision_rate 0.125; its episodes give 0.133",
    ]
    # One episode of two agents is 0.005 of the rate: it explains no more.
    completion = scores_of(exported(1))["completion_rate"]
    for gap, marks in ((0.0049, 0), (0.0051, 1)):
        scores = {"completion_rate": completion + gap}
        assert len(reasons(entry_of(trained, scores=scores), exported(1))) == marks


def test_an_episode_that_could_not_be_measured_does_not_move_those_behind_it():
    outcomes = [["goal", "goal"]] * 201
    every = played(outcomes)
    claimed, here = (
        every[every["world"] != every["world"].max()],
        every[every["world"] != every["world"].min() + 3],
    )
    assert claimed["world"].nunique() == here["world"].nunique() == 200
    assert not reasons(entry_of(claimed), here)
    assert compared_digests(entry_of(claimed), episode_digests(here)) == (199, 200)


def drawn(rng, rates):
    return played([["goal" if rng.random() < rate else "time_out" for _ in range(4)] for rate in rates])


def test_all_seeds_of_a_cell_are_tested_together():
    """Each seed alone is 0.9 in public and 0.8 in fresh episodes, which might be chance."""
    rng = np.random.Generator(np.random.Philox(1))
    pairs = [(drawn(rng, [0.9] * 100), drawn(rng, [0.8] * 100)) for _ in range(3)]
    (reason,) = memorized({"cell": pairs})["cell"]
    assert reason.startswith("completion rate 0.9")
    honest = [(drawn(rng, [0.85] * 100), drawn(rng, [0.85] * 100)) for _ in range(3)]
    assert not memorized({"cell": honest})


def test_a_difference_is_judged_among_all_cells_of_a_submission():
    """All seven failures are fresh: p = C(10, 7) / C(20, 7); the rate of collisions is a second test."""
    public, fresh = played([["goal"]] * 10), played([["goal"]] * 3 + [["time_out"]] * 7)
    found = p_value(*(verifying._by_episode([each], "goal") for each in (public, fresh)))
    assert abs(found - math.comb(10, 7) / math.comb(20, 7)) < 0.0005
    cells = {f"cell {number}": [(public, public)] for number in range(20)}
    assert memorized({"cell": [(public, fresh)]})
    assert not memorized({"cell": [(public, fresh)], **cells})


def test_the_permutation_test_counts_what_enumeration_counts():
    larger, smaller = np.array([1.0, 0.5, 1.0, 0.75]), np.array([0.0, 0.5, 0.25])
    both = np.concatenate([larger, smaller])
    sums = [both[[*chosen]].sum() for chosen in itertools.combinations(range(7), 4)]
    exact = np.mean([each >= larger.sum() - 1e-9 for each in sums])
    assert abs(p_value(larger, smaller) - exact) < 0.003
    assert p_value(smaller, larger) == 1.0
    assert p_value(larger, larger[:0]) == 1.0


def test_two_seeds_have_no_rank():
    def policies(algorithm, seeds, knows_test=False):
        given = {"name": "theirs", "author": "", "agent": "", "status": CONFIRMED, "experiment": "theirs"}
        given |= {"algorithm": algorithm, "task": "loop", "scenarios": ["loop"], "traffic": ALONE}
        for seed in range(seeds):
            knows = knows_test and seed == 0
            yield Submitted(**given, seed=seed, reasons=[], claimed={}, knows_test=knows)

    found = by_entry([*policies("few", 2), *policies("enough", 3), *policies("knowing", 3, True)])
    ranked = {key[1]: may_be_ranked(each) for key, each in found.items()}
    assert ranked == {"few": False, "enough": True, "knowing": False}


def test_who_knows_the_test_has_no_rank(tmp_path, monkeypatch):
    """The others of three submissions are ranked; the first is marked, and stands in no summary."""
    names = ("first", "second", "third")
    roots = [write_submission(tmp_path / name, (1, 2, 3), algorithm=name, name=name) for name in names]
    outs = [tmp_path / f"out_{name}" for name in names]
    reason = "completion rate 1.000 in the public test: it knows the test"
    with monkeypatch.context() as patched:
        patched.setattr(verifying, "memorized", lambda cells: {cell: [reason] for cell in cells})
        verdict, *_ = verified(roots[0], outs[0], fresh=1, episodes=2)
    assert (verdict.status, verdict.knows_test, verdict.reasons[-1]) == (MARKED, True, reason)
    for root, out in zip(roots[1:], outs[1:], strict=True):
        verified(root, out, episodes=2)
    board = make_leaderboard(outs)
    assert {each.algorithm: (each.standing.rank, each.knows_test) for each in board.places} == {
        "first": (None, True),
        "second": (1, False),
        "third": (1, False),
    }
    assert {each.paradigm for each in board.places} == {"as submitted"}
    assert sorted(each.algorithm for each in board.summaries) == ["second", "third"]
    own = board.submitted[-1]
    assert MAY_EXCHANGE in own.remarks  # an algorithm that is not known here
    assert MAY_EXCHANGE not in own.model_copy(update={"algorithm": "ppo"}).remarks
    assert (
        MAY_EXCHANGE in own.model_copy(update={"algorithm": "ppo", "agent": "tcp://localhost:7000"}).remarks
    )


@pytest.mark.parametrize(
    ("error", "is_agents"), [(HostError("it has ended"), True), (TrafficError("SUMO has ended"), False)]
)
def test_a_failing_agent_is_refused_and_a_failure_of_the_evaluator_is_none(
    tmp_path, monkeypatch, error, is_agents
):
    root, out, play = write_submission(tmp_path / "theirs", (1, 2)), tmp_path / "out", verifying.play_agent

    def fails(setting, folder, agent, labels, **given):
        if labels["training_seed"] == 2:
            raise error
        return play(setting, folder, agent, labels, **given)

    with monkeypatch.context() as patched:
        patched.setattr(verifying, "play_agent", fails)
        if is_agents:
            one, two = verified(root, out)
            assert (one.status, two.status, two.reasons) == (MARKED, REFUSED, [error.problem])
        else:
            with pytest.raises(TrafficError, match=error.problem):
                verified(root, out)
    if is_agents:
        assert not place_of(out, 2).exists()
        assert statuses(out) == {"mine": (REFUSED, 1)}
        write_leaderboard([out], tmp_path / "page.html", "greedy")
        assert error.problem in (tmp_path / "page.html").read_text()
    else:
        before = written_at(out, 1)
        assert [each.status for each in verified(root, out)] == [MARKED, MARKED]  # they claim nothing
        assert written_at(out, 1) == before
