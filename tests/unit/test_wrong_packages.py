"""A folder beside a script that hides one of our packages is named, with ours and what to do."""

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]


def test_a_package_of_the_users_that_hides_ours(tmp_path):
    name = "algorithms"
    (tmp_path / name).mkdir()
    (tmp_path / name / "__init__.py").write_text("")
    script = tmp_path / "script.py"
    script.write_text("from benchmark import run\n")
    ended = subprocess.run([sys.executable, str(script)], capture_output=True, text=True, cwd=tmp_path)
    said = ended.stderr.splitlines()[-1]
    assert ended.returncode == 1
    assert said.startswith("ImportError: ")
    assert str(tmp_path / name) in said
    assert str(ROOT / name) in said
    assert "rename" in said


def test_other_folders_do_not_matter(tmp_path):
    for name in ("scenarios", "my_algorithms"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "__init__.py").write_text("raise RuntimeError")
    script = tmp_path / "script.py"
    script.write_text("from benchmark import Experiment; print(Experiment.__name__)\n")
    ended = subprocess.run([sys.executable, str(script)], capture_output=True, text=True, cwd=tmp_path)
    assert ended.stdout.strip() == "Experiment", ended.stderr
