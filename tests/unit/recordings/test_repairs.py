"""Faults of recordings that are put right, put in by hand."""

from dataclasses import replace

import numpy as np
import pytest

from smarts.recordings.repairs import repaired
from tests.tracks import straight, track_of, tracks_of


def driven(turned=0.0, noise=0.0):
    """Return a vehicle at 10 m/s on a circle of 50 m, its headings turned by an angle [degrees]."""
    t = np.arange(0, 20, 0.2)
    heading = t * 10 / 50
    x, y = 50 * np.sin(heading), 50 - 50 * np.cos(heading)
    wrong = np.radians(turned) + noise * np.sin(7 * t)
    heading = np.angle(np.exp(1j * (heading + wrong)))
    return tracks_of([("a", np.column_stack([t, x, y, heading, 10 + 0 * t]))])


def test_headings_that_are_all_turned_are_turned_back():
    fixed, said = repaired(driven(turned=2.0))
    assert fixed.heading == pytest.approx(driven().heading, abs=np.radians(0.01))
    assert "+2.00 degrees" in said[0]


@pytest.mark.parametrize("tracks", [driven(turned=0.3), driven(turned=2.0, noise=0.1)])
def test_headings_that_prove_nothing_stay(tracks):
    fixed, said = repaired(tracks)
    assert not said
    assert np.array_equal(fixed.heading, tracks.heading)


def entering(share):
    """Return a vehicle at 15 m/s whose first way is a share of an interval's, and one that begins later."""
    t = 1 + 0.2 * np.arange(5)
    x = 15 * (t - t[0]) - 15 * 0.2 * (1 - share)
    x[0] = 0.0
    rows = np.column_stack([t, x, 0 * t, 0 * t, 15 + 0 * t])
    return tracks_of([("early", rows), straight("late", 1.1, 2.0, 0, 9, 5.0)])


@pytest.mark.parametrize("share", [0.2, 0.4, 0.6, 0.8])
def test_a_first_sample_gets_the_time_at_which_the_vehicle_was_there(share):
    fixed, said = repaired(entering(share))
    row = fixed.start[fixed.names.index("early")]
    assert fixed.t[row] == pytest.approx(1.2 - 0.2 * share)
    assert np.diff(fixed.x[row : row + 5]) == pytest.approx(15 * np.diff(fixed.t[row : row + 5]))
    assert "1 of 2 tracks" in said[0]
    assert (np.diff(fixed.t[fixed.start[:-1]]) >= 0).all()


def test_an_honest_start_stays():
    t = 0.2 * np.arange(6)
    speed = 2.5 + 8 * t  # full throttle
    rows = np.column_stack([t, 2.5 * t + 4 * t**2, 0 * t, 0 * t, speed])
    tracks = tracks_of([track_of("a", rows), straight("b", 0, 1, 0, 9, 15.0, dt=0.2)])
    assert repaired(tracks)[1] == []
    assert repaired(entering(1.0))[1] == []
    # Equal positions tell no time: both samples would have the same.
    assert repaired(entering(0.0))[1] == []
    # The speed column is wrong: the next interval does not agree with it either.
    assert repaired(replace(entering(0.4), speed=np.full(15, 30.0)))[1] == []
