"""Versions of the benchmark: what they freeze, and that their results are not mixed."""

import shutil
from pathlib import Path

import pytest
import yaml

from benchmark.experiment import version
from benchmark.experiment.config import read_experiment
from benchmark.experiment.environment import Environment
from benchmark.experiment.runs import runs_of, scripted_runs_of
from benchmark.experiment.version import (
    CODE,
    changed_scenarios,
    changed_settings,
    changed_task,
    code_digests,
)
from benchmark.report.comparing import compare_sides, read_side
from benchmark.report.content import make_report
from benchmark.report.leaderboard import make_leaderboard
from benchmark.results.files import ResultsError
from benchmark.results.reading import read_results
from benchmark.results.release import read_manifest
from benchmark.results.run_folder import FINISHED, RunFolder
from benchmark.results.versions import version_lines
from benchmark.running import experiment as running
from benchmark.running.experiment import check_version
from smarts.config import fitted
from smarts.errors import SmartsError
from tests.hand_made_results import ALONE, agent_episodes, script, write_experiment, write_run
from tests.raising import raises

ROOT = Path(__file__).parents[3]
frozen_text = script("freeze_version").frozen_text
CONFIG = """
algorithms: [ppo]
tasks: [loop]
traffic: [no_social_vehicles]
scripted: [parked]
environment: {agents: 2}
"""


def write(root, algorithm, number, seed=1, settings=None, **facts):
    """Write a finished run of a version of the benchmark."""
    table = agent_episodes([["goal", "goal"]] * 3, mode="greedy")
    folder = RunFolder(write_run(root, algorithm, [table], seed=seed, settings=settings))
    content = yaml.safe_load(folder.config.read_text())
    if number is not None:
        folder.config.write_text(yaml.safe_dump(content | {"benchmark_version": number}))
    folder.note(status=FINISHED, **facts)


@pytest.fixture
def tree(tmp_path):
    """A source tree with a file for each part."""
    for folders in CODE.values():
        for folder in folders:
            (tmp_path / folder).mkdir(parents=True)
            (tmp_path / folder / "part.py").write_text(
                '"""Doc."""\n\n\ndef f(x):\n    """Doc."""\n    return x\n'
            )
    (tmp_path / "smarts/rewards/rewards.yaml").write_text("goal: 1.0\n")
    return tmp_path


class TestDigests:
    @pytest.mark.parametrize(
        ("text", "is_same"),
        [
            ('"""Other."""\n\n\ndef f(x):\n    # A comment.\n    return (x)\n', True),
            ("def f(x):\n    return -x\n", False),
            ("def g(x):\n    return x\n", False),
        ],
    )
    def test_of_code_see_what_it_does(self, tree, text, is_same):
        before = code_digests(tree)
        (tree / "benchmark/metrics/part.py").write_text(text)
        code_digests.cache_clear()
        after = code_digests(tree)
        assert [part for part in CODE if before[part] != after[part]] == ([] if is_same else ["metrics"])

    def test_of_settings_see_their_values(self, tree):
        before = code_digests(tree)
        (tree / "smarts/rewards/rewards.yaml").write_text("# A comment.\ngoal:   1.0\n")
        code_digests.cache_clear()
        assert code_digests(tree) == before
        (tree / "smarts/rewards/rewards.yaml").write_text("goal: 2.0\n")
        code_digests.cache_clear()
        assert [part for part in CODE if code_digests(tree)[part] != before[part]] == ["reward"]


@pytest.fixture
def frozen(tmp_path, monkeypatch):
    """Version 1 is the present code, a scenario with digest "abc", and two agents."""
    file = tmp_path / "versions.yaml"
    monkeypatch.setattr(version, "FILE", file)
    file.write_text(frozen_text(1, {ALONE: {"intersection": "abc"}}, Environment(agents=2)))
    version.versions.cache_clear()
    yield file
    version.versions.cache_clear()


