"""Experiment files: what they say, their runs, and that what is published about them is up to date."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from algorithms.registry import ALGORITHMS
from benchmark.experiment.config import read_experiment
from benchmark.experiment.runs import run_from, runs_of, scripted_runs_of, task_settings_of
from benchmark.experiment.schema import schema
from benchmark.running.experiment import check_unseen
from benchmark.running.testing import parts_of
from smarts.config import ConfigError
from smarts.errors import SmartsError
from tests.raising import raises

CONFIGS = Path(__file__).parents[3] / "configs"


@pytest.fixture
def write(tmp_path):
    def write(text):
        file = tmp_path / "mine.yaml"
        file.write_text(text)
        return file

    return write


def said(file, *overrides):
    with pytest.raises(ConfigError) as caught:
        read_experiment(file, overrides)
    return str(caught.value)


@pytest.mark.parametrize("file", sorted(CONFIGS.glob("*.yaml")), ids=lambda file: file.stem)
def test_every_config_of_the_repository_can_be_read(file):
    experiment = read_experiment(file)
    assert experiment.name == file.stem
    assert len({run.folder for run in runs_of(experiment)}) == len([*runs_of(experiment)])


def test_every_algorithm_x_task_x_traffic_x_seed_is_a_run(write):
    file = write(
        "algorithms: [ppo, dqn]\ntasks: [loop, {name: both, scenarios: [loop, city]}]\nseeds: [1, 2, 5]\n"
    )
    experiment = read_experiment(file, ["scripted=[parked]"])
    runs = [*runs_of(experiment)]
    assert len(runs) == 2 * 2 * 2 * 3
    assert [run.seed for run in runs[:8]] == [1] * 8  # the first seed of everything comes first
    assert {str(run.folder) for run in runs if run.seed == 5 and run.algorithm == "dqn"} == {
        f"dqn/{task}/{traffic}/seed_5"
        for task in ("loop", "both")
        for traffic in ("no_social_vehicles", "random_social_vehicles")
    }
    assert [cell.task.scenarios for cell in task_settings_of(experiment)][:2] == [("loop",), ("loop", "city")]
    assert len(scripted_runs_of(experiment)) == 4


LISTS = """
algorithms: [ppo]
environment: {agents: 2}
traffic: [random_social_vehicles]
tasks:
- name: streets
  train: [{scenarios: ["*_v1"], weight: 3}, "intersection@mirr*"]
  train_traffic: [no_social_vehicles, random_social_vehicles]
  validation: [city]
  test:
  - roundabout
  - {name: empty, scenarios: [overtaking, u_turn], traffic: no_social_vehicles, seen: true}
"""


def test_a_task_has_lists_for_training_validation_and_test(write):
    (run,) = [run for run in runs_of(read_experiment(write(LISTS), ["seeds=[1]"]))]
    task = run.task_setting.task
    assert task.trained_on == dict.fromkeys(
        ("two_way_v1", "double_merge_v1", "intersection_v1", "intersection@mirrored"), 1.0
    )
    assert task.validated_on == {"city": 1}
    again = run_from(run.content(), run.task_setting.test_content()["test"])
    assert again.task_setting.task.test == task.test
    assert again.task_setting.task.trained_on == task.trained_on
    assert again.content() == run.content()
    parts = [*parts_of(run.task_setting, ("greedy", "sampled"))]
    assert [part.condition for part in parts[:2]] == ["roundabout", "empty (seen)"]
    assert [(part.name, [*part.scenarios], part.traffic) for part in parts[:2]] == [
        ("greedy-roundabout", ["roundabout"], None),
        ("greedy-empty", ["overtaking", "u_turn"], "no_social_vehicles"),
    ]
    assert [part.mode for part in parts] == ["greedy"] * 2 + ["sampled"] * 2
    assert len(said(write(LISTS + "  scenarios: [loop]")).splitlines()) == 1


@pytest.mark.parametrize("tested", ["intersection@left_turns", "intersection_v1"])
def test_a_test_on_a_map_of_the_training_is_refused(write, tested):
    text = (
        f"tasks: [{{name: mine, train: [intersection], test: [roundabout, '{tested}']}}]\nscripted: [parked]"
    )
    (task,) = read_experiment(write(text)).tasks
    with raises(SmartsError, "task 'mine'", values=[tested, "'intersection'", "training"]):
        check_unseen(task)
    check_unseen(task.model_copy(update={"test": task.test[:1]}))
    (seen,) = read_experiment(
        write(text.replace(f"'{tested}'", f"{{name: a, scenarios: ['{tested}'], seen: true}}"))
    ).tasks
    check_unseen(seen)


def test_a_validation_on_a_map_of_the_training_is_refused(write):
    text = "tasks: [{name: mine, train: [loop, city], validation: [loop]}]\nscripted: [parked]"
    (task,) = read_experiment(write(text)).tasks
    with raises(SmartsError, "task 'mine'", values=["the validation plays 'loop'", "training"]):
        check_unseen(task)


CELLS = """
algorithms: [ppo, dqn]
tasks: [loop, {name: both, scenarios: [loop, city]}]
seeds: [1]
training: {lr: 0.1}
settings: {ppo: {lr: 0.2}}
budget: {agent_steps: 20, minutes: 5}
by_task:
  loop: {budget: {agent_steps: 10}, training: {lr: 0.3, gamma: 0.5}}
  loop/random_social_vehicles: {budget: {agent_steps: null}, settings: {ppo: {lr: [[0, 0.4], [9, 0.1]]}}}
