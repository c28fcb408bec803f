"""Agents are found by locators, and what is wrong with one is named."""

import textwrap
from concurrent.futures import ThreadPoolExecutor

import pytest

from smarts.agents.interface import AgentInterface
from smarts.agents.policy import Agent
from smarts.agents.spec import AgentSpec
from smarts.errors import OwnCodeError, SmartsError, UnknownNameError
from smarts.registry import import_own
from smarts.types.actions import ActionSpaceType
from smarts.zoo import entries, find_entry, make, make_agent, make_spec, register, search
from smarts.zoo.entry import ZooEntry
from smarts.zoo.folders import added_agents, write_added
from smarts.zoo.registry import add_folder, build_agent

MODULE = """
from smarts.core.agent import Agent
from smarts.core.agent_interface import AgentInterface, AgentType
from smarts.core.controllers import ActionSpaceType
from smarts.zoo.agent_spec import AgentSpec
from smarts.zoo.registry import register


class Stopped(Agent):
    '''Stands.'''
    interface = AgentInterface(action=ActionSpaceType.LaneWithContinuousSpeed)

    def __init__(self, brake=1.0):
        self.brake = brake

    def act(self, obs):
        return (0, 0)


def stopped(brake=1.0):
    return AgentSpec(interface=Stopped.interface, agent_builder=Stopped, agent_params={"brake": brake})


register("stopped-v0", stopped, brake=0.5, author="me", m_level="M1")
register(locator="class-v1", entry_point=Stopped)
register("late-v0", entry_point="MODULE:stopped")
register("spec-v0", entry_point="smarts.zoo.agent_spec:AgentSpec",
         interface=AgentInterface.from_type(AgentType.Laner))
register("nothing-v0", entry_point=lambda **kwargs: None)
register("raises-v0", entry_point=lambda **kwargs: 1 / 0)
register("no-interface-v0", entry_point=lambda **kwargs: AgentSpec(agent_builder=Stopped))
register("no-act-v0", entry_point=lambda: AgentSpec(interface=Stopped.interface, agent_builder=dict))
"""


@pytest.fixture
def module(tmp_path, request):
    """The name of an importable module that registers agents."""
    name = f"zoo_of_{abs(hash(request.node.name))}"
    (tmp_path / f"{name}.py").write_text(textwrap.dedent(MODULE).replace("MODULE", name))
    import_own([tmp_path / f"{name}.py"])
    return name


def test_names_of_the_project_need_no_module():
    for locator in ("idm-v0", "smarts.zoo:idm-v0"):
        spec = make_spec(locator, tau=2.0)
        assert spec.build_agent().model.tau == 2.0
        assert spec.interface.action == ActionSpaceType.LaneWithContinuousSpeed


def test_options_of_the_interface_change_it():
    assert make_spec("idm-v0").interface.vehicle_model == "kinematic"
    assert make_spec("idm-v0", vehicle_model="bullet").interface.vehicle_model == "bullet"
    other = AgentInterface(action=ActionSpaceType.Lane)
    assert make_spec("idm-v0", interface=other).interface == other


def test_a_module_registers_its_agents(module):
    assert make_agent(f"{module}:stopped-v0")[0].brake == 0.5
    assert build_agent(f"{module}:stopped-v0", brake=0.1).brake == 0.1
    assert make_agent(f"{module}:class-v1", brake=0.2)[0].brake == 0.2
    assert make(f"{module}:late-v0").build_agent().brake == 1.0
    assert make_spec(f"{module}:spec-v0").interface.action == ActionSpaceType.Lane
    entry = find_entry(f"{module}:stopped-v0")
    assert (entry.author, entry.m_level, entry.locator) == ("me", "M1", f"{module}:stopped-v0")
    assert entry.options() == {"brake": 0.5}
    assert f"{module}:stopped-v0" in [each.locator for each in entries()]


@pytest.mark.parametrize("name", ["nothing-v0", "raises-v0", "no-interface-v0"])
def test_what_is_no_agent_is_named(module, name):
    with pytest.raises(OwnCodeError, match=name):
        make_spec(f"{module}:{name}")


def test_what_cannot_act_is_named(module):
    with pytest.raises(OwnCodeError, match="act"):
        make_agent(f"{module}:no-act-v0")


def test_unknown_names_offer_the_nearest(module):
    for locator, nearest in (("idn-v0", "idm-v0"), (f"{module}:stoped-v0", "stopped-v0")):
        with pytest.raises(UnknownNameError) as caught:
            make_spec(locator)
        assert nearest in caught.value.remedy


@pytest.mark.parametrize("locator", ["idm", "idm-v"])
def test_what_is_no_locator_is_named(locator):
    with pytest.raises(UnknownNameError):
        make_spec(locator)


