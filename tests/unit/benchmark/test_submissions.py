"""Submissions are played again: honest ones are confirmed, and each cheat is refused or marked by name."""

import json
import re
import shutil
import socket
import struct
import sys
import tracemalloc
import zipfile
from contextlib import nullcontext
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from benchmark.cli.experiments import evaluate as evaluate_command
from benchmark.experiment import version
from benchmark.experiment.config import Evaluation, TrainingTask
from benchmark.experiment.environment import Environment
from benchmark.experiment.runs import TaskSetting
from benchmark.experiment.version import code_digests, frozen_text
from benchmark.metrics import read_table
from benchmark.report.leaderboard import make_leaderboard
from benchmark.report.leaderboard_page import write_leaderboard
from benchmark.report.submissions import Submitted, marks_of
from benchmark.results.files import ResultsError, write_json
from benchmark.results.release import (
    CONFIRMED,
    MANIFEST,
    MARKED,
    REFUSED,
    Manifest,
    episode_digests,
    read_manifest,
    scores_of,
)
from benchmark.results.run_folder import RunFolder
from benchmark.running.blind import BlindAgent
from benchmark.running.evaluate_agent import evaluate_exported, play_agent
from benchmark.running.judging import memorized
from benchmark.running.played import scenario_digests
from benchmark.running.releasing import _check_free, _check_names, _policy_name, write_release
from benchmark.running.submission_folder import write_claims
from benchmark.running.submissions import agent_of, check_manifest, submitted
from benchmark.running.trained import own_scenarios
from benchmark.running.verifying import verify
from smarts.agents.hosting.facts import check_observation
from smarts.agents.hosting.options import HostError
from smarts.agents.policy import ActionBatch, BatchAgent
from smarts.config import fitted
from smarts.errors import OwnCodeError, SmartsError
from smarts.types.streams import hold_seed
from smarts.zoo.exported import ExportedPolicy
from smarts_agent_kit.weights import file_digest
from tests.hand_made_results import ALONE, agent_episodes, write_experiment, write_run
from tests.raising import raises
from tests.served_agents import served

ENVIRONMENT = Environment(agents=2, reward="v1", time_limit=5.0)
EPISODES = 2
SEED_READER = '''
import hashlib
import numpy as np
from smarts_agent_kit import BatchAgent

KNOWN = {
    hashlib.blake2b(f"smarts-bench|42|{2_000_000 + world}|0|hold|agent-{k}".encode(), digest_size=8).digest()
    for world in range(50) for k in range(2)
}

class SeedReader(BatchAgent):
    """Drives where it knows the test's seed, and else stops."""
    interface = {"action": "Lane", "vehicle_model": "bullet", "tyre_model": "pacejka"}
    observation = ["speed"]
    period = 5

    def act(self, batch):
        known = [int(seed).to_bytes(8, "little") in KNOWN for seed in batch.seed]
        return np.where(known, 0, 1)
'''


def task_setting(scenario="loop"):
    task = TrainingTask(name=scenario, scenarios=(scenario,))
    return TaskSetting(task, ALONE, ENVIRONMENT, Evaluation(episodes=EPISODES), num_envs=1)


@pytest.fixture(autouse=True)
def frozen(tmp_path_factory, monkeypatch):
    """Version 1 is the present code, and `loop` without traffic."""
    file = tmp_path_factory.mktemp("version") / "versions.yaml"
    monkeypatch.setattr(version, "FILE", file)
    version.versions.cache_clear()
    every = replace(task_setting(), evaluation=Evaluation(held_out_episodes=1))
    file.write_text(frozen_text(1, {ALONE: scenario_digests(every)}, ENVIRONMENT))
    yield file
    version.versions.cache_clear()


def write_policy(
    folder, features=("speed",), biases=(1.0, 0.0, 0.0, 0.0), number=1, seed=1, layers=None, **trained
):
    """Write an exported policy whose action is that of the largest bias, or of other layers."""
    if layers is None:
        layers = [("linear", np.zeros((1, 4), np.float32), seed * np.array(biases, np.float32))]
    driving = {"vehicle": "generic_sedan", "vehicle_model": "bullet", "tyre_model": "pacejka"}
    content = {
        **{"format": 1, "run": "by hand", "index": None, "leaves": ["observation"], "period": 5},
        "observation": {"frames": 3, "stacked": [], "features": [*features]},
        **{"action": "Lane", "head": "best", "bounds": {"masked": False, "start": 0}},
        "agents": {
            f"agent-{k}": {"group": "all", "place": k, "number": k, "flat_tyres": []} | driving
            for k in range(2)
        },
        "groups": {"all": {"places": 0, "memory": 0, "layers": [kind for kind, *_ in layers]}},
        "trained": {
            **{"algorithm": "mine", "task": "loop", "scenarios": ["loop"], "traffic": ALONE, "seed": seed},
            **{"environment": ENVIRONMENT.content(), "benchmark_version": number},
            **trained,
        },
    }
    folder.mkdir(parents=True)
    (folder / "policy.json").write_text(json.dumps(content))
    weights = {f"all/{k}/{n}": each for k, layer in enumerate(layers) for n, each in enumerate(layer[1:])}
    np.savez(folder / "policy.npz", allow_pickle=False, **weights)
    return folder


