"""Submissions before they are played: what is not as it has to be is refused by name, and runs nothing."""

import json
import re
import socket
import struct
import sys
import tracemalloc
import zipfile
from contextlib import nullcontext

import numpy as np
import pytest

from benchmark.experiment import version
from benchmark.metrics import read_table
from benchmark.results.files import ResultsError
from benchmark.results.release import MANIFEST, MARKED, episode_digests, read_manifest, scores_of
from benchmark.results.run_folder import RunFolder
from benchmark.running.blind import BlindAgent
from benchmark.running.evaluating import Asked, evaluate_exported, play_agent
from benchmark.running.played import scenario_digests
from benchmark.running.releasing import write_release
from benchmark.running.submissions import agent_of, check_manifest, submitted
from benchmark.running.verifying import verify
from smarts.agents.hosting.facts import check_observation
from smarts.agents.hosting.options import HostError
from smarts.agents.policy import ActionBatch, BatchAgent
from smarts.errors import SmartsError
from smarts.types.streams import hold_seed
from smarts.zoo import make_agent
from tests.hand_made_results import ALONE, agent_episodes, write_experiment, write_run
from tests.hand_made_submissions import (
    ENVIRONMENT,
    changed,
    freeze,
    task_setting,
    verified,
    write_policy,
    write_submission,
)
from tests.raising import raises
from tests.served_agents import served

frozen = pytest.fixture(autouse=True)(freeze)

CLAIMS = {"scores": {"completion_rate": 0.0}, "episodes": {"loop": ["0" * 12]}}
LABELS = {"algorithm": "mine", "training_seed": 0}


def refusal(root, out):
    with pytest.raises(SmartsError) as caught:
        verified(root, out)
    assert not out.exists()
    return str(caught.value)


def first(**changes):
    """Return a change of a manifest's first entry."""
    return lambda manifest: manifest["policies"][0].update(changes)


@pytest.mark.parametrize(
    ("change", "named"),
    [
        (lambda x: x["scenarios"][ALONE].update(loop="0123"), f"its scenario loop, {ALONE} is not that of"),
        (lambda x: x["environment"].update(agents=1), "its environment.agents is not that of version 1"),
        (first(seed=2), f"mine, loop, {ALONE}, seed 2 is there twice"),
        (first(agent="../../elsewhere"), "is outside of the submission"),
        (first(scenarios=["intersection"]), "plays intersection, which is another task than loop"),
        (first(task="two_way", scenarios=["two_way"]), f"two_way, {ALONE} is no scenario of the version"),
        (first(algorithm="submission"), "results need the name submission for something else"),
        (first(algorithm="../x"), "policies[0].algorithm"),
        (first(files={}), "policy.json is not the file that its manifest describes"),
    ],
)
def test_a_manifest_of_something_else_is_refused_by_name(tmp_path, change, named):
    root = changed(write_submission(tmp_path / "theirs", (1, 2), claims=CLAIMS), change)
    assert named in refusal(root, tmp_path / "out")


def test_a_policy_of_another_version_or_with_other_weights_is_refused(tmp_path):
    root = write_submission(tmp_path / "none", number=None, claims=CLAIMS)
    assert "its policy was trained with benchmark_version None, not 1" in refusal(root, tmp_path / "out")
    root = write_submission(tmp_path / "changed", claims=CLAIMS)
    with (root / "1/mine/policy.npz").open("ab") as file:
        file.write(b"x")
    assert "policy.npz is not the file that its manifest describes" in refusal(root, tmp_path / "out")


@pytest.mark.parametrize(
    ("key", "value"), [("algorithm", "dqn"), ("scenarios", ["loop", "loop"]), ("seed", 77)]
)
def test_a_policy_of_another_training_than_its_entry_is_refused(tmp_path, key, value):
    root = write_submission(tmp_path / "theirs")
    file = root / "1/mine/policy.json"
    content = json.loads(file.read_text())
    content["trained"][key] = value
    file.write_text(json.dumps(content))
    problem = refusal(root, tmp_path / "out")
    assert f"seed 1: its policy was trained with {key} {value!r}, not" in problem


