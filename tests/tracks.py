"""Recordings by hand."""

import numpy as np

from smarts.recordings.tracks import Track, Tracks
from smarts.types.vehicles import VehicleKind


def track_of(name, samples, kind=VehicleKind.PASSENGER, length=5.0, width=1.8):
    """Return a track with samples (t, x, y, heading, speed)."""
    return Track(name, kind, length, width, np.array(samples, float).reshape(-1, 5))


def tracks_of(tracks, **facts):
    """Return tracks of cars: (name, samples) each, or a `Track`."""
    made = [each if isinstance(each, Track) else track_of(*each) for each in tracks]
    known = {"name": "by-hand", "licence": "CC0", "time_step": "0.1", "is_traffic": "true"}
    return Tracks.of(made, known | {"duration": str(max(each.samples[-1, 0] for each in made))} | facts)


def straight(name, begin, end, x, y, speed, dt=0.1, **shape):
    """Return the track of a vehicle that drives east at constant speed from time `begin` to `end`."""
    t = np.linspace(begin, end, round((end - begin) / dt) + 1)
    zero = np.zeros_like(t)
    return track_of(
        name, np.column_stack([t, x + speed * (t - begin), y + zero, zero, speed + zero]), **shape
    )