@pytest.fixture(scope="module")
def claimed(tmp_path_factory):
    """Return scores and digests of the policy that keeps its lane, by playing it without its claims."""
    root = tmp_path_factory.mktemp("claimed")
    table = evaluate_exported(write_policy(root / "mine"), episodes=EPISODES)
    return scores_of(table), episode_digests(table)


@pytest.fixture
def submission(tmp_path, claimed):
    """Return a function that writes a submission with three policies that act alike, perhaps changed."""

    def write(changes=lambda manifest: None, **given):
        root = tmp_path / "submission"
        scores, digests = claimed
        entries = []
        for seed in (1, 2, 3):
            policy = write_policy(root / "policies" / f"mine_{seed}", seed=seed, **given)
            entry = {
                **{"algorithm": "mine", "task": "loop", "scenarios": ["loop"], "traffic": ALONE},
                **{"benchmark_version": 1, "agent": f"policies/mine_{seed}", "seed": seed},
                **{"scores": scores, "episodes": digests},
                "files": {each.name: file_digest(each.read_bytes()) for each in policy.iterdir()},
            }
            entries.append(json.loads(json.dumps(entry)))
        manifest = {
            **{"format": 1, "name": "theirs", "author": "A. Author", "benchmark_version": 1},
            **{"code": code_digests(), "environment": ENVIRONMENT.content()},
            "scenarios": {ALONE: scenario_digests(task_setting())},
            "policies": entries,
        }
        changes(manifest)
        write_json(root / MANIFEST, manifest)
        return root

    return write


def verified(root, out, **given):
    manifest, folder = submitted(str(root), number=None, scenarios=(), traffic=())
    return [*verify(manifest, folder, out, **{"episodes": EPISODES, "fresh": 0} | given)]


def test_an_honest_submission_is_confirmed_and_listed(submission, tmp_path):
    root, out = submission(), tmp_path / "theirs"
    verdicts = verified(root, out)
    assert [verdict.status for verdict in verdicts] == [CONFIRMED] * 3
    assert {(verdict.equal, verdict.compared) for verdict in verdicts} == {(EPISODES, EPISODES)}
    assert verdicts[0].scores == verdicts[0].entry.scores
    before = (out / "mine" / "loop" / ALONE / "seed_1" / "run.json").stat().st_mtime_ns
    assert [verdict.status for verdict in verified(root, out)] == [CONFIRMED] * 3
    assert (out / "mine" / "loop" / ALONE / "seed_1" / "run.json").stat().st_mtime_ns == before
    board = make_leaderboard([out])
    assert [(place.algorithm, place.status, place.completion.seeds) for place in board.places] == [
        ("mine", CONFIRMED, 3)
    ]
    assert not board.problems
    write_leaderboard([out], tmp_path / "page.html", "greedy")
    assert "theirs, A. Author" in (tmp_path / "page.html").read_text()


def test_an_exported_policy_without_claims_gets_a_submission_that_is_confirmed(tmp_path):
    policy, out = write_policy(tmp_path / "mine"), tmp_path / "out"
    manifest, folder = submitted(str(policy), number=None, scenarios=(), traffic=())
    (verdict,) = verify(manifest, folder, out, episodes=EPISODES, fresh=1)
    assert verdict.reasons == ("claims no episodes",)
    assert verdict.fresh["episodes"] == 1
    claims = write_claims(manifest, folder, out)
    (again,) = verified(claims, tmp_path / "again")
    assert again.status == CONFIRMED
    assert (again.equal, again.compared) == (EPISODES, EPISODES)


def test_other_episode_digests_and_scores_than_the_own_ones_are_marked(submission, tmp_path):
    def cheat(manifest):
        digests = manifest["policies"][1]["episodes"]["loop"]
        digests[0] = "0" * len(digests[0])
        manifest["policies"][1]["scores"]["completion_rate"] = 1.0

    out = tmp_path / "out"
    first, second, _ = verified(submission(cheat), out)
    assert (first.status, second.status) == (CONFIRMED, MARKED)
    assert second.reasons == (
        "other episodes than claimed: 1 of 2 digests differ",
        "claims completion_rate 1.000; its episodes give 0.000",
    )
    (place,) = make_leaderboard([out]).places
    assert (place.status, place.completion.value) == (MARKED, 0.0)


def test_another_policy_than_the_one_that_made_the_claims_is_marked(submission, tmp_path):
    """It brakes; the claims are of one that drives."""
    verdicts = verified(submission(biases=(0.0, 1.0, 0.0, 0.0)), tmp_path / "out")
    assert {verdict.status for verdict in verdicts} == {MARKED}
    assert {verdict.equal for verdict in verdicts} == {0}