def test_a_changed_scenario_of_the_evaluator_is_refused_too(tmp_path, frozen):
    root = changed(write_submission(tmp_path / "theirs"), lambda manifest: manifest.update(scenarios={}))
    frozen.write_text(frozen.read_text().replace(scenario_digests(task_setting())["loop"], "0123"))
    version.versions.cache_clear()
    with raises(ResultsError, root / MANIFEST, values=["this program is not as version 1", f"loop, {ALONE}"]):
        verified(root, tmp_path / "out")


def test_one_policy_as_several_seeds_is_refused(tmp_path):
    """However its file is packed."""
    root = write_submission(tmp_path / "theirs", (1, 2))
    with np.load(root / "1/mine/policy.npz") as file:
        weights = {name: array.astype(np.float64) for name, array in file.items()}
    np.savez_compressed(root / "2/mine/policy.npz", **weights, more=np.full(1, 2))
    assert "seed 2: its policy is that of seed 1" in refusal(root, tmp_path / "out")


NUMBERS = np.random.default_rng(3)


def layer(kind, *shapes):
    return (kind, *(NUMBERS.normal(size=shape).astype(np.float32) for shape in shapes))


@pytest.mark.parametrize(
    ("layers", "named"),
    [
        ([layer("linear", (1, 5), (4,))], "shapes (1, 5) and (4,) is given 1 numbers"),
        ([layer("linear", (2, 4), (4,))], "shapes (2, 4) and (4,) is given 1 numbers"),
        ([layer("gru", (1, 12), (12,), (4, 12), (12,))], "is given 1 numbers"),
    ],
)
def test_weights_that_do_not_fit_together_are_refused(tmp_path, layers, named):
    """Compiled code would read beside its arrays: what the next vehicle sees."""
    (verdict,) = verified(write_submission(tmp_path / "theirs", layers=layers), tmp_path / "out")
    assert named in verdict.reasons[0]


@pytest.mark.parametrize(
    ("layers", "named"),
    [
        ([layer("conv")], "there is no layer 'conv'"),
        ([("linear", np.ones((16_000_000, 1), np.float32), np.zeros(4))], "of at most"),
        ([("linear", np.array([["a"]]), np.zeros(1))], "holds <U1, not floats"),
    ],
)
def test_weights_that_are_none_are_refused(tmp_path, layers, named):
    root = write_submission(tmp_path / "theirs", layers=layers)
    file = root / "1/mine/policy.npz"
    with np.load(file) as opened:
        weights = dict(opened)
    np.savez_compressed(file, allow_pickle=False, **weights)
    assert named in refusal(root, tmp_path / "out")


@pytest.mark.parametrize(
    ("method", "said", "named"),
    [
        (zipfile.ZIP_LZMA, 200, "method 14"),
        (zipfile.ZIP_DEFLATED, 10**8, "of at most"),
        (zipfile.ZIP_DEFLATED, 200, "cannot be read"),
    ],
)
def test_an_archive_that_announces_more_than_it_may_hold_takes_no_memory(tmp_path, method, said, named):
    """A header of 30 MB in the file of weights, and what the archive's table says of its size."""
    root, size = write_submission(tmp_path / "theirs"), 3 * 10**7
    header = b"\x93NUMPY\x02\x00" + struct.pack("<I", size)
    with zipfile.ZipFile(root / "1/mine/policy.npz", "w", method) as archive:
        archive.writestr("all/0/0.npy", header + b" " * size)
        archive.writestr("all/0/1.npy", header)
        archive.infolist()[0].file_size = said
    tracemalloc.start()
    assert named in refusal(root, tmp_path / "out")
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 1e7


