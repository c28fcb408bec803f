"""Own code in experiment files: what a name stands for, and what is said where it stands for nothing."""

import numpy as np
import pandas as pd
import pytest
import yaml

from benchmark.experiment.algorithm_settings import CONFIGS
from benchmark.experiment.config import check_whole, read_experiment
from benchmark.experiment.models import Experiment
from benchmark.experiment.own_code import own_digests
from benchmark.experiment.runs import run_from, runs_of, scripted_runs_of
from benchmark.metrics import METRICS, Measure
from benchmark.report.values import NO_SHARE, measure_conditions
from benchmark.results.files import ResultsError
from benchmark.running.experiment import run_experiment
from benchmark.running.jobs import JobScheduler, jobs_of
from benchmark.scripted import SCRIPTED_POLICIES
from smarts.config import ConfigError
from smarts.errors import OwnCodeError
from tests.hand_made_results import agent_episodes, finish_runs
from tests.raising import raises

HEAD = "tasks: [loop]\ntraffic: [no_social_vehicles]\n"


@pytest.fixture(scope="session")
def folder(tmp_path_factory):
    """One folder for all: a process imports a name from one place."""
    return tmp_path_factory.mktemp("own")


@pytest.fixture
def write(folder):
    """Write files of own code and an experiment beside them; return the experiment's path."""

    def write(experiment, **files):
        for name, text in files.items():
            (folder / f"{name}.py").write_text(text)
        imports = ", ".join(f"{name}.py" for name in files)
        file = folder / "mine.yaml"
        file.write_text(f"imports: [{imports}]\n{HEAD}{experiment}")
        return file

    return write


def problems_of(file, *overrides):
    with pytest.raises(ConfigError) as caught:
        read_experiment(file, overrides)
    return [str(problem) for problem in caught.value.problems]


ALGORITHM = """
from algorithms.ppo import PPO, PPOConfig
from algorithms.registry import ALGORITHMS
from algorithms.settings import Fraction, PPOSettings

class MySettings(PPOSettings):
    caution: Fraction = 0.5
    \"\"\"What it means.\"\"\"

class MyConfig(PPOConfig):
    entry = ALGORITHMS["ppo"]._replace(settings=MySettings)

class Mine(PPO):
    config_class = MyConfig
"""


def test_an_own_algorithm_has_the_settings_of_its_config(write):
    file = write(
        "algorithms: ['own_a:MyConfig', dqn]\ntraining: {epochs: 3, lr: 0.1}\n"
        "settings: {'own_a:MyConfig': {caution: 0.25}}\n",
        own_a=ALGORITHM,
    )
    experiment = read_experiment(file)
    assert experiment.settings_of("own_a:MyConfig") == {"epochs": 3, "lr": 0.1, "caution": 0.25}
    assert experiment.settings_of("dqn") == {"lr": 0.1}
    run = next(runs_of(experiment))
    assert run.folder.parts[0] == "own_a-MyConfig"
    assert run.content()["algorithm"] == "own_a:MyConfig"
    assert run.content()["imports"] == [str(file.parent / "own_a.py")]
    assert run_from(run.content()).content() == run.content()
    assert CONFIGS["own_a:MyConfig"]().caution == 0.5


@pytest.mark.parametrize(
    ("change", "place", "named"),
    [
        ("settings={'own_b:MyConfig': {cautoin: 1}}", "settings.own_b:MyConfig.cautoin", "'caution'"),
        ("settings={'own_c:Other': {lr: 1}}", "settings.own_c:Other", "'own_c'"),
        ("tune={parameters: {caution: [0, 3]}}", "tune.parameters.caution[1]", "3"),
    ],
)
def test_settings_of_an_own_algorithm_are_checked_against_its_class(write, change, place, named):
    (problem,) = problems_of(write("algorithms: ['own_b:MyConfig']\n", own_b=ALGORITHM), change)
    assert f" {place}: " in problem
    assert named in problem


METRIC = """
import numpy as np
from benchmark.metrics import Measure, share

LONG = Measure(
    name="whatever", label="Long", meaning="share that drove for a second", columns=("long",),
    measure=lambda episode: {"long": episode.duration >= 1.0},
    value=lambda totals: share(totals["long"], totals["agents"]), missing="no agent took part",
)
NONE = 5
"""
POLICY = """
class Waits:
    def begin(self, episode, agent): ...
    def act(self, observation, mask): return 1

class Lame:
    def begin(self, episode, agent): ...

class Broken:
    def __init__(self): raise RuntimeError("no")
    def begin(self, episode, agent): ...
    def act(self, observation, mask): return 1
"""


