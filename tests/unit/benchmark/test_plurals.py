"""Words with a number."""

from benchmark.results.plurals import counted, listed


def test_one_is_singular_and_all_else_plural():
    assert [counted(count, "seed") for count in (0, 1, 2)] == ["0 seeds", "1 seed", "2 seeds"]
    assert [listed("seed", each) for each in ([7], [1, 2])] == ["seed 7", "seeds 1, 2"]
