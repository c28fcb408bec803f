"""Which episodes of a run are shown, and the pages that show them."""

import base64
import json
import re
import shutil
from pathlib import Path

import pytest
from typer.testing import CliRunner

from benchmark.cli import app
from benchmark.report.writing import write_report
from smarts.envision import notable_episodes as notable
from smarts.envision.episode_library import Entry
from smarts.errors import SmartsError
from smarts.types.events import Outcome
from tests.compact_reading import CompactEpisode
from tests.hand_made_results import agent_episodes, write_experiment, write_run
from tests.maps import straight
from tests.recordings import Drive, at_speed, record


def entry(name, seconds=10.0, complete=True, **outcomes):
    agents = sum(outcomes.values())
    return Entry(
        name, name, "run", outcomes=outcomes, agents=agents, seconds=seconds, complete=complete, scenario="s"
    )


def chosen(*entries):
    return {each.why: each.entry.id for each in notable.notable_episodes(entries)}


def test_best_worst_and_each_other_kind_of_failure():
    entries = [
        entry("slow", 30.0, goal=4),
        entry("fast", 20.0, goal=4),
        entry("mixed", goal=2, off_road=1, collision=1),
        entry("crashes", goal=1, collision=3),
        entry("stands", goal=3, not_moving=1),
        entry("stand", goal=2, not_moving=2),
        entry("late", goal=3, time_out=1),
        entry("cut", complete=False, off_route=4),
    ]
    assert chosen(*entries) == {
        "best": "fast",
        "worst": "crashes",
        "off road": "mixed",
        "not moving": "stands",
        "time out": "late",
    }


def test_an_episode_is_shown_once_with_all_reasons():
    assert chosen(entry("only", goal=1, collision=3)) == {"best, worst": "only"}
    # Half of the agents arrive in each; the one that leaves the road takes less time.
    entries = [entry("crash", 12.0, goal=1, collision=1), entry("leaves", goal=1, off_road=1)]
    assert chosen(*entries) == {"best, off road": "leaves", "worst": "crash"}


def test_where_none_arrives_there_is_no_best():
    # The quickest crash is no success, and as bad as the other one.
    assert chosen(entry("late", 9.0, collision=4), entry("soon", 5.0, collision=4)) == {"collision": "soon"}
    assert chosen(entry("only", off_road=2)) == {"off road": "only"}
    stands = entry("stands", 60.0, time_out=4)
    assert chosen(stands, entry("crash", 1.0, collision=4)) == {"worst": "crash", "time out": "stands"}
    # Where nothing fails either, there is something to see all the same.
    assert chosen(entry("left", left_bubble=2)) == {"best": "left"}


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """Results of an experiment whose only run has three recorded test episodes."""
    root = tmp_path_factory.mktemp("results") / "small"
    write_experiment(root)
    outcomes = [["goal", "goal"], ["collision", "goal"], ["off_road", "off_road"]]
    write_run(root, "ppo", [agent_episodes(outcomes, mode="greedy")])
    (folder,) = root.glob("ppo/*/*/seed_*")
    graph = straight(length=900.0)
    for world, ends in enumerate(outcomes):
        drives = [
            Drive(
                [graph.lane_ids[0]],
                at_speed(2.0, 200, 10.0 + 20 * n),
                agent=f"ego-{n}",
                outcome=Outcome[end.upper()],
            )
            for n, end in enumerate(ends)
        ]
        record(folder / "episodes" / "greedy-straight", graph, drives, world=2_000_000 + world)
    facts = json.loads((folder / "run.json").read_text()) | {"run": "ppo, intersection, none, seed 0"}
    (folder / "run.json").write_text(json.dumps(facts))
    return folder


def embedded(page):
    """Return the compact episodes of a page by why they are shown."""
    found = re.findall(r'data-why="([^"]*)">([^<]*)</script>', page.read_text())
    return {why: CompactEpisode(base64.b64decode(data)) for why, data in found}


def test_a_run_as_one_page(run, tmp_path):
    out = tmp_path / "run.html"
    done = CliRunner().invoke(app, ["view", str(run), "--html", str(out)], catch_exceptions=False)
    assert done.exit_code == 0
    episodes = embedded(out)
    assert [*episodes] == ["best", "worst", "collision"]
    for each in episodes.values():
        assert each.is_whole
        assert each.facts["policy"] == "ppo"


def view(*arguments):
    return CliRunner().invoke(app, ["view", *map(str, arguments)])


def copied(run, tmp_path, *numbers):
    """Return copies of test episodes of a run, in a folder of their own."""
    there = sorted(path.parent for path in (run / "episodes").rglob("episode.parquet"))
    shutil.copytree(there[0].parent / "maps", tmp_path / "kept" / "maps")
    return [Path(shutil.copytree(there[number], tmp_path / "kept" / f"e{number}")) for number in numbers]


def test_a_folder_with_one_episode_is_that_episode(run, tmp_path):
    (only,) = copied(run, tmp_path, 1)
    out = tmp_path / "one.html"
    assert view(only.parent, "--html", out).exit_code == 0
    ((why, episode),) = embedded(out).items()
    assert (why, int(episode.facts["world"])) == ("", 2_000_001)


def test_damaged_episodes_are_left_out_and_named(run, tmp_path):
    good, bad = copied(run, tmp_path, 0, 2)
    (bad / "vehicles.parquet").write_bytes(b"PAR1")
    out = tmp_path / "page.html"
    done = view(good.parent, "--html", out)
    assert done.exit_code == 0, done.output
    assert len(re.findall(r"e2 is left out: .*damaged", done.output)) == 1, done.output
    assert [*embedded(out)] == ["best"]
    (good / "episode.parquet").write_bytes(b"PAR1")
    done = view(good.parent, "--html", out)
    assert isinstance(done.exception, SmartsError)
    assert "none of 2 episodes can be shown; e0: " in str(done.exception)


def test_a_report_plays_episodes(run, tmp_path):
    page = write_report(shutil.copytree(run.parents[3], tmp_path / "results"))
    shown = re.findall(r'data-episode="(\w+)"[^>]*>([^<]+)<', page.read_text())
    assert [why for _, why in shown] == ["Best", "Worst", "Collision"]
    viewer = tmp_path / "viewer.html"
    viewer.write_bytes(base64.b64decode(re.findall(r'id="viewer">([^<]+)<', page.read_text())[0]))
    assert [*embedded(viewer)] == ["best", "worst", "collision"]