class TestRefusals:
    def experiment(self, tmp_path, more="benchmark_version: 1\n"):
        file = tmp_path / "mine.yaml"
        file.write_text(CONFIG + more)
        return read_experiment(file)

    def test_a_scenario_that_differs_is_named(self, tmp_path, frozen):
        assert changed_scenarios(1, {ALONE: {"intersection": "abc"}}) == []
        assert changed_scenarios(1, {ALONE: {"intersection": "abd"}}) == [f"intersection, {ALONE}"]
        with raises(SmartsError, "benchmark_version", values=["loop", ALONE, 1]):
            check_version(self.experiment(tmp_path))
        check_version(self.experiment(tmp_path, ""))

    @pytest.mark.parametrize("commit", ["0123456789ab", "0123456789ab+"])
    def test_a_tree_with_changes_is_refused(self, tmp_path, frozen, monkeypatch, commit):
        monkeypatch.setattr(running, "commit", lambda: commit)
        content = yaml.safe_load(frozen.read_text())
        content[1]["scenarios"][ALONE] |= running.scenarios_by_traffic(self.experiment(tmp_path))[ALONE]
        frozen.write_text(yaml.safe_dump(content))
        version.versions.cache_clear()
        if commit.endswith("+"):
            with raises(SmartsError, "benchmark_version", values=[1]):
                check_version(self.experiment(tmp_path))
        else:
            check_version(self.experiment(tmp_path))

    @pytest.mark.parametrize(
        ("changes", "named"),
        [
            ({}, []),
            ({"reward": None, "action": "Lane"}, []),  # what the defaults are
            ({"reward": "paper"}, ["reward"]),
            ({"observation": ["speed"], "decision_interval": 1}, ["decision_interval", "observation"]),
            ({"traffic_step": 0.5}, ["traffic_step"]),
        ],
    )
    def test_settings_of_the_environment_that_differ_are_named(self, frozen, changes, named):
        assert changed_settings(1, fitted({"agents": 2, **changes}, Environment)) == named

    def test_a_version_is_frozen_once(self, frozen):
        with raises(SmartsError, str(frozen), values=[1, "version 2", "--replace"]):
            frozen_text(1, {}, Environment())
        again = yaml.safe_load(frozen_text(1, {}, Environment(agents=5), replaces=True))
        assert (again[1]["environment"]["agents"], again[1]["scenarios"]) == (5, {})
        both = yaml.safe_load(frozen_text(2, {}, Environment()))
        assert both[1] == yaml.safe_load(frozen.read_text())[1]

    def test_it_freezes_the_lists_of_tasks_and_families_map_by_map(self, frozen):
        scenarios = {"roads@test-00": "a", "roads@test-01": "b", "roads@dense": "c"}
        lists = {"streets": {"train": ["roads@train-*"], "test": ["roads@test-*"]}}
        frozen.write_text(frozen_text(2, {ALONE: scenarios}, Environment(), tasks=lists))
        version.versions.cache_clear()
        assert len(version.versions()[2]["scenarios"][ALONE]) == 2
        assert changed_scenarios(2, {ALONE: scenarios}) == []
        other = {**scenarios, "roads@test-01": "d"}
        assert changed_scenarios(2, {ALONE: other}) == [f"roads@test-*, {ALONE}"]
        played = ["roads@train-00", "roads@test-00"]
        assert changed_task(2, "streets", played, lists["streets"]) == ""
        assert "restore its lists" in changed_task(2, "streets", played, {"train": ["roads@train-*"]})
        assert "not the one scenario" in changed_task(2, "others", played, lists["streets"])
        assert changed_task(2, "roads", ["roads"], {}) == ""

    def test_its_settings_are_those_of_its_file(self):
        experiment = read_experiment(ROOT / "configs/benchmark_v1.yaml")
        known = version.versions()[1]["training"]
        assert script("freeze_version").training_of(experiment) == {
            name: known[name] for name in known if name != "tuning"
        }
        for run in runs_of(experiment):
            place = run.algorithm, run.task_setting.task.name, run.task_setting.traffic
            assert version.has_settings_of(1, *place, run.settings)
            assert not version.has_settings_of(1, *place, {**run.settings, "lr": 0.9})
            assert not version.has_settings_of(None, *place, run.settings)

    def test_its_release_was_played_in_its_scenarios_by_its_code(self):
        release, frozen = read_manifest(ROOT / "results/release_v1"), version.versions()[1]
        assert changed_scenarios(1, release.scenarios) == []
        assert release.code == {part: frozen[part] for part in CODE}

    def test_a_run_is_not_continued_under_another_version(self, tmp_path, frozen):
        versioned, other = (self.experiment(tmp_path, more) for more in ("benchmark_version: 1\n", ""))
        for runs in (runs_of, scripted_runs_of):
            (here,), (there,) = ([*runs(each)][:1] for each in (versioned, other))
            assert here.content()["benchmark_version"] == 1
            assert "benchmark_version" not in there.content()
        folder = RunFolder(tmp_path / "run")
        folder.open(next(runs_of(other)).content())
        folder.note(status=FINISHED)
        with pytest.raises(ResultsError, match="benchmark_version"):
            folder.check(next(runs_of(versioned)).content())