@pytest.mark.parametrize(("algorithm", "is_refused"), [("ppo", True), ("commnet", False), ("own-one", False)])
def test_vehicles_that_hear_each_other_are_refused_where_the_algorithm_has_none(
    tmp_path, algorithm, is_refused
):
    layers = [layer("linear", (1, 4), (4,)), layer("hear", (4, 4), (4,), (4, 4))]
    root = write_submission(tmp_path / "theirs", layers=layers, algorithm=algorithm)
    with pytest.raises(ResultsError, match="act on what others see") if is_refused else nullcontext():
        check_manifest(*submitted(str(root)))


class TestNoCodeOfASubmissionRunsHere:
    @pytest.fixture
    def module(self, tmp_path, monkeypatch):
        """Return the name of a module that can be imported here, and has not been."""
        (tmp_path / "of_a_stranger.py").write_text("Thing = object\n")
        monkeypatch.syspath_prepend(str(tmp_path))
        yield "of_a_stranger"
        assert "of_a_stranger" not in sys.modules

    def test_of_a_module_that_a_policy_observes_by(self, tmp_path, module):
        named = {f"{module}:Thing": {}}
        problem = refusal(write_submission(tmp_path / "theirs", features=("speed", named)), tmp_path / "out")
        assert f"names code or files of its author: '{module}:Thing'" in problem
        with pytest.raises(HostError):
            check_observation([named], "an agent elsewhere")

    @pytest.mark.parametrize("key", ["traffic_engine", "observation"])
    def test_of_a_module_that_an_evaluated_policy_names(self, tmp_path, module, key):
        named = [{f"{module}:Thing": {}}] if key == "observation" else f"{module}:Thing"
        policy = write_policy(tmp_path / "mine", environment=ENVIRONMENT.content() | {key: named})
        with pytest.raises(SmartsError, match="names code or files of its author"):
            evaluate_exported(policy, Asked(episodes=1))

    def test_of_a_scenario_folder(self, tmp_path):
        (tmp_path / "theirs").mkdir()
        (tmp_path / "theirs" / "scenario.py").write_text("raise SystemExit")
        policy = write_policy(tmp_path / "mine", scenarios=[str(tmp_path / "theirs")])
        with pytest.raises(SmartsError, match="no scenario of the suite"):
            evaluate_exported(policy, Asked(episodes=1))


def test_a_changed_bit_of_a_released_policy_is_refused(tmp_path):
    root = write_submission(tmp_path / "theirs", (1, 2), claims=CLAIMS)
    file = root / "1/mine/policy.json"
    file.write_text(file.read_text().replace('"start": 0', '"start": 1'))
    with raises(ResultsError, file, values=["not as it was written"]):
        evaluate_exported(file.parent, Asked(episodes=1))
    assert len(evaluate_exported(root / "2/mine", Asked(episodes=1))) == 2


@pytest.mark.parametrize(
    "text", ["{", '{"format": 2}', '{"format": 1, "name": "../x", "policies": []}', "[" * 99999]
)
def test_a_damaged_manifest_is_named(tmp_path, text):
    (tmp_path / MANIFEST).write_text(text)
    with pytest.raises(SmartsError, match=MANIFEST):
        read_manifest(tmp_path)


def test_digests_see_the_distance_to_the_micrometre_and_no_metric():
    table = agent_episodes([["goal", "goal"]] * 2, mode="greedy", distance_travelled=1.0, duration=2.0)
    (digests,) = episode_digests(table).values()
    assert len({*digests}) == 2
    assert episode_digests(table.assign(collisions=1.0)) == episode_digests(table)
    longer = table.assign(distance_travelled=table["distance_travelled"] + 2e-6 * (table["world"] % 2))
    (other,) = episode_digests(longer).values()
    assert [one == two for one, two in zip(digests, other, strict=True)] == [True, False]


def test_what_is_no_submission_is_named(tmp_path):
    with raises(ResultsError, tmp_path):
        submitted(str(tmp_path))
    for wrong in ({"number": 9}, {"number": 1, "scenarios": ["nowhere"]}):
        with raises(ResultsError, "--scenario, --traffic"):
            submitted("tcp://127.0.0.1:1", **wrong)


