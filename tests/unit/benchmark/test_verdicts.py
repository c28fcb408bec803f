"""Verdicts on submissions: nothing of others is lost, nothing false confirmed, nothing honest marked."""

import itertools
import json
import math
import shutil
from dataclasses import replace

import numpy as np
import pytest

from benchmark.experiment import version
from benchmark.experiment.config import Evaluation, TrainingTask
from benchmark.experiment.environment import Environment
from benchmark.experiment.runs import TaskSetting
from benchmark.experiment.version import code_digests, frozen_text
from benchmark.metrics import read_table
from benchmark.report.leaderboard import make_leaderboard
from benchmark.report.leaderboard_page import write_leaderboard
from benchmark.report.submissions import MAY_EXCHANGE
from benchmark.results.files import ResultsError, locked, write_json
from benchmark.results.release import (
    CONFIRMED,
    MANIFEST,
    MARKED,
    REFUSED,
    Entry,
    episode_digests,
    read_manifest,
    scores_of,
)
from benchmark.results.run_folder import RunFolder
from benchmark.running import judging, verifying
from benchmark.running.judging import differences, equal_digests, memorized, p_value
from benchmark.running.played import scenario_digests
from benchmark.running.submission_folder import write_claims
from benchmark.running.submissions import submitted
from benchmark.running.verifying import verify
from smarts.agents.hosting.options import HostError
from smarts.errors import OwnCodeError, TrafficError
from smarts_agent_kit.weights import file_digest
from tests.hand_made_results import ALONE, agent_episodes

ENVIRONMENT = Environment(agents=2, reward="v1", time_limit=2.0)
PLACE = ("loop", ALONE)


@pytest.fixture(autouse=True)
def frozen(tmp_path_factory, monkeypatch):
    """Version 1 is the present code, and `loop` without traffic."""
    file = tmp_path_factory.mktemp("version") / "versions.yaml"
    monkeypatch.setattr(version, "FILE", file)
    version.versions.cache_clear()
    file.write_text(frozen_text(1, {ALONE: scenario_digests(task_setting(held_out=1))}, ENVIRONMENT))
    yield
    version.versions.cache_clear()


def task_setting(held_out=0):
    task, test = TrainingTask(name="loop", scenarios=("loop",)), Evaluation(held_out_episodes=held_out)
    return TaskSetting(task, ALONE, ENVIRONMENT, test, num_envs=1)


def write_policy(folder, algorithm="mine", seed=1, action=0):
    """Write an exported policy that always takes one action; its weights are those of its seed."""
    driving = {"vehicle": "generic_sedan", "vehicle_model": "bullet", "tyre_model": "pacejka"}
    agents = [
        {"group": "all", "place": k, "number": k, "flat_tyres": []} | driving
        for k in range(ENVIRONMENT.agents)
    ]
    content = {
        **{"format": 1, "run": "by hand", "index": None, "leaves": ["observation"], "period": 5},
        "observation": {"frames": 3, "stacked": [], "features": ["speed"]},
        **{"action": "Lane", "head": "best", "bounds": {"masked": False, "start": 0}},
        "agents": {f"agent-{k}": each for k, each in enumerate(agents)},
        "groups": {"all": {"places": 0, "memory": 0, "layers": ["linear"]}},
        "trained": {
            **{"algorithm": algorithm, "task": "loop", "scenarios": ["loop"], "traffic": ALONE, "seed": seed},
            **{"environment": ENVIRONMENT.content(), "benchmark_version": 1},
        },
    }
    biases = np.zeros(4, np.float32)
    biases[action] = 1.0 + seed
    folder.mkdir(parents=True)
    (folder / "policy.json").write_text(json.dumps(content))
    np.savez(folder / "policy.npz", **{"all/0/0": np.zeros((1, 4), np.float32), "all/0/1": biases})
    return folder


