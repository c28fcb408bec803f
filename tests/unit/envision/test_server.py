import json
import os
import re
import shutil
import signal
import socket
import sys
import urllib.request

import pytest

from smarts.envision.episode_library import EpisodeLibrary
from smarts.envision.server import ViewServer
from smarts.errors import SmartsError
from smarts.stream.reading import CompactEpisode
from tests.commands import begin, finish, wait_for
from tests.compact_fixtures import FOLDER
from tests.raising import raises
from tests.viewers import PAGE, ask, serving


@pytest.fixture(scope="module")
def episodes(tmp_path_factory):
    folder = tmp_path_factory.mktemp("run")
    for name in ("intersection", "bubbles"):
        shutil.copy(FOLDER / f"{name}.smarts", folder)
    (folder / "damaged.smarts").write_bytes((FOLDER / "bubbles.smarts").read_bytes()[:40])
    (folder / "foreign.smarts").write_bytes(b"PAR1 <script>")
    return folder


@pytest.fixture(scope="module")
def server(episodes):
    with serving(EpisodeLibrary([episodes])) as running:
        yield running


@pytest.fixture(scope="module")
def guarded(episodes):
    with serving(EpisodeLibrary([episodes]), host="0.0.0.0", token="secret") as running:
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
    whole = entries["intersection"]
    assert whole["outcomes"] == {"goal": 4}
    assert (whole["agents"], whole["complete"], whole["seconds"]) == (4, True, pytest.approx(43.0))
    status, _, body = ask(server, f"/api/episodes/{whole['id']}")
    assert status == 200
    assert CompactEpisode(body).is_whole


@pytest.mark.parametrize("name", ["damaged", "foreign"])
def test_damaged_episodes_are_listed_with_their_errors(server, name):
    entry = listed(server)[name]
    assert entry["error"]
    status, _, body = ask(server, f"/api/episodes/{entry['id']}")
    assert status == 422
    assert json.loads(body)["error"] == entry["error"]
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


def test_nothing_can_be_changed(server):
    assert ask(server, "/api/episodes", method="POST")[0] == 405


@pytest.mark.parametrize("host", ["evil.example", "localhost.evil.example:80"])
def test_names_that_lead_to_loopback_are_refused(server, host):
    assert ask(server, "/api/episodes", host=host)[0] in (400, 421)


def test_pages_of_other_sites_are_refused(server):
    for origin, status in (("http://evil.example", 403), (f"http://127.0.0.1:{server.port}", 200)):
        assert ask(server, "/api/episodes", origin=origin)[0] == status


def test_elsewhere_a_token_is_needed(guarded):
    assert ask(guarded, "/")[0] == 200
    assert guarded.url.endswith("/#token=secret")
    for headers in ({}, {"authorization": "Bearer wrong"}, {"cookie": f"envision_{guarded.port}=secret"}):
        assert ask(guarded, "/api/episodes", **headers)[0] == 401
    assert ask(guarded, "/api/episodes", authorization="Bearer secret")[0] == 200


def test_the_token_is_exchanged_for_a_cookie(guarded):
    status, headers, _ = ask(guarded, "/api/token", method="POST", body=json.dumps({"token": "secret"}))
    assert status == 200
    cookie = headers["set-cookie"]
    assert re.search("httponly", cookie, re.IGNORECASE)
    assert re.search("samesite=strict", cookie, re.IGNORECASE)
    assert "secret" not in cookie
    assert ask(guarded, "/api/episodes", cookie=cookie.partition(";")[0])[0] == 200


@pytest.mark.parametrize("body", ["", '{"token": "é"}', "x" * 10**6])
def test_wrong_tokens_get_no_cookie(guarded, body):
    status, headers, _ = ask(guarded, "/api/token", method="POST", body=body.encode())
    assert status == 401
    assert "set-cookie" not in headers