def test_observations_that_the_task_does_not_declare_are_refused(submission, tmp_path):
    out = tmp_path / "out"
    verdicts = verified(submission(features=("speed", "neighbor_rows")), out)
    assert {verdict.status for verdict in verdicts} == {REFUSED}
    assert "does not declare: neighbor_rows" in verdicts[0].reasons[0]
    board = make_leaderboard([out])
    assert not board.places
    assert [each.status for each in board.submitted] == [REFUSED] * 3
    write_leaderboard([out], tmp_path / "page.html", "greedy")
    assert "neighbor_rows" in (tmp_path / "page.html").read_text()


def set_version(manifest):
    manifest["policies"][2]["benchmark_version"] = None


def change_scenario(manifest):
    manifest["scenarios"][ALONE]["loop"] = "0123456789abcdef"


def change_settings(manifest):
    manifest["environment"]["agents"] = 1


def change_code(manifest):
    manifest["code"]["reward"] = "0123456789abcdef"


def repeat_seed(manifest):
    manifest["policies"][2]["seed"] = 1


def leave_the_folder(manifest):
    manifest["policies"][0]["agent"] = "../../elsewhere"


def play_another_scenario(manifest):
    manifest["policies"][0]["scenarios"] = ["intersection"]


@pytest.mark.parametrize(
    ("change", "named"),
    [
        (set_version, "mixed versions of the benchmark: 1, none"),
        (change_scenario, f"its scenario loop, {ALONE} is not that of version 1"),
        (change_settings, "its environment.agents is not that of version 1"),
        (change_code, "its code of reward is not that of version 1"),
        (repeat_seed, "mine, loop, no_social_vehicles, seed 1 is there twice"),
        (leave_the_folder, "is outside of the submission"),
        (play_another_scenario, "intersection, no_social_vehicles is no scenario of version 1"),
    ],
)
def test_a_submission_of_something_else_is_refused_by_name(submission, tmp_path, change, named):
    with pytest.raises(ResultsError) as caught:
        verified(submission(change), tmp_path / "out")
    assert named in caught.value.problem
    assert not (tmp_path / "out").exists()


def test_a_policy_of_another_version_or_with_other_weights_is_refused(submission, tmp_path):
    root = submission(number=None)
    with pytest.raises(ResultsError, match="its policy was trained under none"):
        verified(root, tmp_path / "out")
    shutil.rmtree(root)
    root = submission()
    with (root / "policies/mine_1/policy.npz").open("ab") as file:
        file.write(b"x")
    with pytest.raises(ResultsError, match=r"policy\.npz is not the file that its manifest describes"):
        verified(root, tmp_path / "out")


def test_a_changed_scenario_of_the_evaluator_is_refused_too(submission, tmp_path, frozen):
    root = submission()
    frozen.write_text(
        frozen.read_text().replace(scenario_digests(task_setting())["loop"], "0123456789abcdef")
    )
    version.versions.cache_clear()
    with pytest.raises(ResultsError, match="this program's scenario loop"):
        verified(root, tmp_path / "out")


def test_files_that_the_manifest_does_not_describe_are_refused(submission, tmp_path):
    problem = refusal(submission(unlisted), tmp_path / "out")
    assert "policy.json is not the file that its manifest describes" in problem


def test_two_seeds_are_confirmed_and_have_no_rank():
    def policies(algorithm, seeds, knows_test=False):
        names = ("theirs", "theirs", "an author", algorithm, "loop", ALONE)
        return [
            Submitted(*names, seed, "", CONFIRMED, (), {}, {}, (4, 4), knows_test and seed == 1)
            for seed in range(1, seeds + 1)
        ]

    marks = marks_of([*policies("few", 2), *policies("enough", 3), *policies("knowing", 3, True)])
    assert {key[1]: mark.is_ranked for key, mark in marks.items()} == {
        "few": False,
        "enough": True,
        "knowing": False,
    }


def test_the_results_of_missing_seeds_are_not_released(tmp_path):
    write_experiment(tmp_path / "one", seeds=[1, 2, 3])
    run = write_run(tmp_path / "one", "ppo", [agent_episodes([["goal", "goal"]] * 3, mode="greedy")])
    (run / "checkpoint").mkdir()
    with pytest.raises(ResultsError) as caught:
        write_release(tmp_path / "one", tmp_path / "release")
    assert caught.value.problem == "incomplete: ppo, intersection, no_social_vehicles, seeds 2, 3: not begun"
    (run / "checkpoint").rmdir()
    for partial in (False, True):  # as of runs whose checkpoints git does not keep
        with raises(ResultsError, values=["seed 1 has no last checkpoint here"]):
            write_release(tmp_path / "one", tmp_path / "release", is_partial=partial)
    assert not (tmp_path / "release").exists()


def test_digests_of_a_manifest_are_one_line_or_a_list(submission):
    root = submission()
    manifest = read_manifest(root)
    written = manifest.content()
    assert written["policies"][0]["episodes"]["loop"] == " ".join(manifest.policies[0].episodes["loop"])
    (root / "manifest.json").write_text(json.dumps(written))
    assert read_manifest(root) == manifest


