"""What a process may use of a machine."""

import shutil
import subprocess

from benchmark.running import machine
from tests.hand_made_results import script


def test_the_repository_around_an_installation_is_not_its_commit(tmp_path):
    def git(*words):
        named = ["-c", "user.name=a", "-c", "user.email=a@example.org"]
        subprocess.run(["git", "-C", str(tmp_path), *named, *words], check=True, capture_output=True)

    file = tmp_path / "lib" / "benchmark" / "running" / "machine.py"
    file.parent.mkdir(parents=True)
    shutil.copy(machine.__file__, file)
    installed = script("machine", file.parent)
    git("init")
    git("commit", "--allow-empty", "-m", "of another project")
    assert installed.commit() is None
    git("add", ".")
    assert installed.commit().endswith("+")
    git("commit", "-m", "with the file")
    assert len(installed.commit()) == 12
    (file.parent / "more").mkdir()
    for name in ("new.py", "tyre.yaml"):
        (file.parent / "more" / name).touch()
        assert installed.commit().endswith("+")
        (file.parent / "more" / name).unlink()
    assert not installed.commit().endswith("+")
