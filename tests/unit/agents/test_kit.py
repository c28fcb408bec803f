"""The kit's wheel, and agents whose dependencies exclude each other."""

import subprocess
import sys
import zipfile
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import pytest

from smarts.zoo.kit_wheel import build_wheel
from tests.hosting import played
from tests.served_agents import served

pytestmark = pytest.mark.usefixtures("nothing_is_left")

AGENT = """
import conflicted
from tests.easing import Easing

class Theirs(Easing):
    def __init__(self):
        assert conflicted.VERSION == {version}
"""


def test_the_kit_runs_with_numpy_and_msgpack_alone(tmp_path):
    with zipfile.ZipFile(build_wheel(tmp_path)) as wheel:
        wheel.extractall(tmp_path)
    show = f"import sys; sys.path += {[str(tmp_path), str(Path(np.__file__).parents[1])]}; "
    show += "import smarts_agent_kit.server, smarts_agent_kit.worker; print(smarts_agent_kit.__file__); "
    show += "print([each for each in ('numba', 'ray', 'libsumo', 'smarts') if each in sys.modules])"
    said = subprocess.run([sys.executable, "-ISc", show], capture_output=True, text=True, check=True).stdout
    assert said.splitlines() == [f"{tmp_path}/smarts_agent_kit/__init__.py", "[]"]


def test_agents_with_conflicting_dependencies_drive_in_one_scene(tmp_path):
    with ExitStack() as ends:
        social = []
        for version in (1, 2):
            folder = tmp_path / str(version)
            folder.mkdir()
            (folder / "conflicted.py").write_text(f"VERSION = {version}\n")
            (folder / "theirs.py").write_text(AGENT.format(version=version))
            command = ("-m", "smarts_agent_kit", "theirs:Theirs", "--address", "127.0.0.1:0")
            social.append({"agent": ends.enter_context(served(*command, PYTHONPATH=str(folder)))})
        states, failures = played(social, {}, count=20)
    assert (states, failures) == played(2 * [{"agent": "tests.hosted_agents:easing-v0"}], {}, count=20)
    assert failures == {}