class TestResults:
    def test_of_several_versions_are_not_mixed(self, tmp_path, frozen):
        write_experiment(tmp_path / "mixed", algorithms=["ppo", "dqn"])
        write(tmp_path / "mixed", "ppo", 1)
        write(tmp_path / "mixed", "dqn", None)
        with raises(ResultsError, str(tmp_path / "mixed"), values=["ppo, intersection", "dqn", "version 1"]):
            make_report(read_results(tmp_path / "mixed"))
        for name, number in (("one", 1), ("none", None)):
            write_experiment(tmp_path / name)
            write(tmp_path / name, "ppo", number)
        sides = [read_side(tmp_path / name) for name in ("one", "none")]
        with pytest.raises(ResultsError, match="version 1"):
            compare_sides(*sides, ["completion_rate"], "greedy")
        # The leaderboard ranks them apart.
        assert len(make_leaderboard([tmp_path / "one", tmp_path / "none"]).protocols) == 2

    def test_say_their_version_and_commit(self, tmp_path, frozen):
        write_experiment(tmp_path / "one", algorithms=["ppo", "dqn"])
        for name in ("ppo", "dqn"):
            write(tmp_path / "one", name, 1, commit="0123456789ab", scenarios={"intersection": "abc"})
        assert version_lines(read_results(tmp_path / "one").runs) == [
            "Benchmark version 1, commit 0123456789ab."
        ]
        shutil.rmtree(tmp_path / "one" / "dqn")
        write(tmp_path / "one", "dqn", 1, commit="0123456789ab+", scenarios={"intersection": "abd"})
        first, second = version_lines(read_results(tmp_path / "one").runs)
        assert "0123456789ab+: dqn, intersection" in first
        assert "intersection" in second
        assert "dqn" in second
        shutil.rmtree(tmp_path / "one" / "dqn")
        folder = RunFolder(tmp_path / "one" / "ppo" / "intersection" / ALONE / "seed_1")
        folder.config.write_text(
            folder.config.read_text().replace("decision_interval: 5", "decision_interval: 4")
        )
        content = yaml.safe_load(frozen.read_text())
        content[1]["metrics"] = "0000"
        frozen.write_text(yaml.safe_dump(content))
        version.versions.cache_clear()
        folder.note(commit="0123456789ab+")
        commit, settings, metrics = version_lines(read_results(tmp_path / "one").runs)
        assert "not of one clean commit" in commit
        assert "environment.decision_interval of ppo, intersection" in settings
        assert "metrics" in metrics