def test_a_metric_that_is_no_share_in_one_row_has_no_interval_in_any(write):
    """DQN's mean is in [0, 1], and so are all of PPO's values; one of DQN's agent-episodes has 1.5."""
    file = write("algorithms: [ppo]\nmetrics: ['own_t:LONG']\n", own_t=METRIC)
    read_experiment(file)
    labels = {"training_seed": 1, "task": "loop", "task_traffic": "none"}
    parts = []
    for name, values in (("ppo", [0.5, 1.0, 1.0, 0.5]), ("dqn", [1.5, 0.5, 0.25, 0.75])):
        table = agent_episodes([["goal"]] * 4, mode="greedy", algorithm=name, **labels)
        parts.append(table.assign(long=values))
    found = measure_conditions(pd.concat(parts), ["own_t:LONG"]).set_index("algorithm")
    assert found["value"].to_dict() == {"dqn": 0.75, "ppo": 0.75}
    assert found["low"].isna().all()
    assert [*found["note"]] == [NO_SHARE] * 2


def test_own_metrics_and_scripted_policies(write):
    file = write(
        "algorithms: [ppo]\nmetrics: [safety, 'own_m:LONG']\nscripted: [keep_lane, 'own_p:Waits']\n",
        own_m=METRIC,
        own_p=POLICY,
    )
    experiment = read_experiment(file)
    run = next(runs_of(experiment))
    assert run.task_setting.test_content()["metrics"] == ["safety", "own_m:LONG"]
    assert isinstance(METRICS["own_m:LONG"], Measure)
    assert METRICS["own_m:LONG"].name == "own_m:LONG"
    assert [*METRICS][-1] == "own_m:LONG"
    assert SCRIPTED_POLICIES["own_p:Waits"]().act(np.zeros(3), np.ones(4, bool)) == 1
    assert [each.folder.parts[1] for each in scripted_runs_of(experiment)] == ["keep_lane", "own_p-Waits"]


BAD = {
    "wrong_syntax": "x = (\n",
    "wrong_import": "import os\nimport no_such_module_at_all\n",
    "raises_at_once": "\n\nraise RuntimeError('at once')\n",
    "own_q": POLICY,
    "own_n": METRIC,
    "own_k": ALGORITHM
    + """
class Anonymous(PPOConfig):
    algorithm = "mine"
""",
}


@pytest.mark.parametrize(
    ("change", "place", "said"),
    [
        ("scripted=['wrong_syntax:A']", "wrong_syntax.py:1: ", "SyntaxError"),
        ("scripted=['not_there:A']", "", "there is no module 'not_there'"),
        ("scripted=['own_q:Wait']", "own_q.py: ", "did you mean 'Waits'"),
        ("scripted=['own_q:Lame']", "own_q.py:6: ", "has no method 'act'"),
        ("metrics=['own_n:NONE']", "own_n.py: ", "Measure"),
        ("algorithms=['own_q:Waits']", "own_q.py:2: ", "JointConfig"),
        ("environment.adapter='own_q:Waits'", "own_q.py:2: ", "has no method 'collect'"),
    ],
)
def test_what_is_none_is_one_message_with_file_and_line(write, folder, change, place, said):
    file = write("algorithms: [ppo]\n", **BAD)
    (problem,) = problems_of(file, change)
    assert said in problem
    assert place in problem
    assert not place or str(folder / place) in problem


@pytest.mark.parametrize(
    ("imports", "said"),
    [("nowhere.py", "there is no such Python file or folder"), ("json.py", "the name 'json' is taken by")],
)
def test_files_that_cannot_be_imported(tmp_path, imports, said):
    for name in ("my-file.py", "json.py"):
        (tmp_path / name).write_text("")
    file = tmp_path / "mine.yaml"
    file.write_text(f"imports: [{imports}]\nalgorithms: [ppo]\n{HEAD}")
    (problem,) = problems_of(file)
    assert said in problem
    assert problem.startswith(f"{file}:1: imports: ")


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (
            "algorithms=[dqn]",
            "algorithms[0]: 'dqn' needs discrete actions, and environment.action is 'Continuous'",
        ),
        ("scripted=[random]", "scripted[0]: 'random' acts by lane actions"),
        (
            "environment={vehicle_model: kinematic, tyre_model: linear}",
            "environment.tyre_model: the kinematic vehicle has no tyres that slip",
        ),
    ],
)
def test_physics_and_actions_are_checked(tmp_path, change, said):
    file = tmp_path / "mine.yaml"
    file.write_text(f"algorithms: [ppo]\n{HEAD}environment: {{action: Continuous}}\n")
    assert any(said in problem for problem in problems_of(file, change)), problems_of(file, change)