class TestAddresses:
    def test_they_are_asked_only_if_the_evaluator_names_them(self, tmp_path):
        with socket.create_server(("127.0.0.1", 0)) as listening:
            address = f"tcp://127.0.0.1:{listening.getsockname()[1]}"
            root = write_submission(tmp_path / "theirs", (1, 2))
            changed(root, lambda manifest: [each.update(agent=address) for each in manifest["policies"]])
            with pytest.raises(ResultsError, match="--address"):
                submitted(str(root))
            manifest, folder = submitted(str(root), addresses=[address])
            with pytest.raises(ResultsError, match="seed 2: its policy is that of seed 1"):
                check_manifest(manifest, folder)
            listening.setblocking(False)
            with pytest.raises(BlockingIOError):
                listening.accept()

    def test_where_nothing_listens_there_is_no_verdict(self, tmp_path):
        with socket.create_server(("127.0.0.1", 0)) as listening:
            address = f"tcp://127.0.0.1:{listening.getsockname()[1]}"
        with pytest.raises(HostError, match=re.escape(address)):
            verified(address, tmp_path / "out")
        assert not [*tmp_path.rglob("run.json")]


class Spy(BatchAgent):
    """Keeps what it is asked."""

    observation = ("speed",)
    period = 5

    def __init__(self):
        self.asked = []

    def act(self, obs):
        self.asked.append(obs)
        return np.zeros(len(obs.env_id), int)


def play(agent, folder, seed=42):
    for _ in play_agent(task_setting(), RunFolder(folder), agent, LABELS, mode="greedy", seed=seed):
        pass
    return read_table(folder / "episodes.parquet")


def test_an_agent_gets_no_seed_and_no_number_of_the_episode(tmp_path):
    """Two runs of other seeds and worlds differ in nothing but what is seen."""
    spies = {seed: Spy() for seed in (42, 43)}
    for seed, spy in spies.items():
        play(BlindAgent(spy), tmp_path / str(seed), seed)
        assert not any(batch.env_id.any() or batch.episode.any() for batch in spy.asked)
        came = np.concatenate([batch.hold[batch.is_first] for batch in spy.asked])
        np.testing.assert_array_equal(came, np.arange(4))  # two agents in each of two episodes
    known = {
        hold_seed(seed, f"agent-{agent}", world=2_000_000 + world, episode=episode)
        for seed in spies
        for agent in range(2)
        for world in range(5)
        for episode in range(2)
    }
    given = {seed for spy in spies.values() for batch in spy.asked for seed in batch.seed.tolist()}
    assert given
    assert not given & known


def request_for(vehicles, speed=0.5, *, episode=0, seed=0, is_first=True):
    count = len(vehicles)
    nothing = np.zeros(count, np.int32)
    return ActionBatch(
        {"observation": np.full((count, 1), speed, np.float32)},
        np.ones((count, 4), bool),
        *(nothing, np.array(vehicles, np.int32), np.full(count, episode, np.int64)),
        *(np.full(count, episode, np.int32), nothing, np.full(count, is_first)),
        *(np.full(count, seed, np.uint64), np.ones(count, bool)),
    )


def test_seeds_of_draws_follow_from_what_is_seen_alone():
    spy = Spy()
    agent = BlindAgent(spy)

    def ask(speed, **given):
        agent.act(request_for([0], speed, **given))
        return int(spy.asked[-1].seed[0])

    drawn = ask(0.5, seed=7)
    assert ask(0.1, seed=7, is_first=False) == drawn
    assert ask(0.5, episode=1, seed=8) == drawn
    assert ask(0.6, episode=1, seed=8) != drawn