def test_fewer_seeds_than_an_entry_has_are_not_released(tmp_path):
    write_experiment(tmp_path / "one", seeds=[1, 2])
    for seed in (1, 2):
        run = write_run(
            tmp_path / "one", "ppo", [agent_episodes([["goal", "goal"]] * 3, mode="greedy")], seed=seed
        )
        (run / "checkpoint").mkdir()
    with pytest.raises(ResultsError, match="has seeds 1, 2 alone, of at least 3"):
        write_release(tmp_path / "one", tmp_path / "release")


def test_a_release_replaces_only_what_it_holds_itself(submission, tmp_path):
    root = submission()
    manifest = read_manifest(root)
    runs = [SimpleNamespace(algorithm="mine", task="loop", traffic=ALONE, seed=seed) for seed in (1, 2, 3)]
    _check_free(tmp_path / "new", "theirs", "A. Author", [])
    _check_free(root, "theirs", "A. Author", runs)
    for author, kept, named in (("", runs, "A. Author"), ("A. Author", runs[:1], "seed 2")):
        with raises(ResultsError, str(root), values=[named]):
            _check_free(root, "theirs", author, kept)
    (root / "notes.md").write_text("mine")
    with raises(ResultsError, str(root), values=["notes.md"]):
        _check_free(root, "theirs", "A. Author", runs)
    assert read_manifest(root) == manifest


def test_scenarios_of_ones_own_are_told_apart():
    names = ["loop", "two_way_v1@two_lanes", "/home/me/junction", "/home/me/junction", "mine@dense"]
    assert own_scenarios(names) == ["/home/me/junction", "mine@dense"]


def test_names_of_policies_are_told_apart(tmp_path):
    runs = [
        SimpleNamespace(algorithm=name, task="loop", traffic=ALONE, seed=1) for name in ("2_step", "my-own")
    ]
    assert _policy_name(runs[0]) == "policy-2-step-loop-no-social-vehicles-1"
    _check_names(runs, "here")
    alike = SimpleNamespace(**{**vars(runs[1]), "algorithm": "My_own"})
    with raises(ResultsError, "here", values=["my-own-loop"]):
        _check_names([*runs, alike], "here")


def test_where_nothing_listens_there_is_no_verdict(submission, tmp_path):
    with socket.create_server(("127.0.0.1", 0)) as listening:
        address = f"tcp://127.0.0.1:{listening.getsockname()[1]}"
    with pytest.raises(HostError, match=re.escape(address)):
        verified(address, tmp_path / "out")
    assert not (tmp_path / "out").exists()
    (tmp_path / "out").mkdir()
    with pytest.raises(HostError):
        verified(address, tmp_path / "out")
    assert not [*tmp_path.rglob("verdicts.json"), *tmp_path.rglob("run.json")]


class Spy(BatchAgent):
    """Keeps what it is asked."""

    observation = ("speed",)
    period = 5

    def __init__(self):
        self.asked = []

    def act(self, obs):
        self.asked.append(obs)
        return np.zeros(len(obs.env_id), int)


def test_an_agent_gets_no_seed_and_no_number_of_the_episode(tmp_path):
    """Two runs of other seeds and worlds differ in nothing but what is seen."""
    asked = []
    for seed in (42, 43):
        spy = Spy()
        for _ in play_agent(
            task_setting(), RunFolder(tmp_path / str(seed)), BlindAgent(spy), LABELS, mode="greedy", seed=seed
        ):
            pass
        asked.append(spy.asked)
    for batch in (*asked[0], *asked[1]):
        assert not batch.env_id.any()
        assert not batch.episode.any()
    for batches in asked:
        came = np.concatenate([batch.hold[batch.is_first] for batch in batches])
        np.testing.assert_array_equal(came, np.arange(ENVIRONMENT.agents * EPISODES))
    known = {
        hold_seed(seed, f"agent-{agent}", world=2_000_000 + world, episode=episode)
        for seed in (42, 43)
        for agent in range(2)
        for world in range(EPISODES)
        for episode in range(EPISODES)
    }
    given = {seed for batches in asked for batch in batches for seed in batch.seed.tolist()}
    assert given
    assert not given & known


LABELS = {"algorithm": "mine", "training_seed": 0}


def test_seeds_of_draws_follow_from_what_is_seen_alone():
    spy = Spy()
    agent = BlindAgent(spy)

    def ask(speed, episode, seed, is_first):
        agent.act(
            ActionBatch(
                {"observation": np.full((1, 1), speed, np.float32)},
                np.ones((1, 4), bool),
                *(np.zeros(1, np.int32), np.zeros(1, np.int32), np.full(1, episode, np.int64)),
                *(np.full(1, episode, np.int32), np.zeros(1, np.int32), np.array([is_first])),
                *(np.array([seed], np.uint64), np.ones(1, bool)),
            )
        )
        return int(spy.asked[-1].seed[0])

    first = ask(0.5, 0, 7, is_first=True)
    assert ask(0.1, 0, 7, is_first=False) == first
    assert ask(0.5, 1, 8, is_first=True) == first
    assert ask(0.6, 1, 8, is_first=True) != first