def test_experiments_made_in_python_are_checked_like_files(folder):
    (folder / "own_python.py").write_text(POLICY)
    given = {"algorithms": ["ppo"], "tasks": ["loop"], "imports": [str(folder / "own_python.py")]}
    checked = check_whole(Experiment(name="x", scripted=["own_python:Waits"], **given))
    assert checked.scripted == ("own_python:Waits",)
    bad = Experiment(
        scripted=["own_python:Wait"], training={"lr": 2.0}, environment={"reward": {"gaol": 1}}, **given
    )
    with pytest.raises(ConfigError) as caught:
        check_whole(bad)
    said = str(caught.value)
    for each in ("name: is missing", "did you mean 'Waits'", "training.lr: 2.0; ", "gaol"):
        assert each in said


@pytest.fixture
def package(tmp_path):
    """A package of own code whose `main` imports `.near`, which imports `far`, a file beside it."""
    home = tmp_path / "own_package"
    (home / "inner").mkdir(parents=True)
    (home / "__init__.py").write_text("")
    (home / "inner" / "__init__.py").write_text("def late():\n    from own_package.inner import deep\n")
    (home / "inner" / "deep.py").write_text("x = 1\n")
    (home / "main.py").write_text(
        '"""Old."""\nfrom . import near\nfrom .inner import late\nclass Mine: ...\n'
    )
    (home / "near.py").write_text("import numpy\nimport own_far\n")
    (home / "other.py").write_text("x = 1\n")
    (tmp_path / "own_far.py").write_text("x = 1\n")
    return home


@pytest.mark.parametrize(
    ("file", "counts"),
    [("near.py", True), ("inner/__init__.py", True), ("../own_far.py", True), ("other.py", False)],
)
def test_a_digest_covers_what_own_code_imports(package, file, counts):
    imports = [str(package), str(package.parent / "own_far.py")]
    part = {"reward": "own_package.main:Mine", "other": ["no_such_module:A", "plain text"]}
    before = own_digests(imports, part)
    assert [*before] == ["own_package.main:Mine"]
    path = package / file
    path.write_text(path.read_text().replace("Old.", "New.") + "# a comment\n")
    assert own_digests(imports, part) == before
    path.write_text(path.read_text() + "y = 2\n")
    assert (own_digests(imports, part) != before) == counts


def test_a_run_of_other_own_code_is_refused_and_kept(write, tmp_path):
    file = write(
        "algorithms: [ppo]\nseeds: [1]\nmetrics: ['own_v:LONG']\nevaluation: {episodes: 1, modes: [greedy]}\n"
        "environment: {reward: 'own_w:speed'}\n",
        own_v=METRIC,
        own_w="def speed(step):\n    return step.speed\n",
    )
    experiment, code = read_experiment(file), file.parent / "own_w.py"
    folder = finish_runs(experiment, tmp_path, {"long": 1.0})

    def scheduler():
        return JobScheduler(jobs_of(experiment), tmp_path, experiment.resources)

    assert scheduler().is_done
    metric = file.parent / "own_v.py"
    metric.write_text(METRIC.replace("1.0", "2.0"))
    assert not scheduler().is_done, "another metric: the run is tested again"
    metric.write_text(METRIC)
    written = folder.config.read_bytes(), folder.run.read_bytes()
    code.write_text("def speed(step):\n    return 2 * step.speed\n")
    with raises(ResultsError, folder.config, values=["own_w:speed"]):
        scheduler()
    assert (folder.config.read_bytes(), folder.run.read_bytes()) == written
    # Runs of earlier versions recorded no digest: they are taken as they are.
    content = folder.read_config()
    del content["own_code"]
    folder.config.write_text(yaml.safe_dump(content))
    assert scheduler().is_done


@pytest.mark.parametrize(
    ("module", "experiment", "code", "line"),
    [
        (
            "own_e1",
            "metrics: ['own_e1:LONG']",
            METRIC.replace("episode.duration >= 1.0", "episode.no_such_field"),
            7,
        ),
        ("own_e2", "scripted: ['own_e2:Waits']", POLICY.replace("return 1", "return None"), 4),
    ],
)
def test_own_code_is_tried_before_training(write, tmp_path, module, experiment, code, line):
    file = write(f"algorithms: [ppo]\n{experiment}\n", **{module: code})
    with raises(OwnCodeError, f"{module}.py:{line}"):
        run_experiment(read_experiment(file), tmp_path / "results")
    assert not (tmp_path / "results").exists()
