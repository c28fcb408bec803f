import json
import re
import socket

import pytest

from smarts.envision.episode_library import EpisodeLibrary
from smarts.envision.server import ViewServer
from smarts.errors import SmartsError
from smarts.types.events import Outcome
from tests.compact_reading import CompactEpisode
from tests.maps import straight
from tests.raising import raises
from tests.recordings import Drive, at_speed, record
from tests.viewers import PAGE, ask, serving


@pytest.fixture(scope="module")
def episodes(tmp_path_factory):
    folder = tmp_path_factory.mktemp("run")
    for name in ("whole", "damaged", "foreign"):
        recorded(folder, name)
    (folder / "damaged" / "agents.parquet").write_bytes(b"PAR1")
    (folder / "foreign" / "episode.parquet").write_bytes(b"PAR1 <script>")
    return folder


def recorded(folder, name):
    """Record an episode of two agents."""
    graph = straight(length=900.0)
    drives = [
        Drive([graph.lane_ids[0]], at_speed(2.0, 430, begin), agent=f"ego-{begin}", outcome=Outcome.GOAL)
        for begin in (10.0, 30.0)
    ]
    return record(folder, graph, drives, name)


@pytest.fixture(scope="module")
def server(episodes):
    with serving(EpisodeLibrary([episodes])) as running:
        yield running


def listed(server):
    return {each["label"]: each for each in json.loads(ask(server, "/api/episodes")[2])}


def test_the_page_allows_only_what_was_built(server):
    status, headers, body = ask(server, "/")
    assert (status, body.decode()) == (200, PAGE)
    policy = headers["content-security-policy"]
    assert policy.count("'sha256-") == 2
    assert "default-src 'none'" in policy
    assert "unsafe" not in policy
    assert headers["x-content-type-options"] == "nosniff"
    assert json.loads(ask(server, "/api/info")[2]) == {"live": False}


def test_episodes_are_listed_and_played(server):
    entries = listed(server)
    whole = entries["whole"]
    assert whole["outcomes"] == {"goal": 2}
    assert (whole["agents"], whole["complete"], whole["seconds"]) == (2, True, pytest.approx(43.0))
    status, _, body = ask(server, f"/api/episodes/{whole['id']}")
    assert status == 200
    assert CompactEpisode(body).is_whole


@pytest.mark.parametrize("name", ["damaged", "foreign"])
def test_damaged_episodes_are_listed_with_their_errors(server, name):
    entry = listed(server)[name]
    status, _, body = ask(server, f"/api/episodes/{entry['id']}")
    assert status == 422
    assert "damaged" in entry["error"]
    assert "damaged" in json.loads(body)["error"]
    assert ask(server, "/")[0] == 200


@pytest.mark.parametrize(
    "path",
    [
        "/api/episodes/000000000000",
        "/api/episodes/..%2f..%2fetc%2fpasswd",
        "/../etc/passwd",
    ],
)
def test_other_paths_are_not_found(server, path):
    assert ask(server, path)[0] == 404


@pytest.mark.parametrize("host", ["evil.example", "localhost.evil.example:80"])
def test_names_that_lead_to_loopback_are_refused(server, host):
    assert ask(server, "/api/episodes", host=host)[0] in (400, 421)


def test_pages_of_other_sites_are_refused(server):
    for origin, status in (("http://evil.example", 403), (f"http://127.0.0.1:{server.port}", 200)):
        assert ask(server, "/api/episodes", origin=origin)[0] == status


def test_a_recording_that_comes_later_is_listed(tmp_path):
    recorded(tmp_path, "first")
    library = EpisodeLibrary([tmp_path])
    assert [(entry.label, entry.unread) for entry in library.entries(0)] == [("first", True)]
    before = {entry.label: entry.id for entry in library.entries()}
    assert not library.entries(0)[0].unread
    recorded(tmp_path, "earlier")
    after = {entry.label: entry.id for entry in library.entries()}
    assert after.keys() == {"first", "earlier"}
    assert after["first"] == before["first"]


def test_the_same_test_episode_of_two_algorithms_has_two_ids(tmp_path):
    library = None
    for algorithm in ("ppo", "maac"):  # the second comes while the first is shown, and is listed before it
        run = tmp_path / algorithm / "intersection" / "none" / "seed_1"
        recorded(run, "episode")
        (run / "run.json").write_text(json.dumps({"run": f"{algorithm}, intersection"}))
        library = library or EpisodeLibrary([tmp_path])
        shown = library.entries()
    assert len({entry.id for entry in shown}) == 2
    assert [library.path(entry.id).parts[-5] for entry in shown] == ["maac", "ppo"]
    assert len({EpisodeLibrary([library.path(entry.id)]).entries()[0].id for entry in shown}) == 2


def test_folders_without_episodes_are_refused(tmp_path):
    for path in (tmp_path, tmp_path / "missing"):
        with pytest.raises(SmartsError, match=re.escape(str(path))):
            EpisodeLibrary([path])


def test_a_port_that_is_taken_is_refused():
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        with raises(SmartsError, f"127.0.0.1:{port}", values=["--port"]):
            ViewServer(None, port=port, page=PAGE)
