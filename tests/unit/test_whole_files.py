import errno

import pytest

from smarts.errors import SmartsError
from smarts.whole_files import written_whole
from tests.raising import raises


def test_failure_keeps_the_existing_file(tmp_path):
    out = tmp_path / "a.gif"
    out.write_text("old")
    with pytest.raises(ZeroDivisionError), written_whole(out) as partial:
        partial.write_text(f"half {1 / 0}")
    assert out.read_text() == "old"
    assert [*tmp_path.iterdir()] == [out]


def test_an_unwritable_path_is_named(tmp_path):
    (tmp_path / "file").write_text("")
    with raises(SmartsError, tmp_path / "file" / "a.png"), written_whole(tmp_path / "file" / "a.png"):
        pass


def test_errors_of_the_block_stay_its_own_unless_the_disk_is_full(tmp_path):
    out = tmp_path / "a.png"
    with pytest.raises(FileNotFoundError), written_whole(out):
        (tmp_path / "missing").read_text()
    with raises(SmartsError, out), written_whole(out):
        raise OSError(errno.ENOSPC, "No space left on device")
