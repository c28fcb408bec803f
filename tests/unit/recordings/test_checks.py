"""What is implausible in recordings, each with a neighbour that is not."""

import numpy as np
import pytest

from smarts.recordings.checks import check
from smarts.recordings.reading import Source, read
from smarts.recordings.repairs import repaired
from tests import maps
from tests.recording_files import DATA, needs_data
from tests.tracks import straight, track_of, tracks_of


def found(*tracks, roads=None):
    report = check(tracks_of(tracks, time_step="0.1"), roads)
    return {each.kind: each.text for each in report.findings}


def cruising(name="a", y=0.0, begin=0.0):
    return straight(name, begin, begin + 3.0, 0.0, y, 10.0)


def braking(deceleration):
    t = np.arange(0, 3, 0.1)
    braked = np.clip(t - 1, 0, 1)
    x = 20 * t - deceleration * braked**2 / 2 - deceleration * braked * np.clip(t - 2, 0, None)
    return track_of("a", np.column_stack([t, x, 0 * t, 0 * t, 20 - deceleration * braked]))


def bend(radius):
    t = np.arange(0, 3, 0.1)
    angle = 10 * t / radius
    x, y = radius * np.sin(angle), radius - radius * np.cos(angle)
    return track_of("a", np.column_stack([t, x, y, np.angle(np.exp(1j * angle)), 10 + 0 * t]))


def with_speed(error):
    samples = cruising().samples.copy()
    samples[:, 4] += error
    return track_of("a", samples)


CASES = {
    "overlaps": ([cruising(), cruising("b", y=1.6)], [cruising(), cruising("b", y=1.75)], "a and b at 0 s"),
    "accelerations": ([braking(9.0)], [braking(7.5)], "a 9.0 m/s^2"),
    "turns": ([bend(11.0)], [bend(13.0)], "a 8.9 m/s^2"),
    "speeds unlike positions": ([with_speed(2.5)], [with_speed(-1.5)], "a by 2.5 m/s"),
}


@pytest.mark.parametrize("kind", CASES)
def test_what_is_implausible_is_found(kind):
    bad, good, text = CASES[kind]
    assert text in found(*bad)["accelerations" if kind == "turns" else kind]
    assert found(*good) == {}


def test_tracks_that_all_begin_in_one_place_are_not_traffic():
    piled = [straight(str(each), 0.0, 2.0, 0.5 * each, 0.0, 10.0) for each in range(4)]
    text = found(*piled, cruising("z", y=20, begin=1.0))["not traffic"]
    assert "4 of 5 tracks begin at 0 s" in text
    apart = [straight(str(each), 0.0, 2.0, 20.0 * each, 0.0, 10.0) for each in range(5)]
    assert found(*apart) == {}


@pytest.mark.parametrize("digits", [3, 9])
def test_frames_of_30_hz_are_those_of_the_file(tmp_path, digits):
    """A car at 10 m/s comes up to one that stands 245 m ahead: they overlap when 240.1 m are driven."""
    rows = ""
    for frame in range(1800):
        vehicle = '<vehicle id="{}" x="{}" y="0" angle="90" speed="{}" type="car"/>'
        cars = vehicle.format("a", frame / 3, 10) + vehicle.format("b", 245, 0)
        rows += f'<timestep time="{frame / 30:.{digits}f}">{cars}</timestep>'
    file = tmp_path / "x.xml"
    file.write_text(f"<fcd-export>{rows}</fcd-export>")
    report = check(read(Source(file)))
    assert "2.0 at once" in report.contents
    text = next(each.text for each in report.findings if each.kind == "overlaps")
    assert float(text.split()[-2]) == pytest.approx(24.03, abs=0.01)


def test_tracks_off_the_map_are_found():
    """Lanes are 3.2 m wide: a centre 1.5 m beside the centreline is on the lane, one of 1.7 m is not."""
    beside = straight("beside", 0.0, 2.0, 10.0, -1.7, 10.0)
    tracks = tracks_of([straight("on", 0.0, 2.0, 30.0, -1.5, 10.0), beside], time_step="0.1")
    report = check(tracks, maps.straight(1))
    assert report.on_lanes == 0.5
    assert [each.text for each in report.findings if each.kind == "off the map"] == [
        "1 track: beside 100% of its samples"
    ]


@needs_data
def test_real_recordings():
    west, said = repaired(read(Source(DATA / "mona" / "DEU_MONAWest-2_1_T-300.xml")))
    report = check(west)
    assert report.is_traffic
    assert "88 enter" in report.contents
    assert "27 at most" in report.contents
    assert len(west) == len(west.of_samples(np.ones(len(west.t), bool)))  # without gaps
    assert not {"overlaps", "accelerations"} & {each.kind for each in report.findings}
    assert "+1.93 degrees" in said[0]
    assert "73 of 100 tracks" in said[1]
    report = check(read(Source(DATA / "ngsim" / "i80_0400-0415_200.shf")))
    assert not report.is_traffic
    assert "200 of 200 tracks begin at 0 s" in report.findings[0].text