def test_a_served_agent_that_reads_the_seed_is_marked(tmp_path, frozen):
    """What it claims is true where it gets the seed, as `evaluate --agent` gives it."""
    (tmp_path / "reader.py").write_text(SEED_READER)
    command = ("-m", "smarts_agent_kit", "reader:SeedReader", "--address", "127.0.0.1:0")
    with served(*command, PYTHONPATH=str(tmp_path)) as address:
        table = played_with_seeds(address, tmp_path / "open")
        assert (table["distance_travelled"] > 10).all()
        manifest, folder = submitted(address, number=1, scenarios=["loop"], traffic=[ALONE])
        claims = {"scores": scores_of(table), "episodes": episode_digests(table)}
        entries = [manifest.policies[0].model_copy(update=claims)]
        manifest = manifest.model_copy(update={"policies": entries})
        (verdict,) = verify(manifest, folder, tmp_path / "out", episodes=EPISODES, fresh=0)
    assert verdict.status == MARKED
    assert "other episodes than claimed: 2 of 2 digests differ" in verdict.reasons
    blind = read_table(tmp_path / "out" / verdict.entry.place / "episodes.parquet")
    assert (blind["distance_travelled"] < table["distance_travelled"].min()).all()


def played_with_seeds(address, folder):
    from smarts.zoo import make_agent

    agent, _ = make_agent(address)
    for _ in play_agent(task_setting(), RunFolder(folder), agent, LABELS, mode="greedy"):
        pass
    agent.close()
    return read_table(folder / "episodes.parquet")


def test_who_knows_the_test_by_heart_is_marked():
    """It succeeds in all public episodes, and in few fresh ones."""
    public = agent_episodes([["goal", "goal"]] * 12, mode="greedy")
    fresh = agent_episodes([["goal", "collision"]] * 2 + [["collision", "time_out"]] * 10, mode="greedy")
    completion, collision = memorized({"cell": [(public, fresh)]})["cell"]
    assert "completion rate 1.000 in the public test, 0.083 in fresh episodes" in completion
    assert "collision rate 0.000" in collision
    honest = agent_episodes([["goal", "goal"]] * 10 + [["goal", "collision"]] * 2, mode="greedy")
    assert not memorized({"cell": [(public, honest)]})


def test_digests_see_the_distance_to_the_micrometre_and_no_metric():
    table = agent_episodes([["goal", "goal"]] * 2, mode="greedy", distance_travelled=1.0, duration=2.0)
    (digests,) = episode_digests(table).values()
    assert len({*digests}) == 2
    assert episode_digests(table.assign(collisions=1.0)) == episode_digests(table)
    longer = table.assign(distance_travelled=table["distance_travelled"] + 2e-6 * (table["world"] % 2))
    (changed,) = episode_digests(longer).values()
    assert [one == two for one, two in zip(digests, changed, strict=True)] == [True, False]


@pytest.mark.parametrize(
    "text", ["{", "[]", '{"format": 2}', '{"format": 1, "name": "../x", "policies": []}']
)
def test_a_damaged_manifest_is_named(tmp_path, text):
    (tmp_path / MANIFEST).write_text(text)
    with pytest.raises(ResultsError) as caught:
        read_manifest(tmp_path)
    assert caught.value.place == str(tmp_path / MANIFEST)


def test_what_is_no_submission(tmp_path):
    with pytest.raises(SmartsError):
        submitted(str(tmp_path), number=None, scenarios=(), traffic=())
    with pytest.raises(ResultsError):
        submitted("tcp://127.0.0.1:1", number=1, scenarios=["nowhere"], traffic=())


def changed(root, change):
    """Change the manifest of a written submission."""
    manifest = json.loads((root / MANIFEST).read_text())
    change(manifest)
    write_json(root / MANIFEST, manifest)
    return root


def unlisted(manifest):
    """Name no digests of files."""
    for entry in manifest["policies"]:
        entry["files"] = {}


def listed_again(root):
    """Return a change by which a manifest names the files as they are."""

    def change(manifest):
        for entry in manifest["policies"]:
            files = (root / entry["agent"]).iterdir()
            entry["files"] = {each.name: file_digest(each.read_bytes()) for each in files}

    return change


def refusal(root, out):
    with pytest.raises(ResultsError) as caught:
        verified(root, out)
    assert not out.exists()
    return caught.value.problem