def write_submission(root, seeds=(1,), algorithm="mine", name="theirs", **claims):
    """Write a submission, by default without claims; with them its manifest says which files it has."""
    files = {}
    for seed in seeds:
        folder = write_policy(root / f"{seed}" / "mine", algorithm, seed)
        there = folder.iterdir() if claims else ()
        files[seed] = {each.name: file_digest(each.read_bytes()) for each in there}
    entry = {
        **{"algorithm": algorithm, "task": "loop", "scenarios": ["loop"], "traffic": ALONE},
        "benchmark_version": 1,
    }
    manifest = {
        **{"format": 1, "name": name, "author": "A. Author", "benchmark_version": 1},
        **{"code": code_digests(), "environment": ENVIRONMENT.content()},
        "scenarios": {ALONE: scenario_digests(task_setting())},
        "policies": [
            entry | claims | {"seed": seed, "agent": f"{seed}/mine", "files": files[seed]} for seed in seeds
        ],
    }
    write_json(root / MANIFEST, manifest)
    return root


def verified(root, out, **given):
    manifest, folder = submitted(str(root), number=None, scenarios=(), traffic=())
    return [*verify(manifest, folder, out, **{"episodes": 1, "fresh": 0} | given)]


def claimed(root, out):
    manifest, folder = submitted(str(root), number=None, scenarios=(), traffic=())
    return write_claims(manifest, folder, out)


def place_of(out, seed=1, algorithm="mine"):
    return out.joinpath(algorithm, *PLACE, f"seed_{seed}")


def statuses(*roots):
    return {
        each.algorithm: (each.status, each.completion.seeds) for each in make_leaderboard([*roots]).places
    }


def write_training(place):
    (place / "checkpoint").mkdir(parents=True)
    (place / "checkpoint" / "weights.pkl").write_text("days of training")
    write_json(place / "run.json", {"format": 2, "status": "finished"})


def test_the_results_of_trainings_are_never_removed(tmp_path):
    root, out = write_submission(tmp_path / "theirs"), tmp_path / "results"
    write_training(place_of(out))
    with pytest.raises(ResultsError, match="holds something else: mine"):
        verified(root, out)
    assert (place_of(out) / "checkpoint" / "weights.pkl").exists()
    # Trained into a folder of verdicts.
    other = tmp_path / "other"
    verified(root, other)
    shutil.rmtree(place_of(other))
    write_training(place_of(other))
    with pytest.raises(ResultsError, match="holds the results of a run"):
        verified(root, other)
    assert (place_of(other) / "checkpoint" / "weights.pkl").exists()


def test_a_folder_is_of_one_submission_and_keeps_its_marks(tmp_path):
    lies = {"scores": {"completion_rate": 1.0}, "episodes": {"loop": ["x"]}}
    liar = write_submission(tmp_path / "liar", algorithm="liar", **lies)
    (verdict,) = verified(liar, tmp_path / "out")
    assert verdict.status == MARKED
    other = write_submission(tmp_path / "other", name="other")
    with pytest.raises(ResultsError, match="holds the evaluation of another submission"):
        verified(other, tmp_path / "out")
    # Neither an older file nor none takes the mark away.
    file = tmp_path / "out" / "verdicts.json"
    file.write_text('{"verdicts": []}')
    assert statuses(tmp_path / "out") == {"liar": (MARKED, 1)}
    file.unlink()
    assert statuses(tmp_path / "out") == {"liar": (MARKED, 1)}


def test_what_is_not_judged_is_not_listed_and_not_played_again(tmp_path, monkeypatch):
    root, out = write_submission(tmp_path / "theirs", seeds=(1, 2)), tmp_path / "out"

    def killed(*given):
        raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr(verifying, "_judged", killed)
        with pytest.raises(KeyboardInterrupt):
            verified(root, out)
    board = make_leaderboard([out])
    assert not board.places
    assert "2 of 2 runs are not finished" in board.problems[0]
    before = [RunFolder(place_of(out, seed)).table.stat().st_mtime_ns for seed in (1, 2)]
    with monkeypatch.context() as patched:  # after run.json, before verdicts.json
        patched.setattr(verifying, "write_verdicts", killed)
        with pytest.raises(KeyboardInterrupt):
            verified(root, out)
    assert statuses(out) == {"mine": (MARKED, 2)}
    verified(root, out)
    assert [RunFolder(place_of(out, seed)).table.stat().st_mtime_ns for seed in (1, 2)] == before


