"""Hand-overs between SUMO and agents: none is lost, none jumps, and without one nothing changes."""

import numpy as np
import pytest

from perf.handover_errors import Tally
from perf.handover_safety import Safety
from perf.handovers import run_scenario


@pytest.mark.parametrize(
    "scenario",
    [
        "intersection",
        *(pytest.param(name, marks=pytest.mark.nightly) for name in ("roundabout", "on_ramp_merge")),
    ],
)
def test_hand_overs_lose_no_vehicle_and_make_none_jump(scenario, tmp_path):
    tally, safety = Tally(), Safety()
    made = run_scenario(scenario, "kinematic", 100, 3, tally, tmp_path, safety)
    assert made >= 100
    taken, released = (sum(map(len, tally.errors[what])) for what in ("take", "release"))
    assert taken + released == made
    assert sum(tally.ends.values()) == taken, "each hold ends in one way"
    assert set(tally.ends) <= {
        "released",
        "arrived",
        "removed: collision",
        "obstacle at the end",
        "active at the end",
        "leaving at the end",
    }
    along, across, heading, speed = np.concatenate(tally.errors["take"]).max(axis=0)
    assert along < 0.05
    assert across < 0.25
    assert speed < 0.8
    for what in ("release", "release, step after"):
        along, across, heading, speed = np.concatenate(tally.errors[what]).max(axis=0)
        assert across < 0.15, what
        assert heading < 0.05, what
        assert speed < 0.6, what
    assert 0.0 < max(watch.hardest for watch in safety.driven) < 0.5