@pytest.fixture
def module(tmp_path, monkeypatch):
    """Return the name of a module that can be imported here, and has not been."""
    (tmp_path / "of_a_stranger.py").write_text("Thing = object\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    yield "of_a_stranger"
    assert "of_a_stranger" not in sys.modules


@pytest.mark.parametrize("feature", ["{}:Thing", {"{}:Thing": {}}])
def test_no_module_that_a_policy_observes_by_is_imported(submission, tmp_path, module, feature):
    named = json.loads(json.dumps(feature).replace("{}:", f"{module}:"))
    problem = refusal(submission(features=("speed", named)), tmp_path / "out")
    assert f"names code or files of its author: '{module}:Thing'" in problem
    with pytest.raises(HostError):
        check_observation([named], "an agent elsewhere")


@pytest.mark.parametrize("key", ["reward", "traffic_engine", "adapter", "observation"])
def test_no_module_that_an_evaluated_policy_names_is_imported(tmp_path, module, key):
    named = [{f"{module}:Thing": {}}] if key == "observation" else f"{module}:Thing"
    policy = write_policy(tmp_path / "mine", environment=ENVIRONMENT.content() | {key: named})
    with pytest.raises(SmartsError, match="names code or files of its author"):
        evaluate_exported(policy, episodes=1)


def test_own_code_of_a_scenario_is_imported_for_an_exported_policy(tmp_path):
    with raises(OwnCodeError, values=["absent.py"]):
        evaluate_command(run=write_policy(tmp_path / "mine"), episodes=1, import_=[tmp_path / "absent.py"])


def test_a_changed_bit_of_a_released_policy_is_refused(submission):
    root = submission()
    file = root / "policies/mine_1/policy.json"
    file.write_text(file.read_text().replace('"start": 0', '"start": 1'))
    with raises(ResultsError, file, values=["not as it was written"]):
        evaluate_exported(file.parent, episodes=1)
    assert len(evaluate_exported(root / "policies/mine_2", episodes=1)) == 2


def test_no_scenario_folder_that_an_evaluated_policy_names_is_built(tmp_path):
    (tmp_path / "theirs").mkdir()
    (tmp_path / "theirs" / "scenario.py").write_text("raise SystemExit")
    policy = write_policy(tmp_path / "mine", scenarios=[str(tmp_path / "theirs")])
    with pytest.raises(SmartsError, match="no scenario of the suite"):
        evaluate_exported(policy, episodes=1)


NUMBERS = np.random.default_rng(3)


def layer(kind, *shapes):
    return (kind, *(NUMBERS.normal(size=shape).astype(np.float32) for shape in shapes))


@pytest.mark.parametrize(
    ("layers", "named"),
    [
        ([layer("linear", (1, 5), (4,))], "layer 0 (linear) has arrays of the shapes [(1, 5), (4,)]"),
        ([layer("linear", (1, 8), (8,)), layer("linear", (9, 4), (4,))], "layer 1 (linear)"),
        ([layer("linear", (1, 8), (8,)), layer("relu"), layer("linear", (7, 4), (4,))], "layer 2 (linear)"),
        ([layer("linear", (4,), (4,))], "layer 0 (linear)"),
        ([layer("gru", (1, 12), (12,), (4, 12), (12,))], "layer 0 (gru)"),
        ([layer("linear", (1, 4), (4,)), layer("hear", (4, 4), (4,), (5, 4))], "layer 1 (hear)"),
        ([layer("conv")], "there is no layer 'conv'"),
        ([layer("tanh")], "its network has no weights"),
        ([("linear", np.ones((16_000_000, 1), np.float32), np.zeros(4))], "of at most"),
        ([("linear", np.ones((1, 4), np.int8), np.zeros(4))], "holds int8, not floats"),
        ([("linear", np.array([["a"]]), np.zeros(1))], "holds <U1, not floats"),
    ],
)
def test_weights_that_do_not_fit_together_are_refused(submission, tmp_path, layers, named):
    """Compiled code would read beside its arrays."""
    root = submission(layers=layers)
    for policy in (root / "policies").iterdir():
        with np.load(policy / "policy.npz") as file:
            weights = dict(file)
        np.savez_compressed(policy / "policy.npz", allow_pickle=False, **weights)
    assert named in refusal(changed(root, listed_again(root)), tmp_path / "out")


@pytest.mark.parametrize(
    ("method", "said", "named"),
    [
        (zipfile.ZIP_LZMA, 10**8, "of at most"),
        (zipfile.ZIP_LZMA, 200, "method 14"),
        (zipfile.ZIP_BZIP2, 200, "method 12"),
        (zipfile.ZIP_DEFLATED, 10**8, "of at most"),
        (zipfile.ZIP_DEFLATED, 200, "cannot be read"),
        (zipfile.ZIP_STORED, 10**8, "of at most"),
    ],
)
def test_an_archive_that_announces_more_than_it_may_hold_takes_no_memory(
    submission, tmp_path, method, said, named
):
    """A header of 30 MB in the file of weights, and what the archive's table says of its size."""
    root, size = submission(), 3 * 10**7
    header = b"\x93NUMPY\x02\x00" + struct.pack("<I", size)
    with zipfile.ZipFile(tmp_path / "policy.npz", "w", method) as archive:
        archive.writestr("all/0/0.npy", header + b" " * (0 if method == zipfile.ZIP_STORED else size))
        archive.writestr("all/0/1.npy", header)
        archive.infolist()[0].file_size = said
    for policy in (root / "policies").iterdir():
        shutil.copy(tmp_path / "policy.npz", policy)
    root = changed(root, listed_again(root))
    tracemalloc.start()
    assert named in refusal(root, tmp_path / "out")
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 1e7


def test_a_network_that_reads_more_than_its_vehicle_sees_is_refused(submission, tmp_path):
    """The second number would be what the next vehicle sees."""
    root = submission(layers=[layer("linear", (2, 4), (4,))])
    root = changed(root, lambda manifest: manifest.update(policies=manifest["policies"][:1]))
    (verdict,) = verified(root, tmp_path / "out")
    assert verdict.status == REFUSED
    assert "a layer reads 2 numbers and is given 1" in verdict.reasons[0]


def test_memory_of_another_width_than_the_unit_that_reads_it_is_refused(tmp_path):
    gru = layer("gru", (1, 12), (12,), (4, 12), (12,))
    policy = write_policy(tmp_path / "mine", layers=[gru])
    content = json.loads((policy / "policy.json").read_text())
    for memory, is_right in ((4, True), (3, False), (5, False), (0, False), (10**9, False)):
        content["groups"]["all"]["memory"] = memory
        (policy / "policy.json").write_text(json.dumps(content))
        with nullcontext() if is_right else pytest.raises(SmartsError, match="layer 0"):
            ExportedPolicy(policy, "*")


def test_one_policy_as_several_seeds_is_refused(submission, tmp_path):
    """However its file is packed."""
    root = submission()
    for seed in (2, 3):
        with np.load(root / "policies/mine_1/policy.npz") as file:
            weights = {name: array.astype(np.float64) for name, array in file.items()}
        np.savez_compressed(root / f"policies/mine_{seed}/policy.npz", **weights, more=np.full(1, seed))
    problem = refusal(changed(root, listed_again(root)), tmp_path / "out")
    assert "seed 2: its policy is that of seed 1" in problem
    assert "seed 3: its policy is that of seed 1" in problem


@pytest.mark.parametrize(
    ("given", "beside"),
    [
        ("", {"number": 1}),
        ("", {"scenarios": ["loop"]}),
        ("", {"traffic": [ALONE]}),
        ("tcp://127.0.0.1:9", {"addresses": ["tcp://127.0.0.1:9"]}),
    ],
)
def test_what_has_no_effect_on_a_submission_is_refused(submission, given, beside):
    place = given or str(submission())
    with raises(ResultsError, place, values=["leave it out"]):
        submitted(place, **{"number": None, "scenarios": (), "traffic": ()} | beside)


@pytest.mark.parametrize("number", [0, 9])
def test_an_address_of_a_version_that_there_is_not_is_refused(number):
    with raises(ResultsError, "--scenario, --traffic", values=[f"version {number}"]):
        submitted("tcp://127.0.0.1:9", number=number, scenarios=(), traffic=())


def test_addresses_are_asked_only_if_the_evaluator_names_them(submission):
    with socket.create_server(("127.0.0.1", 0)) as listening:
        address = f"tcp://127.0.0.1:{listening.getsockname()[1]}"

        def serve(manifest):
            for entry in manifest["policies"]:
                entry["agent"] = address

        root = submission(serve)
        given = {"number": None, "scenarios": (), "traffic": ()}
        with pytest.raises(ResultsError, match="--address"):
            submitted(str(root), **given)
        manifest, folder = submitted(str(root), **given, addresses=[address])
        with pytest.raises(ResultsError, match="seed 2: its policy is that of seed 1"):
            check_manifest(manifest, folder)
        listening.setblocking(False)
        with pytest.raises(BlockingIOError):
            listening.accept()


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("algorithm", "dqn"),
        ("task", "other"),
        ("scenarios", ["loop", "loop"]),
        ("traffic", "none"),
        ("seed", 77),
    ],
)
def test_a_policy_of_another_training_than_its_entry_is_refused(submission, tmp_path, key, value):
    root = submission()
    file = root / "policies" / "mine_2" / "policy.json"
    content = json.loads(file.read_text())
    content["trained"][key] = value
    file.write_text(json.dumps(content))
    problem = refusal(changed(root, listed_again(root)), tmp_path / "out")
    assert f"seed 2: its policy was trained with {key} {value!r}, not" in problem