def test_other_files_and_other_fresh_episodes_are_played_again(tmp_path):
    root, out = write_submission(tmp_path / "theirs"), tmp_path / "out"
    (first,) = verified(root, out)
    driven = read_table(RunFolder(place_of(out)).table)["distance_travelled"]
    assert claimed(root, out) is not None
    shutil.rmtree(root / "1" / "mine")
    write_policy(root / "1" / "mine", action=1)
    assert claimed(root, out) is None  # What was played is no longer there.
    (second,) = verified(root, out)
    braked = read_table(RunFolder(place_of(out)).table)["distance_travelled"]
    assert (braked < driven).all()
    assert (first.fresh, second.fresh) == ({}, {})
    (third,) = verified(root, out, fresh=None)
    assert third.fresh["episodes"] == 1  # As many as public ones.
    (fourth,) = verified(root, out, fresh=2)
    assert (fourth.fresh["episodes"], fourth.fresh["seed"]) == (2, third.fresh["seed"])
    table = read_table(RunFolder(place_of(out) / "fresh").table)
    assert table["world"].nunique() == 2
    assert {*table["seed"]} == {fourth.fresh["seed"]}


def entry_of(table, **changes):
    claims = {"scores": scores_of(table), "episodes": episode_digests(table)} | changes
    given = {"algorithm": "mine", "task": "intersection", "scenarios": ["intersection"], "traffic": ALONE}
    return Entry(**given, seed=1, benchmark_version=1, agent="policies/mine", **claims)


def played(outcomes, **given):
    return agent_episodes(
        outcomes, mode="greedy", distance_travelled=1.0, duration=2.0, **{"training_seed": 1} | given
    )


def reasons(entry, table):
    return [*differences(entry, table, scores_of(table), episode_digests(table))]


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


def test_scores_that_are_no_numbers_are_refused(tmp_path):
    root = write_submission(tmp_path, scores={"completion_rate": float("nan")}, episodes={"loop": ["x"]})
    with pytest.raises(ResultsError, match="completion_rate"):
        read_manifest(root)


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
    assert equal_digests(entry_of(claimed), episode_digests(here)) == {"intersection": (199, 200)}


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


def test_a_copy_of_a_policy_is_no_further_evidence():
    """Policies of a cell play the same episodes, whose difficulty they share."""
    rng = np.random.Generator(np.random.Philox(2))
    public, fresh = drawn(rng, [0.9] * 40), drawn(rng, [0.78] * 40)
    one, many = (
        [judging._by_episode([table] * count, "goal") for table in (public, fresh)] for count in (1, 9)
    )
    assert np.allclose(one[0], many[0])
    assert p_value(*one) == p_value(*many)


def test_a_difference_is_judged_among_all_cells_of_a_submission():
    """All seven failures are fresh: p = C(10, 7) / C(20, 7); the rate of collisions is a second test."""
    public, fresh = played([["goal"]] * 10), played([["goal"]] * 3 + [["time_out"]] * 7)
    found = p_value(*(judging._by_episode([each], "goal") for each in (public, fresh)))
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


def test_who_knows_the_test_has_no_rank(tmp_path, monkeypatch):
    """The others of three submissions are ranked; the first is marked, and stands in no summary."""
    names = ("first", "second", "third")
    first, second, third = (
        write_submission(tmp_path / name, seeds=(1, 2, 3), algorithm=name, name=name) for name in names
    )
    with monkeypatch.context() as patched:
        reason = "completion rate 1.000 in the public test: it knows the test"
        patched.setattr(verifying, "memorized", lambda cells: {cell: [reason] for cell in cells})
        verdict, _, _ = verified(first, tmp_path / "one", fresh=1, episodes=2)
    assert (verdict.status, verdict.knows_test) == (MARKED, True)
    assert verdict.reasons[-1] == reason
    verified(second, tmp_path / "two", fresh=1, episodes=2)
    verified(third, tmp_path / "three", fresh=1, episodes=2)
    board = make_leaderboard([tmp_path / name for name in ("one", "two", "three")])
    assert {each.algorithm: (each.rank, each.knows_test) for each in board.places} == {
        "first": (None, True),
        "second": (1, False),
        "third": (1, False),
    }
    assert {each.paradigm for each in board.places} == {"as submitted"}
    assert sorted(each.algorithm for each in board.summaries) == ["second", "third"]
    own = board.submitted[-1]
    assert own.remarks == [*own.reasons, MAY_EXCHANGE]  # an algorithm that is not known here
    assert MAY_EXCHANGE not in replace(own, algorithm="ppo").remarks
    assert MAY_EXCHANGE in replace(own, algorithm="ppo", agent="tcp://localhost:7000").remarks


