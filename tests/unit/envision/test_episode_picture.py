"""Pictures of recorded episodes: marks are at the recorded positions, in every file format."""

import av
import matplotlib.colors
import numpy as np
import PIL.Image
import pytest
from typer.testing import CliRunner

from benchmark.cli import app
from smarts.envision.episode_picture import COLLISION, EpisodePicture
from smarts.envision.scenario_picture import ASPHALT, CAR, EGOS
from smarts.errors import SmartsError
from smarts.types.agent_states import AgentStatus
from smarts.types.events import Outcome
from smarts.types.mission import AgentMission, GoalKind
from smarts.types.traffic import Signal
from tests.unit.sim.test_recorder_by_hand import Recording
from tests.worlds import Car

GOAL = AgentMission(route=("road",), goal=GoalKind.POSITION, goal_position=(160.0, 3.2))
STEPS = 20


@pytest.fixture(scope="module")
def episode(tmp_path_factory):
    """Return an agent that drives 1 m a step from x = 100 m for 15 steps, then collides; and a parked car."""
    folder = tmp_path_factory.mktemp("episodes")
    recording = Recording(folder, [Car(100.0, 0.0, speed=10.0, mission=GOAL), Car(130.0, 6.4)])
    recording.world.signals[0, 2] = Signal.STOP
    recording.begin()
    for step in range(STEPS):
        if step < 15:
            recording.world.vehicles.position[0, 0, 0] += 1.0
        if step == 14:
            recording.world.agents.state[0, 0] = AgentStatus.DONE
            recording.world.agents.outcome[0, 0] = Outcome.COLLISION
            recording.events.just_done[0, 0] = True
        recording.step()
        if step == 14:
            recording.events.just_done[0, 0] = False
            recording.made.world.registry.dismiss(0, 0)
            recording.world.agents.state[0, 0], recording.world.agents.slot[0, 0] = AgentStatus.VACANT, -1
    return recording.read()


@pytest.fixture(scope="module")
def picture(episode):
    return EpisodePicture(episode, pixels=1000)


def colour_at(picture, image, x, y):
    """Return the colour at a position on the map [m]."""
    column, row = picture._view.axes.transData.transform((x, y))
    return image[image.shape[0] - 1 - int(row), int(column)]


def is_colour(found, name):
    expected = np.array(matplotlib.colors.to_rgb(name)) * 255
    return np.abs(found - expected).max() < 3


def test_vehicles_are_drawn_at_their_positions(picture):
    for step in (0, 7, 14):
        image = picture.image(step)
        assert image.dtype == np.uint8
        assert is_colour(colour_at(picture, image, 100.0 + step, 0.3), EGOS[0])
        assert is_colour(colour_at(picture, image, 129.0, 6.0), CAR)
        assert is_colour(colour_at(picture, image, 140.0, 0.5), ASPHALT)
    # The road is visible before the vehicle arrives and after it has left.
    assert is_colour(colour_at(picture, picture.image(0), 115.0, 0.7), ASPHALT)
    assert is_colour(colour_at(picture, picture.image(16), 113.5, 0.7), ASPHALT)


def test_goal_and_lights(picture):
    image = picture.image(0)
    ring = [colour_at(picture, image, x, 3.2) for x in np.linspace(158.0, 162.0, 81)]
    assert any(is_colour(found, EGOS[0]) for found in ring)
    assert not is_colour(colour_at(picture, image, 160.0, 3.2), EGOS[0])


def test_collisions_are_marked_and_labels_say_what_the_ego_does(picture):
    for step, label in ((13, "0 10.0 m/s"), (15, "0 collision"), (20, "0 collision")):
        marked = is_colour(colour_at(picture, picture.image(step), 115.0, 0.0), COLLISION["mfc"])
        assert marked == (step >= 15)
        assert [text for text, *_ in picture.shown(step).labels] == [label]


def run(*arguments):
    return CliRunner().invoke(app, ["render", *map(str, arguments)])


def test_a_gif(episode, tmp_path):
    out = tmp_path / "new" / "film.gif"
    result = run(episode.folder, "--out", out, "--every", 4, "--begin", 0.2)
    assert result.exit_code == 0, result.output
    with PIL.Image.open(out) as film:
        # Steps 2, 6, 10, 14, 18 and the last, which stays.
        assert film.n_frames == 6
        shown = [film.info["duration"] for frame in range(6) if film.seek(frame) is None]
        assert shown == [400] * 5 + [2400]
        assert film.info["loop"] == 0
        assert film.size[0] == 900
    assert "film.gif: 6 frames, 0.2 to 2.0 s" in result.output


def test_a_png(episode, tmp_path):
    for arguments in ((), ("--at", 0.5, "--width", 400)):
        out = tmp_path / "moment.png"
        assert run(episode.folder, "--out", out, *arguments).exit_code == 0
    assert PIL.Image.open(out).size[0] == 400


def test_an_mp4_shows_all_frames(episode, tmp_path):
    out = tmp_path / "film.mp4"
    result = run(episode.folder, "--out", out, "--every", 10)
    assert result.exit_code == 0
    picture = EpisodePicture(episode)
    with av.open(str(out)) as film:
        stream = film.streams.video[0]
        frames = [frame.to_ndarray(format="rgb24") for frame in film.decode(stream)]
        assert stream.codec_context.name == "h264"
        assert stream.average_rate == 1
    # Steps 0 and 10 and the last, which is repeated for two more seconds.
    assert len(frames) == 5
    assert "film.mp4: 5 frames, 0.0 to 2.0 s" in result.output
    for frame, step in zip(frames, (0, 10, 20, 20, 20), strict=True):
        off = np.abs(frame.astype(int) - picture.image(step))
        # Colours have half of the resolution, so that thin lines are off.
        assert off.mean() < 4
        assert np.quantile(off, 0.9) <= 8


def test_a_film_that_cannot_be_written_leaves_nothing(episode, tmp_path, monkeypatch):
    def full(*arguments, **options):
        raise av.FFmpegError(28, "No space left on device")

    monkeypatch.setattr(av, "open", full)
    error = run(episode.folder, "--out", tmp_path / "film.mp4").exception
    assert isinstance(error, SmartsError)
    assert "No space left" in str(error)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("arguments", "value"),
    [
        (("--out", "film.webm"), ".webm"),
        (("--out", "a.png", "--at", "99"), "99"),
        (("--out", "a.gif", "--at", "0"), "--at"),
    ],
)
def test_invalid_arguments_raise(episode, tmp_path, monkeypatch, arguments, value):
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.chdir(tmp_path)
    error = run(episode.folder, *arguments).exception
    assert isinstance(error, SmartsError)
    assert value in str(error)
    assert list(tmp_path.iterdir()) == []
