"""The files of recordings."""

import numpy as np
import pyarrow.parquet as pq
import pytest

from smarts.recordings.tracks import SAMPLE, TRACKS, RecordingError, read_tracks, write_tracks
from smarts.types.vehicles import VehicleKind
from tests.tracks import straight, tracks_of


@pytest.fixture
def tracks():
    truck = straight("late", 1.0, 2.0, 5.0, 0.0, 8.0, kind=VehicleKind.TRUCK, length=12.5, width=2.5)
    return tracks_of([truck, ("early", [(0.0, 1.5, 2.0, 0.5, 4.0), (0.25, 2.5, 2.0, 0.5, 4.0)])])


def test_a_recording_is_read_as_it_was_written(tracks, tmp_path):
    write_tracks(tracks, tmp_path)
    read = read_tracks(tmp_path)
    assert read.names == ("early", "late")
    assert read.facts == tracks.facts
    for name in ("kind", "length", "width", "start", *SAMPLE):
        assert np.array_equal(getattr(read, name), getattr(tracks, name)), name


def test_tracks_are_split_at_gaps_of_more_than_three_time_steps():
    """One has a gap of 3 and one of 4 steps; of the other one, samples are left out for 5 steps."""
    own, other = straight("own", 0.0, 3.0, 0.0, 0.0, 10.0), straight("other", 0.0, 3.0, 0.0, 5.0, 10.0)
    own = own._replace(samples=np.delete(own.samples, [11, 12, 21, 22, 23], axis=0))
    tracks = tracks_of([own, other])
    keeps = (tracks.track == 0) | (tracks.t < 1.05) | (tracks.t > 1.45)
    found = {each.name: each.samples[[0, -1], 0] for each in tracks.of_samples(keeps).apart()}
    ends = {"own": [0, 2], "other": [0, 1], "other~2": [1.5, 3], "own~2": [2.4, 3]}
    assert {name: pytest.approx(each) for name, each in ends.items()} == found


def test_a_recording_of_another_version_is_refused(tracks, tmp_path):
    write_tracks(tracks, tmp_path)
    table = pq.read_table(tmp_path / TRACKS).replace_schema_metadata({"format": "smarts-recording 2"})
    pq.write_table(table, tmp_path / TRACKS)
    with pytest.raises(RecordingError, match="'smarts-recording 2'"):
        read_tracks(tmp_path)


def test_a_folder_without_a_recording_is_named(tmp_path):
    with pytest.raises(RecordingError, match=r"^\S*tracks\.parquet: there is no recording\n"):
        read_tracks(tmp_path)