def test_claims_hold_two_files_of_each_policy_and_nothing_else(tmp_path):
    root, out = write_submission(tmp_path / "theirs", seeds=(1, 2)), tmp_path / "out"
    (tmp_path / "secret").write_text("a private key")
    for seed in (1, 2):
        (root / f"{seed}" / "mine" / "notes.txt").symlink_to(tmp_path / "secret")
        (root / f"{seed}" / "mine" / "folder").mkdir()
    verified(root, out)
    claims = claimed(root, out)
    files = {each.relative_to(claims).as_posix() for each in claims.rglob("*") if each.is_file()}
    names = [f"policies/mine_loop_{ALONE}_{seed}" for seed in (1, 2)]
    assert files == {MANIFEST} | {f"{name}/policy.{end}" for name in names for end in ("json", "npz")}
    for name, seed in zip(names, (1, 2), strict=True):
        for end in ("json", "npz"):
            given = root / f"{seed}" / "mine" / f"policy.{end}"
            assert (claims / name / f"policy.{end}").read_bytes() == given.read_bytes()
    again = verified(claims, tmp_path / "again")
    assert {each.status for each in again} == {CONFIRMED}
    digest = file_digest((root / "1" / "mine" / "policy.npz").read_bytes())
    assert again[0].entry.files["policy.npz"] == digest


def test_claims_are_written_by_one_process_at_a_time(tmp_path):
    root, out = write_submission(tmp_path / "theirs"), tmp_path / "out"
    verified(root, out)
    with locked(out), pytest.raises(ResultsError, match="is writing here"):
        claimed(root, out)


@pytest.mark.parametrize("error", [HostError("it has ended"), OwnCodeError("it answers 7")])
def test_a_failing_agent_is_refused(tmp_path, monkeypatch, error):
    root, out = write_submission(tmp_path / "theirs", seeds=(1, 2)), tmp_path / "out"
    play = verifying.play_agent

    def fails(setting, folder, agent, labels, **given):
        if labels["training_seed"] == 2:
            raise error
        return play(setting, folder, agent, labels, **given)

    monkeypatch.setattr(verifying, "play_agent", fails)
    one, two = verified(root, out)
    assert (one.status, two.status, two.reasons) == (MARKED, REFUSED, (error.problem,))
    assert not place_of(out, 2).exists()
    assert statuses(out) == {"mine": (REFUSED, 1)}
    write_leaderboard([out], tmp_path / "page.html", "greedy")
    page = tmp_path / "page.html"
    assert "other seeds of its cell are listed there" in page.read_text()
    assert error.problem in page.read_text()


@pytest.mark.parametrize("error", [TrafficError("SUMO has ended"), ResultsError("no space left")])
def test_a_failure_of_the_evaluator_is_no_refusal(tmp_path, monkeypatch, error):
    root, out = write_submission(tmp_path / "theirs", seeds=(1, 2)), tmp_path / "out"
    with monkeypatch.context() as patched:
        play = verifying.play_agent

        def fails(setting, folder, agent, labels, **given):
            if labels["training_seed"] == 2:
                raise error
            return play(setting, folder, agent, labels, **given)

        patched.setattr(verifying, "play_agent", fails)
        with pytest.raises(type(error), match=error.problem):
            verified(root, out)
    before = RunFolder(place_of(out)).table.stat().st_mtime_ns
    assert [each.status for each in verified(root, out)] == [MARKED, MARKED]  # they claim nothing
    assert RunFolder(place_of(out)).table.stat().st_mtime_ns == before


def test_an_honest_submission_is_confirmed(tmp_path):
    root = write_submission(tmp_path / "theirs", seeds=(1, 2, 3))
    verified(root, tmp_path / "own")
    verdicts = verified(claimed(root, tmp_path / "own"), tmp_path / "out", fresh=None)
    assert [each.status for each in verdicts] == [CONFIRMED] * 3
    assert statuses(tmp_path / "out") == {"mine": (CONFIRMED, 3)}