def test_a_module_that_is_not_there_or_raises(tmp_path):
    with pytest.raises(OwnCodeError, match="no_such_module"):
        make_spec("no_such_module.at_all:x-v0")
    (tmp_path / "raising_zoo.py").write_text("raise RuntimeError('no')")
    import_own([tmp_path / "raising_zoo.py"])
    with pytest.raises(OwnCodeError) as caught:
        make_spec("raising_zoo:x-v0")
    assert "raising_zoo.py:1" in caught.value.place
    with pytest.raises(UnknownNameError):
        make_spec("json:x-v0")


def test_unknown_options_are_named(module):
    with pytest.raises(SmartsError) as caught:
        make_spec("idm-v0", tua=1.0)
    assert "tau" in caught.value.remedy
    with pytest.raises(SmartsError, match="brakes"):
        make_spec(f"{module}:stopped-v0", brakes=1.0)


def test_values_of_options_are_checked():
    for options in ({"tau": -1.0}, {"accel": 0.0}, {"speed_factor": "fast"}, {"max_speed": 0.0}):
        with pytest.raises(SmartsError, match=next(iter(options))):
            make_agent("idm-v0", **options)


def test_names_of_the_original():
    assert make_spec("zoo.policies:keep-lane-agent-v0") == make_spec("keep-lane-v0")
    for name, advice in (("replay-agent-v0", "trajectory-v0"), ("keep-lane-v0", "keep-lane-agent-v0")):
        with pytest.raises(UnknownNameError) as caught:
            make_spec(f"zoo.policies:{name}")
        assert advice in caught.value.remedy


def test_what_cannot_be_registered():
    for locator, entry_point, more in (
        ("no-version", Agent, {}),
        ("x-v0", Agent, {"m_level": "M9"}),
    ):
        with pytest.raises(SmartsError):
            register(locator, entry_point, **more)


def test_two_modules_may_use_one_name(tmp_path):
    for name in ("zoo_one", "zoo_two"):
        (tmp_path / f"{name}.py").write_text(MODULE.replace("MODULE", name))
        import_own([tmp_path / f"{name}.py"])
        assert make_spec(f"{name}:stopped-v0").agent_builder.__module__ == name
    with pytest.raises(UnknownNameError) as caught:
        make_spec("class-v1")
    assert "zoo_one:class-v1" in caught.value.remedy


def test_a_folder_is_added_for_later_processes(tmp_path, monkeypatch):
    monkeypatch.setenv("SMARTS_ZOO", str(tmp_path / "config" / "zoo.yaml"))
    folder = tmp_path / "added_zoo"
    folder.mkdir()
    agent = "\nregister('added-v0', Stopped, author='me', licence='MIT')\n"
    (folder / "__init__.py").write_text(MODULE.split("\n\ndef stopped")[0] + agent)
    assert [entry.name for entry in add_folder(folder)] == ["added-v0"]
    listed = {entry.locator: entry for entry in entries()}["added-v0"]
    assert (listed.author, listed.licence, listed.folder) == ("me", "MIT", str(folder))
    assert isinstance(make_spec("added-v0"), AgentSpec)


def test_a_folder_without_an_agent(tmp_path):
    folder = tmp_path / "empty_zoo"
    folder.mkdir()
    (folder / "__init__.py").write_text("")
    with pytest.raises(SmartsError, match="registers no agent"):
        add_folder(folder)
    with pytest.raises(OwnCodeError, match="zoo add"):
        add_folder(tmp_path / "nowhere")


def test_modules_beside_a_scenario_are_found_by_their_path(tmp_path):
    folder = tmp_path / "scenarios" / "sumo" / "2lane"
    folder.mkdir(parents=True)
    (folder / "agent_prefabs.py").write_text(MODULE)
    (folder / "raising.py").write_text("raise RuntimeError('no')")
    with pytest.raises(OwnCodeError, match="scenarios"):
        make_spec("scenarios.sumo.2lane.agent_prefabs:stopped-v0")
    search(folder)
    assert make_agent("scenarios.sumo.2lane.agent_prefabs:stopped-v0")[0].brake == 0.5
    with pytest.raises(OwnCodeError) as caught:
        make_spec("scenarios.sumo.2lane.raising:x-v0")
    assert "raising.py" in caught.value.place
    with pytest.raises(OwnCodeError):
        make_spec("scenarios.sumo.3lane.agent_prefabs:stopped-v0")
    copied = tmp_path / "copies" / "3lane"
    copied.mkdir(parents=True)
    (copied / "agent_prefabs.py").write_text(MODULE)
    search(copied)
    assert make_agent("scenarios.sumo.3lane.agent_prefabs:stopped-v0")[0].brake == 0.5


def test_agents_that_are_added_at_once_are_all_kept(tmp_path, monkeypatch):
    monkeypatch.setenv("SMARTS_ZOO", str(tmp_path / "zoo.yaml"))
    names = [f"added-v{number}" for number in range(40)]
    with ThreadPoolExecutor(8) as threads:
        list(threads.map(lambda name: write_added([ZooEntry(name, "", folder=str(tmp_path))]), names))
    assert sorted(added_agents()) == sorted(names)
