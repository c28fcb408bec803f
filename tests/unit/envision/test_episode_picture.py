"""Pictures of recorded episodes: marks are at the recorded positions, in every file format."""

import shutil

import av
import matplotlib.colors
import matplotlib.text
import numpy as np
import PIL.Image
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from typer.testing import CliRunner

from benchmark.cli import app
from smarts.envision.episode_picture import COLLISION, EpisodePicture
from smarts.envision.scenario_picture import ASPHALT, CAR, EGOS
from smarts.errors import SmartsError
from smarts.sim.episode_files import RecordedEpisode
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
    column, row = picture._axes.transData.transform((x, y))
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


def test_the_window_contains_starts_paths_and_goals(picture):
    low, high = picture._window()
    assert low.tolist() == [80.0, pytest.approx(1.6 - 30.0)]
    assert high.tolist() == [180.0, pytest.approx(1.6 + 30.0)]


@pytest.fixture(scope="module")
def crash(tmp_path_factory):
    """Return four agents side by side and behind each other, the first of which drives into the second."""
    folder = tmp_path_factory.mktemp("crash")
    cars = [(100.0, 0.0), (106.0, 0.0), (100.0, 3.2), (106.0, 3.2)]
    recording = Recording(folder, [Car(x, y, speed=10.0, mission=GOAL) for x, y in cars])
    recording.begin()
    for step in range(4):
        if step < 2:
            recording.world.vehicles.position[0, 0, 0] += 1.0
        if step == 1:
            recording.world.agents.state[0, 0] = AgentStatus.DONE
            recording.world.agents.outcome[0, 0] = Outcome.COLLISION
            recording.events.just_done[0, 0] = True
            recording.contacts.partner[0, 0] = 1
            recording.contacts.partner_generation[0, 0] = recording.world.vehicles.generation[0, 1]
        recording.step()
        if step == 1:
            recording.events.just_done[0, 0] = False
            recording.made.world.registry.dismiss(0, 0)
            recording.world.agents.state[0, 0], recording.world.agents.slot[0, 0] = AgentStatus.VACANT, -1
    return recording.read()


def boxes_of_texts(picture, step):
    """Return left, bottom, right and top of all texts in the picture of a step [pixels]."""
    boxes = []
    add = picture._figure.draw_artist

    def measured(artist):
        add(artist)
        if isinstance(artist, matplotlib.text.Text):
            frame = artist.get_bbox_patch()
            boxes.append((frame or artist).get_window_extent(picture._canvas.get_renderer()).extents)

    picture._figure.draw_artist = measured
    picture.image(step)
    picture._figure.draw_artist = add
    return np.array(boxes)


def test_texts_do_not_overlap(crash):
    picture = EpisodePicture(crash, pixels=320)
    width, height = picture._figure.bbox.size
    for step in (0, 2, 4):
        boxes = boxes_of_texts(picture, step)
        assert len(boxes) == 9  # the title, four lines and four labels
        for number, box in enumerate(boxes):
            assert (box[:2] >= 0).all()
            assert box[2] <= width
            assert box[3] <= height
            others = np.delete(boxes, number, 0)
            shared = np.minimum(box[2:], others[:, 2:]) - np.maximum(box[:2], others[:, :2])
            assert (shared <= 0).any(-1).all(), (step, number)


def test_collisions_are_marked_where_vehicles_touched(crash):
    picture = EpisodePicture(crash, pixels=1000)
    # Between the fronts and rears of cars of 4.5 m whose centres are at 102 m and 106 m.
    for step, is_marked in ((1, False), (2, True), (4, True)):
        found = colour_at(picture, picture.image(step), 104.0, 0.0)
        assert is_colour(found, COLLISION["mfc"]) == is_marked


def run(*arguments):
    return CliRunner().invoke(app, ["render", *map(str, arguments)])


def test_a_gif(episode, tmp_path):
    out = tmp_path / "new" / "film.gif"
    result = run(episode.folder, "--out", out, "--every", 4, "--begin", 0.2, "--speed", 2)
    assert result.exit_code == 0, result.output
    with PIL.Image.open(out) as film:
        # Steps 2, 6, 10, 14, 18 and the last, which stays.
        assert film.n_frames == 6
        assert film.info["duration"] == 200
        assert film.info["loop"] == 0
        assert film.size[0] == 900
    assert "film.gif: 6 frames, 0.2 to 2.0 s" in result.output


def test_a_gif_has_ten_pictures_a_second(episode, tmp_path):
    speed = 2
    out = tmp_path / "film.gif"
    assert run(episode.folder, "--out", out, "--width", 640, "--speed", speed).exit_code == 0
    shown = []
    with PIL.Image.open(out) as film:
        assert film.size[0] == 640
        for frame in range(film.n_frames):
            film.seek(frame)
            shown.append(film.info["duration"])
    # 2 s of real time; the last picture is shown for two more seconds.
    assert shown == [100] * (STEPS // speed) + [2100]


def test_damaged_and_missing_files_have_different_errors(episode, tmp_path):
    folder = tmp_path / "episode"
    shutil.copytree(episode.folder, folder)
    for content, message in (
        (None, "there is no table 'agents'"),
        (b"PAR1", "table 'agents' of the recorded"),
    ):
        (folder / "agents.parquet").unlink()
        if content is not None:
            (folder / "agents.parquet").write_bytes(content)
        assert message in str(run(folder, "--out", tmp_path / "a.png").exception)
        (folder / "agents.parquet").touch()
    shutil.copy(episode.folder / "agents.parquet", folder)
    missing = run(folder, "--out", tmp_path / "a.png").exception
    assert isinstance(missing, SmartsError)
    assert "the map of the episode is not there" in missing.problem
    assert missing.remedy.startswith("bring the file back")


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
        (("--out", "a.gif", "--begin", "1", "--end", "0.5"), "0.5"),
        (("--out", "a.gif", "--at", "1"), "--at"),
        (("--out", "a.png", "--begin", "0", "--every", "3"), "--every"),
    ],
)
def test_invalid_arguments_raise(episode, tmp_path, monkeypatch, arguments, value):
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.chdir(tmp_path)
    error = run(episode.folder, *arguments).exception
    assert isinstance(error, SmartsError)
    assert value in str(error)
    assert list(tmp_path.iterdir()) == []


def test_folders_without_an_episode_raise(episode, tmp_path):
    for folder in (tmp_path, tmp_path / "nowhere"):
        assert "no table 'episode'" in str(run(folder, "--out", tmp_path / "a.gif").exception)
    several = str(run(episode.folder.parent, "--out", tmp_path / "a.gif").exception)
    assert episode.folder.name in several


def test_names_with_dollars_are_no_formulas(episode, tmp_path):
    name = "bid_$x_$"
    shutil.copytree(episode.folder.parent, tmp_path / "store")
    folder = tmp_path / "store" / episode.folder.name
    for table, column in (("agents", "name"), ("episode", "scenario")):
        file = folder / f"{table}.parquet"
        rows = pq.read_table(file)
        names = pa.array([name] * rows.num_rows)
        pq.write_table(rows.set_column(rows.column_names.index(column), column, names), file)
    assert EpisodePicture(RecordedEpisode(folder)).image(3).shape[2] == 3