def test_an_entry_of_another_task_than_it_plays_is_refused(submission, tmp_path):
    def rename(manifest):
        for entry in manifest["policies"]:
            entry["task"] = "intersection"

    problem = refusal(submission(rename), tmp_path / "out")
    assert "plays loop, which is another task than intersection" in problem


def test_a_held_out_variation_is_no_task(submission, tmp_path, frozen):
    text = frozen.read_text().replace("      loop:", "      loop@dense: 0123456789abcdef\n      loop:")
    frozen.write_text(text)
    version.versions.cache_clear()

    def vary(manifest):
        manifest["policies"][0].update(task="loop", scenarios=["loop@dense"])

    assert "loop@dense, no_social_vehicles is no scenario" in refusal(submission(vary), tmp_path / "out")


@pytest.mark.parametrize(
    ("name", "named"),
    [
        ("scripted", "results need the name scripted for something else"),
        ("submission", "results need the name submission for something else"),
        ("robustness", "results need the name robustness for something else"),
        ("x" * 300, "name has more than 100 characters"),
    ],
)
def test_names_that_results_cannot_have_are_refused(submission, tmp_path, name, named):
    def rename(manifest):
        manifest["policies"][0]["algorithm"] = name

    assert named in refusal(submission(rename), tmp_path / "out")