"""


def test_tasks_have_budgets_and_settings_of_their_own(write):
    runs = {
        (run.algorithm, str(run.task_setting)): (run.settings, run.budget.model_dump())
        for run in runs_of(read_experiment(write(CELLS)))
    }
    alone, among = "loop, no_social_vehicles", "loop, random_social_vehicles"
    assert runs["ppo", alone] == ({"lr": 0.2, "gamma": 0.5}, {"agent_steps": 10, "minutes": 5.0})
    assert runs["dqn", alone] == ({"lr": 0.3, "gamma": 0.5}, {"agent_steps": 10, "minutes": 5.0})
    scheduled = {"lr": [[0.0, 0.4], [9.0, 0.1]], "gamma": 0.5}
    assert runs["ppo", among] == (scheduled, {"agent_steps": None, "minutes": 5.0})
    assert runs["dqn", among] == ({"lr": 0.3, "gamma": 0.5}, {"agent_steps": None, "minutes": 5.0})
    for traffic in ("no_social_vehicles", "random_social_vehicles"):
        for algorithm, lr in (("ppo", 0.2), ("dqn", 0.1)):
            found = runs[algorithm, f"both, {traffic}"]
            assert found == ({"lr": lr}, {"agent_steps": 20, "minutes": 5.0})


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ("by_task.lop={}", "by_task.lop: there is no such task; did you mean 'loop'?"),
        (
            "by_task.loop.training.lr=7",
            "by_task.loop.training.lr: 7; input should be less than or equal to 1",
        ),
        ("by_task.loop.bugdet=3", "there is no key by_task.loop.bugdet; did you mean 'budget'?"),
    ],
)
def test_mistakes_in_tasks_are_named_once(write, change, message):
    told = said(write(CELLS), change)
    assert message in told
    assert len(told.splitlines()) == 1


def test_the_content_follows_what_training_depends_on_and_nothing_else(write):
    file = write("algorithms: [ppo]\ntasks: [loop]\n")

    def content(*overrides):
        return json.dumps(next(runs_of(read_experiment(file, overrides))).content())

    same = [["resources.parallel=1"], ["evaluation.episodes=5"], ["scripted=[parked]"], ["name=other"]]
    other = [
        ["budget.agent_steps=5"],
        ["training.lr=1"],
        ["environment.agents=2"],
        ["seeds=[9]"],
        ["tasks=[city]"],
    ]
    assert {content(*overrides) for overrides in same} == {content()}
    assert len({content(), *(content(*overrides) for overrides in other)}) == 1 + len(other)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        # names
        ("algorithms=[pppo]", "there is no algorithm 'pppo'; did you mean 'ppo'"),
        ("tasks=[intersecton]", "there is no scenario 'intersecton'"),
        ("traffic=[random_social_vehicle]", "loop has no traffic 'random_social_vehicle'; did you mean"),
        ("scripted=[parkt]", "did you mean 'parked'?"),
        ("training.lrr=1", "training.lrr: no algorithm has such a setting; did you mean 'lr'?"),
        ("environment.observation=bencmark", "environment.observation: there is no observation 'bencmark'"),
        ("environment.reward=papr", "there is no reward 'papr'; did you mean 'paper'?"),
        ("name=../x", "cannot name a folder"),
        ("tasks=['*_v1']", "'*_v1' cannot name a folder; give {name: ..., scenarios: [...]}"),
        (
            "tasks=[{name: a, scenarios: ['loop@mirr_*']}]",
            "no variation of 'loop' fits 'mirr_*'; known: 'dense'",
        ),
        ("tasks=[{name: a, train: ['no_loop@*']}]", "tasks[0].train[0]: there is no scenario 'no_loop'"),
        # types and ranges
        ("algorithms=ppo", "algorithms is 'ppo'; input should be a list: [ppo]"),
        ("tasks=[loop, loop]", "there twice"),
        ("budget.agent_steps=1e30", "input should be less than or equal to 1000000000000"),
        ("budget.agent_steps=null", "budget: has neither agent_steps nor minutes"),
        ("budget.minutes=12:30", "budget.minutes is '12:30'; input should be a valid number"),
        ("training.gamma=7.0", "training.gamma: 7.0; "),
        ("evaluation.modes=[greedily]", "'greedy' or 'sampled'"),
        # choices that do not fit
        ("algorithms=[]", "algorithms: there is nothing to run"),
        ("settings={ppo: {gru: 8, rollout_fragment_length: 60}}", "settings.ppo: ppo: rollout_fragment_len"),
        ("environment.agents=5", "environment.agents: loop: ego_missions: 5 egos, but only 4 missions"),
        ("training.sharing={a: [agent-0, agent-1], b: [agent-2]}", "agent-3 is in no groups"),
    ],
)
def test_mistakes_are_named(write, change, message):
    assert message in said(write("algorithms: [ppo]\ntasks: [loop]\n"), change)


def test_algorithms_must_suit_the_agents(write):
    file = write("algorithms: [pr2, mat]\ntasks: [loop]\n")
    assert "algorithms[0]: 'pr2' needs 2 agents, and there are 1" in said(file, "environment.agents=1")
    mixed = said(file, "environment.agents={a: {}, b: {action: Continuous}}")
    assert "algorithms[1]: 'mat' needs agents with equal actions, and they have Lane, Continuous" in mixed


def test_the_line_of_a_scenario_file_that_raises_is_named(write, tmp_path):
    (tmp_path / "broken").mkdir()
    (tmp_path / "broken" / "scenario.py").write_text("\nraise RuntimeError('boom')\n")
    message = said(write(f"algorithms: [ppo]\ntasks: [{tmp_path / 'broken'}]\n"), "seeds=[1]")
    assert f"tasks[0]: {tmp_path / 'broken' / 'scenario.py'}, line 2: the scenario file raises" in message


def test_a_scenario_without_a_map_says_so_and_nothing_else(write, tmp_path):
    (tmp_path / "town").mkdir()
    script = "from smarts.sstudio import gen_scenario, types as t\ngen_scenario(t.Scenario(), '.')\n"
    (tmp_path / "town" / "scenario.py").write_text(script)
    message = said(write(f"algorithms: [ppo]\ntasks: [{tmp_path / 'town'}]\n"))
    assert f"tasks[0]: {tmp_path / 'town'}: there is no road map 'map'" in message
    assert "missions" not in message
    assert "traffic" not in message


def test_a_value_that_one_algorithm_cannot_have_leads_to_one_of_its_own(write):
    file = write(f"extends: {CONFIGS / 'quickstart.yaml'}\nalgorithms: [ppo, happo, mat]\n")
    own = "settings: {happo: {sharing: none}}"
    message = said(file)
    assert "training.sharing: 'happo' cannot have 'all'" in message
    assert own in message
    assert "mat" not in message.replace(str(file), "")
    taken = read_experiment(file, ["settings={happo: {sharing: none}}"])
    assert taken.settings_of("happo")["sharing"] == "none"
    both = said(file, "training.sharing=none", "training.epochs=3", "algorithms=[mat, a2c]")
    assert "settings: {mat: {sharing: all}}" in both
    assert "settings: {a2c: {epochs: 1}}" in both


@pytest.mark.parametrize(
    ("more", "lines"),
    [
        (
            "bugdet: 3\nseeds: [1]\nseeds: [-1]\n",
            ("9: there is no key bugdet", "11: seeds is there twice", "11: seeds[0] is -1"),
        ),
        (
            "",
            (
                "5: traffic[1]: loop has no traffic 'nobody'",
                "7: training.gamma: 7; ",
                "8: training.tau: none of the algorithms has tau",
            ),
        ),
    ],
)
def test_mistakes_are_told_together_with_their_lines(write, more, lines):
    """What does not fit together is told once all values fit."""
    file = write(
        "algorithms: [ppo]\ntasks: [loop]\ntraffic:\n- no_social_vehicles\n- nobody\n"
        f"training:\n  gamma: 7\n  tau: 0.1\n{more}"
    )
    told = said(file).replace(f"{file}:", "line ")
    assert all(f"line {each}" in told for each in lines), told
    assert len(told.splitlines()) == len(lines)


def test_reading_a_file_loads_neither_torch_nor_ray_nor_the_simulation():
    code = (
        "import sys; from pathlib import Path\n"
        "from benchmark.experiment.config import read_experiment\n"
        "read_experiment(Path(sys.argv[1]))\n"
        "print(*{'torch', 'ray', 'numba', 'smarts.env.vector'} & {*sys.modules})\n"
    )
    config = str(CONFIGS / "paper_table.yaml")
    out = subprocess.run([sys.executable, "-c", code, config], capture_output=True, text=True, check=True)
    assert out.stdout.strip() == ""


def test_the_schema_knows_every_setting():
    """The settings of the repository's own files among them, which a JSON schema's checker would look up."""
    found = schema()
    for name, entry in ALGORITHMS.items():
        section = found["$defs"][entry.settings.__name__]
        assert found["properties"]["settings"]["properties"][name]["anyOf"][0]["$ref"].endswith(
            f"/{entry.settings.__name__}"
        )
        assert section["properties"].keys() == entry.settings.model_fields.keys()
        assert section["additionalProperties"] is False
        for setting in section["properties"]:
            assert setting in found["properties"]["training"]["properties"]
