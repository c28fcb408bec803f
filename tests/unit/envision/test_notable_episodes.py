"""Which episodes of a run are shown, and the pages that show them."""

import base64
import json
import re

import pytest
from typer.testing import CliRunner

from benchmark.cli import app
from benchmark.report.writing import write_report
from smarts.envision import notable_episodes as notable
from smarts.envision import viewer_page
from smarts.envision.episode_library import Entry, EpisodeLibrary
from smarts.errors import SmartsError
from smarts.stream.reading import CompactEpisode
from smarts.types.events import Outcome
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


def test_where_all_arrive_there_is_no_worst():
    assert chosen(entry("a", goal=2), entry("b", 5.0, goal=2)) == {"best": "b"}
    assert chosen(entry("a", complete=False, goal=2)) == {}


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
    (folder / "run.json").write_text(
        json.dumps(json.loads((folder / "run.json").read_text()) | {"run": "ppo, intersection, none, seed 0"})
    )
    return folder


def embedded(page):
    """Return the compact episodes of a page by their labels."""
    found = re.findall(r'data-label="([^"]*)">([^<]*)</script>', page.read_text())
    return {label: CompactEpisode(base64.b64decode(data)) for label, data in found}


def test_a_run_as_one_page(run, tmp_path):
    out = tmp_path / "run.html"
    done = CliRunner().invoke(app, ["view", str(run), "--html", str(out)], catch_exceptions=False)
    assert done.exit_code == 0
    episodes = embedded(out)
    assert [label.partition(":")[0] for label in episodes] == ["best", "worst", "collision"]
    assert out.stat().st_size <= viewer_page.MOST_BYTES
    for each in episodes.values():
        assert each.is_whole
        assert each.facts["policy"] == "ppo"


def test_a_report_links_the_episodes(run):
    page = write_report(run.parents[3], episodes=True)
    links = re.findall(r'<a href="(episodes/[^"#]+)#e=(\w+)">([^<]+)</a>', page.read_text())
    assert [text.partition(":")[0] for _, _, text in links] == ["best", "worst", "collision"]
    for place, number, _ in links:
        assert f'data-id="{number}"' in (page.parent / place).read_text()
        assert f"]({place}#e={number})" in (page.parent / "report.md").read_text()
    # Another report takes its place, pages included.
    assert not (write_report(run.parents[3]).parent / "episodes").exists()


def test_what_is_too_much_for_a_page_goes_into_several(run, tmp_path, monkeypatch):
    library = EpisodeLibrary([run])
    episodes = notable.notable_episodes(library.entries())
    sizes = [viewer_page.room_of_page([notable._fitting(library, each)]) for each in episodes]
    for module in (notable, viewer_page):
        monkeypatch.setattr(module, "MOST_BYTES", max(sizes) + 100)
    pages = [page for _, page in notable.write_pages(library, episodes, tmp_path / "run.html")]
    assert [page.name for page in pages] == ["run.html", "run-2.html", "run-3.html"]
    assert all(page.stat().st_size <= max(sizes) + 100 for page in pages)


def test_a_long_episode_is_cut_to_its_last_part(run, monkeypatch):
    library = EpisodeLibrary([run])
    best = notable.notable_episodes(library.entries())[0]
    whole = viewer_page.room_of_page([notable._fitting(library, best)])
    monkeypatch.setattr(notable, "MOST_BYTES", whole - 100)
    part = notable._fitting(library, best)
    motion = CompactEpisode(part.data).motion
    assert viewer_page.room_of_page([part]) <= whole - 100
    assert 0 < motion.step.min() < motion.step.max() == 200
    monkeypatch.setattr(notable, "MOST_BYTES", 1000)
    with pytest.raises(SmartsError, match="MB"):
        notable._fitting(library, best)