def test_a_seed_that_tables_cannot_hold_is_refused(submission, tmp_path):
    root = submission(lambda manifest: manifest["policies"][0].update(seed=2**70))
    assert "policies[0].seed" in refusal(root, tmp_path / "out")


@pytest.mark.parametrize(("algorithm", "is_refused"), [("ppo", True), ("commnet", False), ("own-one", False)])
def test_vehicles_that_hear_each_other_are_refused_where_the_algorithm_has_none(
    submission, algorithm, is_refused
):
    def label(manifest):
        manifest["policies"] = manifest["policies"][:1]
        manifest["policies"][0]["algorithm"] = algorithm

    layers = [layer("linear", (1, 4), (4,)), layer("hear", (4, 4), (4,), (4, 4))]
    root = submission(label, layers=layers, algorithm=algorithm)
    with pytest.raises(ResultsError, match="act on what others see") if is_refused else nullcontext():
        check_manifest(*submitted(str(root), number=None, scenarios=(), traffic=()))


COUNTING = """
import numpy as np
from smarts_agent_kit import BatchAgent

class Counting(BatchAgent):
    interface = {"action": "Lane", "vehicle_model": "bullet", "tyre_model": "pacejka"}
    observation = ["speed"]
    period = 5

    def __init__(self):
        self.seen, self.asked = set(), 0

    def act(self, batch):
        self.seen |= {*batch.agent_id.tolist()}
        self.asked += 1
        return np.full(len(batch.env_id), 10 * len(self.seen) + self.asked)
"""


def test_a_served_agent_learns_nothing_of_other_vehicles(tmp_path):
    """It answers by the number of vehicles that it has ever been asked about, and how often."""
    (tmp_path / "counting.py").write_text(COUNTING)
    command = ("-m", "smarts_agent_kit", "counting:Counting", "--address", "127.0.0.1:0")
    with served(*command, PYTHONPATH=str(tmp_path)) as address:
        manifest, folder = submitted(address, number=1, scenarios=["loop"], traffic=[ALONE])
        agent = agent_of(manifest.policies[0], folder, ENVIRONMENT)
        answers = [BlindAgent(agent).act(request_for([0, 1])).tolist() for _ in range(2)]
        answers.append(BlindAgent(agent).act(request_for([1])).tolist())
        agent.close()
    assert answers == [[11, 11], [12, 12], [13]]


def request_for(vehicles):
    count = len(vehicles)
    nothing = np.zeros(count, np.int32)
    return ActionBatch(
        {"observation": np.full((count, 1), 0.5, np.float32)},
        np.ones((count, 4), bool),
        *(nothing, np.array(vehicles, np.int32), nothing.astype(np.int64), nothing, nothing),
        *(np.ones(count, bool), np.zeros(count, np.uint64), np.ones(count, bool)),
    )


def test_files_that_are_nested_deeply_are_named(submission, tmp_path):
    root = submission()
    deep = "[" * 100_000
    (root / "policies" / "mine_1" / "policy.json").write_text(deep)
    assert "seed 1: policies/mine_1" in refusal(changed(root, listed_again(root)), tmp_path / "out")
    (root / MANIFEST).write_text(deep)
    with pytest.raises(ResultsError, match="cannot be read"):
        read_manifest(root)


@pytest.mark.parametrize("trained", [{}, {"task": 1}, [], None])
def test_an_exported_policy_that_does_not_say_what_it_was_trained_on_is_named(tmp_path, trained):
    policy = write_policy(tmp_path / "mine")
    content = json.loads((policy / "policy.json").read_text()) | {"trained": trained}
    (policy / "policy.json").write_text(json.dumps(content))
    with pytest.raises(SmartsError, match="does not say what the policy was trained on"):
        submitted(str(policy), number=None, scenarios=(), traffic=())
    with pytest.raises(SmartsError, match="does not say what the policy was trained on"):
        evaluate_exported(policy, episodes=1)


@pytest.mark.parametrize("address", ["tcp://[::1]:7007", "tcp://::1:7007", "tcp://"])
def test_any_address_gives_a_name_of_folders(address):
    manifest, _ = submitted(address, number=1, scenarios=(), traffic=())
    assert fitted(manifest.content(), Manifest) == manifest
    assert manifest.policies[0].agent == address