AGENTS = '''
import hashlib
import numpy as np
from smarts_agent_kit import BatchAgent

KNOWN = {
    hashlib.blake2b(f"smarts-bench|42|{2_000_000 + world}|0|hold|agent-{k}".encode(), digest_size=8).digest()
    for world in range(50) for k in range(2)
}

class Drives(BatchAgent):
    interface = {"action": "Lane", "vehicle_model": "bullet", "tyre_model": "pacejka"}
    observation = ["speed"]
    period = 5

class SeedReader(Drives):
    """Drives where it knows the test's seed, and else stops."""

    def act(self, batch):
        known = [int(seed).to_bytes(8, "little") in KNOWN for seed in batch.seed]
        return np.where(known, 0, 1)

class Counting(Drives):
    """Answers by the number of vehicles that it has ever been asked about, and how often."""

    def __init__(self):
        self.seen, self.asked = set(), 0

    def act(self, batch):
        self.seen |= {*batch.agent_id.tolist()}
        self.asked += 1
        return np.full(len(batch.env_id), 10 * len(self.seen) + self.asked)
'''


def agent_at(tmp_path, name):
    (tmp_path / "theirs.py").write_text(AGENTS)
    command = ("-m", "smarts_agent_kit", f"theirs:{name}", "--address", "127.0.0.1:0")
    return served(*command, PYTHONPATH=str(tmp_path))


def test_a_served_agent_that_reads_the_seed_is_marked(tmp_path):
    """What it claims is true where it gets the seed, as `evaluate --agent` gives it."""
    with agent_at(tmp_path, "SeedReader") as address:
        agent, _ = make_agent(address)
        table = play(agent, tmp_path / "open")
        agent.close()
        manifest, folder = submitted(address, number=1, scenarios=["loop"], traffic=[ALONE])
        claims = {"scores": scores_of(table), "episodes": episode_digests(table)}
        entries = [manifest.policies[0].model_copy(update=claims)]
        manifest = manifest.model_copy(update={"policies": entries})
        episodes = len(claims["episodes"]["loop"])
        (verdict,) = verify(manifest, folder, tmp_path / "out", episodes=episodes, fresh=0)
    assert verdict.status == MARKED
    assert f"other episodes than claimed: {episodes} of {episodes} digests differ" in verdict.reasons
    blind = read_table(tmp_path / "out" / entries[0].place / "episodes.parquet")
    assert (blind["distance_travelled"] < table["distance_travelled"].min()).all()


def test_a_served_agent_learns_nothing_of_other_vehicles(tmp_path):
    with agent_at(tmp_path, "Counting") as address:
        manifest, folder = submitted(address, number=1, scenarios=["loop"], traffic=[ALONE])
        agent = agent_of(manifest.policies[0], folder, ENVIRONMENT)
        answers = [BlindAgent(agent).act(request_for(each)).tolist() for each in ([0, 1], [0, 1], [1])]
        agent.close()
    assert answers == [[11, 11], [12, 12], [13]]


class TestReleases:
    def write(self, root, seeds, without=()):
        """Write an experiment of three seeds, some of which have finished, and some no checkpoint."""
        write_experiment(root, seeds=[1, 2, 3])
        for seed in seeds:
            run = write_run(root, "ppo", [agent_episodes([["goal"]] * 3, mode="greedy")], seed=seed)
            if seed not in without:
                (run / "checkpoint").mkdir()
        return root

    def test_tests_that_verify_would_not_play_are_not_released(self, tmp_path):
        root = self.write(tmp_path / "one", [1, 2, 3])
        folder = RunFolder(root / "ppo/intersection" / ALONE / "seed_2")
        folder.note(tested={"test": [{"name": "far", "scenarios": ["city"], "traffic": None}]})
        with raises(ResultsError, root, values=["seed 2 is of conditions of its own"]):
            write_release(root, tmp_path / "release", is_partial=True)

    def test_missing_seeds_are_not_released(self, tmp_path):
        root = self.write(tmp_path / "one", [1])
        with raises(
            ResultsError, root, values=[f"incomplete: ppo, intersection, {ALONE}, seeds 2, 3: not begun"]
        ):
            write_release(root, tmp_path / "release")
        root = self.write(tmp_path / "other", [1], without=[1])
        with raises(ResultsError, root, values=["seed 1 has no last checkpoint here"]):
            write_release(root, tmp_path / "release", is_partial=True)
        assert not (tmp_path / "release").exists()
        with raises(ResultsError, root, values=["holds "]):
            write_release(root, root)
