"""Agents are found by locators, and what is wrong with one is named."""

import textwrap

import pytest

from smarts.agents.interface import AgentInterface
from smarts.errors import OwnCodeError, SmartsError, UnknownNameError
from smarts.registry import import_own
from smarts.types.actions import ActionSpaceType
from smarts.zoo import entries, find_entry, make, make_agent, make_spec, registry, search
from smarts.zoo.registry import build_agent
from tests.raising import raises

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


def test_installed_packages_declare_agents(module, tmp_path, monkeypatch):
    about = tmp_path / "drivers-1.2.dist-info"
    about.mkdir()
    facts = "Metadata-Version: 2.1\nName: drivers\nVersion: 1.2\nAuthor: me\nLicense: MIT\n"
    (about / "METADATA").write_text(facts)
    (about / "entry_points.txt").write_text(f"[smarts.zoo]\ndriver-v0 = {module}:stopped\n")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(registry, "_of_packages", registry._of_packages.__wrapped__)  # without its cache
    entry = find_entry("driver-v0")
    assert (entry.author, entry.licence, entry.provenance) == ("me", "MIT", "package drivers 1.2")
    assert make_agent("driver-v0", brake=0.2)[0].brake == 0.2


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


@pytest.mark.parametrize(
    ("locator", "options", "error", "said"),
    [
        ("MODULE:nothing-v0", {}, OwnCodeError, "nothing-v0"),
        ("MODULE:raises-v0", {}, OwnCodeError, "ZeroDivisionError"),
        ("MODULE:no-interface-v0", {}, OwnCodeError, "no-interface-v0"),
        ("MODULE:no-act-v0", {}, SmartsError, "no method act"),
        ("MODULE:stoped-v0", {}, UnknownNameError, "'stopped-v0'"),
        ("MODULE:stopped-v0", {"brakes": 1.0}, SmartsError, "'brake'"),
        ("idn-v0", {}, UnknownNameError, "'idm-v0'"),
        ("idm", {}, UnknownNameError, "a name ends in its version"),
        ("idm-v0", {"tua": 1.0}, SmartsError, "'tau'"),
        ("json:x-v0", {}, UnknownNameError, "register"),
        ("no_such_module.at_all:x-v0", {}, OwnCodeError, "no_such_module"),
        ("zoo.policies:replay-agent-v0", {}, UnknownNameError, "trajectory-v0"),
        ("zoo.policies:keep-lane-v0", {}, UnknownNameError, "keep-lane-agent-v0"),
    ],
)
def test_what_is_wrong_is_named(module, locator, options, error, said):
    with raises(error, values=[said]):
        make_agent(locator.replace("MODULE", module), **options)


def test_names_of_the_original():
    assert make_spec("zoo.policies:keep-lane-agent-v0") == make_spec("keep-lane-v0")


def test_two_modules_may_use_one_name(tmp_path):
    for name in ("zoo_one", "zoo_two"):
        (tmp_path / f"{name}.py").write_text(MODULE.replace("MODULE", name))
        import_own([tmp_path / f"{name}.py"])
        assert make_spec(f"{name}:stopped-v0").agent_builder.__module__ == name
    with pytest.raises(UnknownNameError) as caught:
        make_spec("class-v1")
    assert "zoo_one:class-v1" in caught.value.remedy


def test_modules_beside_a_scenario_are_found_by_their_path(tmp_path):
    folder = tmp_path / "scenarios" / "sumo" / "2lane"
    folder.mkdir(parents=True)
    (folder / "agent_prefabs.py").write_text(MODULE)
    with pytest.raises(OwnCodeError, match="scenarios"):
        make_spec("scenarios.sumo.2lane.agent_prefabs:stopped-v0")
    search(folder)
    assert make_agent("scenarios.sumo.2lane.agent_prefabs:stopped-v0")[0].brake == 0.5