def test_a_recording_that_comes_later_is_listed(tmp_path):
    shutil.copy(FOLDER / "bubbles.smarts", tmp_path / "first.smarts")
    library = EpisodeLibrary([tmp_path])
    before = {entry.label: entry.id for entry in library.entries()}
    shutil.copy(FOLDER / "intersection.smarts", tmp_path / "earlier.smarts")
    after = {entry.label: entry.id for entry in library.entries()}
    assert after.keys() == {"first", "earlier"}
    assert after["first"] == before["first"]


def test_the_same_test_episode_of_two_algorithms_has_two_ids(tmp_path):
    library = None
    for algorithm in ("ppo", "maac"):  # the second comes while the first is shown, and is listed before it
        run = tmp_path / algorithm / "intersection" / "none" / "seed_1"
        run.mkdir(parents=True)
        shutil.copy(FOLDER / "bubbles.smarts", run / "episode.smarts")
        (run / "run.json").write_text(json.dumps({"run": f"{algorithm}, intersection"}))
        library = library or EpisodeLibrary([tmp_path])
        shown = library.entries()
    assert len({entry.id for entry in shown}) == 2
    assert [library.path(entry.id).parts[-5] for entry in shown] == ["maac", "ppo"]
    assert len({EpisodeLibrary([library.path(entry.id)]).entries()[0].id for entry in shown}) == 2


def test_episodes_that_are_not_read_yet_are_listed_by_name_and_play(tmp_path):
    names = ["first", "second", "third", "zero"]
    for name in names:
        shutil.copy(FOLDER / "bubbles.smarts", tmp_path / f"{name}.smarts")
    library = EpisodeLibrary([tmp_path])
    for read in (1, 2):  # each list has one more, however long the search takes
        entries = library.entries(0)
        assert [entry.label for entry in entries] == names
        assert [entry.unread for entry in entries] == [False] * read + [True] * (4 - read)
    assert CompactEpisode(library.compact(entries[3].id)).is_whole
    assert not any(entry.unread for entry in library.entries())
    assert not any(entry.unread for entry in library.entries(0))


def test_folders_without_episodes_are_refused(tmp_path):
    for path in (tmp_path, tmp_path / "missing"):
        with pytest.raises(SmartsError, match=re.escape(str(path))):
            EpisodeLibrary([path])


def test_a_port_that_is_taken_is_refused():
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(SmartsError, match=str(port)):
            ViewServer(None, port=port, page=PAGE)


def test_an_address_of_no_machine_is_named_with_its_option():
    # RFC 2606: no machine has a name that ends in .invalid; RFC 5737: nor this address.
    for host in ("nohost.invalid", "192.0.2.1"):
        with raises(SmartsError, f"{host}:8081", values=["--host"]) as caught:
            ViewServer(None, host=host, page=PAGE)
        assert "--port" not in caught.value.remedy


@pytest.mark.parametrize("host", ["127.0.0.1", pytest.param("0.0.0.0", marks=pytest.mark.nightly)])
def test_the_browser_of_a_terminal_gets_the_page_but_no_token(episodes, tmp_path, host):
    shown, browser = tmp_path / "shown", tmp_path / "browser"
    load = f"import sys, urllib.request as u; open('{shown}', 'wb').write(u.urlopen(sys.argv[1]).read())"
    browser.write_text(f'#!/bin/sh\nexec {sys.executable} -c "{load}" "$1"\n')
    browser.chmod(0o755)
    options = "--port", "0", "--host", host
    command = begin("view", str(episodes), *options, env=os.environ | {"BROWSER": str(browser)})
    address = command.stdout.readline()
    port = re.search(r":(\d+)/", address)[1]
    if "token" in address:
        with urllib.request.urlopen(f"http://127.0.0.1:{port}/") as answer:
            assert answer.status == 200
    else:
        wait_for(lambda: shown.exists() and shown.stat().st_size, command)
    command.send_signal(signal.SIGINT)
    finish(command)
    assert shown.exists() == (host == "127.0.0.1")
