"""Calls in processes of their own: what comes back, what a failure says, what is left."""

import operator
import os

import pytest
import ray

from benchmark.experiment.models import Resources
from benchmark.results.files import ResultsError
from benchmark.running.cluster import start_ray
from benchmark.running.side_by_side import side_by_side
from benchmark.running.submissions import submitted
from benchmark.running.verifying import verify
from tests.blocks import ROOT
from tests.raising import raises


def test_one_at_a_time_is_in_this_process_and_in_order():
    assert [*side_by_side(os.getpid, [()] * 3, 1)] == [(k, os.getpid()) for k in range(3)]
    assert [*side_by_side(os.getpid, [()])] == [(0, os.getpid())]
    assert not [*side_by_side(os.getpid, [])]


@pytest.fixture(scope="module")
def _rays():
    """Let all calls of the module be in one Ray; each would start its own."""
    start_ray(Resources())
    yield
    ray.shutdown()


@pytest.mark.usefixtures("_rays")
def test_an_error_of_a_call_is_raised_as_it_is_and_a_lost_process_is_named():
    with pytest.raises(ZeroDivisionError):
        [*side_by_side(operator.floordiv, [(1, 1), (1, 0), (1, 1)], 2)]
    with raises(ResultsError, values=["lost", "--parallel 1"]):
        [*side_by_side(os._exit, [(1,), (1,)], 2)]


@pytest.mark.nightly
def test_policies_of_a_release_are_played_side_by_side(tmp_path):
    manifest, folder = submitted(str(ROOT / "results" / "release_v1"))
    of_dqn = [e for e in manifest.policies if e.agent.startswith("policies/dqn_two_way_v1")]
    manifest = manifest.model_copy(update={"policies": of_dqn})
    given = {"episodes": 2, "fresh": 1}
    one, two = (
        [*verify(manifest, folder, tmp_path / str(parallel), parallel=parallel, **given)]
        for parallel in (1, 2)
    )
    assert len(one) == len(manifest.policies) > 1
    for alone, beside in zip(one, two, strict=True):
        assert (str(alone), alone.scores, alone.reasons) == (str(beside), beside.scores, beside.reasons)
        assert beside.digests == [2, 2]
