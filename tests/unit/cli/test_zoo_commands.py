"""`smarts-bench zoo`: what it prints, and what it refuses."""

import pytest
from typer.testing import CliRunner

from benchmark.cli import app
from smarts.errors import SmartsError, UnknownNameError
from smarts.zoo.agents import AGENTS

AGENT = """
from smarts.zoo import register
from smarts.zoo.agents.idm import IdmDriver
register("{name}-v0", IdmDriver, author="me", m_level="M0", tau=0.9)
"""


def run(*words, code=0):
    """Return what a command prints; its errors are raised."""
    found = CliRunner().invoke(app, [*map(str, words)], catch_exceptions=False)
    assert found.exit_code == code, found.output
    return found.output


@pytest.fixture
def folder(tmp_path):
    folder = tmp_path / "cli_zoo"
    folder.mkdir()
    (folder / "__init__.py").write_text(AGENT.format(name="added"))
    return folder


def test_all_agents_are_listed():
    lines = run("zoo", "list").splitlines()
    assert lines[0].split() == ["locator", "level", "author", "provenance"]
    assert {*AGENTS} <= {line.split()[0] for line in lines[1:]}


def test_an_agent_is_described(folder):
    text = run("zoo", "describe", "idm-v0")
    assert "M-level: M0" in text
    assert "option tau: 1.2" in text
    assert "option poses: needed" in run("zoo", "describe", "trajectory-v0")
    assert "option tau: 0.9" in run("zoo", "describe", "cli_zoo:added-v0", "--import", folder)


def test_bad_input_is_named(folder):
    for words, error in (
        (("describe", "idn-v0"), UnknownNameError),
        (("test", "idm-v0", "--set", "tau"), SmartsError),
        (("test", "idm-v0", "--set", "tua=1"), SmartsError),
        (("test", "trajectory-v0"), SmartsError),
        (("kit", "--out", folder / "__init__.py"), SmartsError),
    ):
        with pytest.raises(error):
            run("zoo", *words)
