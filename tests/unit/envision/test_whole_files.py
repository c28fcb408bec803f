import pytest

from smarts.envision.whole_files import written_whole
from smarts.errors import SmartsError
from tests.raising import raises


def test_failure_keeps_the_existing_file(tmp_path):
    out = tmp_path / "a.gif"
    out.write_text("old")

    def fails(partial):
        partial.write_text("half")
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError), written_whole(out) as partial:
        fails(partial)
    assert out.read_text() == "old"
    assert [*tmp_path.iterdir()] == [out]


def test_an_unwritable_path_is_named(tmp_path):
    (tmp_path / "file").write_text("")
    with raises(SmartsError, tmp_path / "file" / "a.png"), written_whole(tmp_path / "file" / "a.png"):
        pass


def test_two_that_write_one_file_do_not_mix(tmp_path):
    out = tmp_path / "film.gif"
    with written_whole(out) as first, written_whole(out) as second:
        assert first.name == second.name == out.name
        first.write_text("first")
        second.write_text("second")
    assert out.read_text() == "first"
    assert [*tmp_path.iterdir()] == [out]
