"""A report's numbers, worked out by hand, and its files."""

import csv
import io
import re
import subprocess
import sys
from html.parser import HTMLParser

import numpy as np
import pandas as pd
import pytest
from PIL import Image

from algorithms.registry import ALGORITHMS
from benchmark.metrics import METRICS
from benchmark.report.content import make_report
from benchmark.report.curves import seeds_curve
from benchmark.report.latex import escaped
from benchmark.report.paper import is_non_inferior, printed
from benchmark.report.radar import axes_of_radar, draw_radar
from benchmark.report.style import colour, line, new_figure, png
from benchmark.report.wording import count, figures, intervals, mark, mark_meaning, printed_text
from benchmark.report.writing import write_report
from benchmark.results.files import ResultsError
from benchmark.results.reading import read_results
from tests.hand_made_results import ALONE, SOCIAL, agent_episodes, write_experiment, write_run

MIXED = [["goal", "goal"], ["goal", "collision"], ["goal", "goal"], ["collision", "goal"]]
"""6 of 8 agents arrive, 2 collide; episodes are as different as if agents were independent."""
PERFECT = [["goal", "goal"]] * 12
HOPELESS = [["collision", "collision"]] * 12
VOID_TAGS = {"meta", "link", "img", "br"}


def write_hand_made(root):
    """Three algorithms, one of them unfinished, and a reference; one column without any run."""
    write_experiment(
        root,
        algorithms=["ppo", "centralised_v", "maac"],
        traffic=[ALONE, SOCIAL],
        scripted=["keep_lane"],
        description="a < b & 5% of {x}_y",
    )
    behaviour = {"agility": 0.5, "arrivals": 1.0, "stability": 0.25, "stable_agents": 1.0}
    tables = [agent_episodes(MIXED, mode="greedy").assign(**behaviour)]
    tables.append(agent_episodes(HOPELESS[:4], mode="sampled"))
    held_out = agent_episodes(HOPELESS[:1], mode="greedy", split="held_out", variation="dense")
    lines = [
        [1, 500, 2.5, 200, -1.0, 0.25, 0.5, -0.5, 0.5, 0.25],
        [2, 1000, 5.0, 200, 0, 0.5, 0.25, "", "", ""],
    ]
    write_run(root, "ppo", [*tables, held_out], progress=lines)
    write_run(root, "centralised_v", [agent_episodes([*MIXED, ["invalid", "invalid"]], mode="greedy")])
    write_run(root, "maac", None, progress=lines[:1])
    write_run(root, "keep_lane", [agent_episodes(HOPELESS[:4], mode="scripted")], seed=-1)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    root = tmp_path_factory.mktemp("results") / "hand_made"
    write_hand_made(root)
    return write_report(root).parent


def cells_of(report, algorithm, mode="greedy"):
    rows = {row.algorithm: row.cells for row in report.main_table(mode)}
    return dict(zip(report.columns, rows[algorithm], strict=True))


def test_order_is_the_papers(tmp_path):
    write_experiment(
        tmp_path,
        algorithms=["a2c", "maddpg", "dqn"],
        tasks=["intersection", "two_way"],
        traffic=[SOCIAL, ALONE],
        scripted=["gap_acceptance", "parked"],
    )
    report = make_report(read_results(tmp_path))
    assert report.algorithms == ["dqn", "maddpg", "a2c"]
    assert [name for name, is_scripted in report.names if is_scripted] == ["gap_acceptance", "parked"]
    assert report.columns == [
        ("two_way", ALONE),
        ("intersection", ALONE),
        ("two_way", SOCIAL),
        ("intersection", SOCIAL),
    ]


def test_a_cells_numbers(folder):
    report = make_report(read_results(folder.parent))
    cell = cells_of(report, "ppo")["intersection", ALONE]
    assert figures(cell) == "0.25 / 0.75"
    # Wilson at n = 8: (p + z^2/16) / (1 + z^2/8) -+ z / (1 + z^2/8) sqrt(p (1 - p) / 8 + z^2/256)
    assert intervals(cell) == "[0.07, 0.59] / [0.41, 0.93]"
    # Four test episodes are too few to be set against the paper's.
    assert (printed_text(cell.printed), mark(cell), cell.is_short) == ("0.1 / 0.07", "", True)
    assert count(cell) == "1 seed, 4 episodes; this checkpoint"
    assert (cell.completion.n, cell.completion.episodes, cell.completion.seeds) == (8, 4, 1)
    assert figures(cells_of(report, "ppo", "sampled")["intersection", ALONE]) == "1.00 / 0.00"
    reference = cells_of(report, "keep_lane", "sampled")["intersection", ALONE]
    assert (figures(reference), reference.printed, reference.rank) == ("1.00 / 0.00", (), None)
    missing = cells_of(report, "ppo")["intersection", SOCIAL]
    assert (figures(missing), missing.is_non_inferior, printed_text(missing.printed)) == (
        "",
        None,
        "0.5 / 0.45",
    )


def test_generalization_has_its_raw_pairs(folder):
    report = make_report(read_results(folder.parent))
    name, task, traffic, found = next(report.generalization())
    assert (name, task, traffic) == ("ppo", "intersection", ALONE)
    # Both rates fall from 0.75 to 0.
    assert found.value == 0.25
    assert (found.terms["train_completion"], found.terms["held_out_completion"]) == (0.75, 0.0)


def test_non_inferior_to_the_paper():
    cells = printed("maddpg", "intersection", ALONE)
    # Wilson's bounds of 0 and 40 of 40: z^2 / (40 + z^2) = 0.0876.
    assert is_non_inferior(cells, 0.087, 0.913)
    assert not is_non_inferior(cells, 0.088, 1.0)
    assert not is_non_inferior(cells, 0.0, 0.912)
    assert is_non_inferior((), 0.0, 1.0) is None
    both = printed("commnet", "double_merge", ALONE)
    assert printed_text(both) == "0.46 / 0.45 (main text 0.7 / 0.25)"
    assert not is_non_inferior(both, 0.7, 0.25)
    assert printed("commnet", "double_merge", SOCIAL)[0].completion == 0.5


def test_marks_on_enough_episodes(tmp_path):
    write_experiment(tmp_path, algorithms=["ppo", "commnet"])
    write_run(tmp_path, "ppo", [agent_episodes(PERFECT[:1] * 200, mode="greedy")])
    mixed = [*HOPELESS[:1] * 50, *PERFECT[:1] * 150]
    write_run(tmp_path, "commnet", [agent_episodes(mixed, mode="greedy")])
    report = make_report(read_results(tmp_path))
    assert mark(cells_of(report, "ppo")["intersection", ALONE]) == "non-inferior"
    # Wilson of 0.1 and 0.07 of 40: up to 0.2305, from 0.0233.
    assert mark_meaning(cells_of(report, "ppo")["intersection", ALONE]) == (
        "Non-inferior: collision up to 0.230 and completion from 0.024"
    )


def test_no_two_algorithms_look_alike():
    looks = [(line(name)["color"], str(line(name)["linestyle"])) for name in ALGORITHMS]
    assert len({*looks}) == len(looks) > 12


def test_pictures_have_the_colours_of_the_lines():
    figure = new_figure(3, 2)
    axes = figure.add_subplot()
    for number, name in enumerate(ALGORITHMS):
        axes.axhline(number, color=colour(name), linewidth=3)
    picture = Image.open(io.BytesIO(png(figure))).convert("RGB")
    seen = {shade for _, shade in picture.getcolors(1 << 20)}
    assert {to_rgb(colour(name)) for name in ALGORITHMS} <= seen


def to_rgb(text):
    return tuple(bytes.fromhex(text[1:]))


def test_ranks_and_ties(tmp_path):
    write_experiment(tmp_path, algorithms=["dqn", "ppo", "maac"], scripted=["parked"])
    for name, outcomes in (("dqn", PERFECT), ("ppo", HOPELESS), ("maac", PERFECT)):
        write_run(tmp_path, name, [agent_episodes(outcomes, mode="greedy")])
    write_run(tmp_path, "parked", [agent_episodes(HOPELESS, mode="scripted")], seed=-1)
    report = make_report(read_results(tmp_path))
    ranks = {}
    for row in report.main_table("greedy"):
        ranks[row.algorithm] = (row.cells[0].rank, row.cells[0].is_tied, row.cells[0].is_best)
    assert ranks == {
        "dqn": (1, True, True),
        "ppo": (3, False, False),
        "maac": (1, True, True),
        "parked": (None, False, False),
    }
    pairs = {
        (row["first"], row["second"]): row["wins"] for row in report.differences["greedy"].to_dict("records")
    }
    assert pairs["dqn", "parked"] == "dqn"
    assert pairs["dqn", "maac"] == ""


def page_of(folder):
    """Return the page's tags with their attributes, and its text by tag; fails if tags are not closed."""

    class Parser(HTMLParser):
        def __init__(self):
            super().__init__()
            self.open, self.tags, self.texts = [], [], []

        def handle_starttag(self, tag, attrs):
            self.tags.append((tag, dict(attrs)))
            if tag not in VOID_TAGS:
                self.open.append(tag)

        def handle_endtag(self, tag):
            assert self.open.pop() == tag

        def handle_data(self, data):
            self.texts.append((self.open[-1] if self.open else "", data))

    parser = Parser()
    parser.feed((folder / "report.html").read_text())
    parser.close()
    assert not parser.open
    return parser


def test_the_page_needs_nothing_else(folder):
    page = page_of(folder)
    for tag, attributes in page.tags:
        for name in ("src", "href", "srcset", "data", "action"):
            address = attributes.get(name) or ""
            assert address == "" or address.startswith(("data:", "#")), (tag, address)
        assert tag not in {"iframe", "object", "embed", "base"}
    own = "".join(text for tag, text in page.texts if tag in {"style", "script"})
    assert not re.search(r"@import|url\(|https?:|fetch\(|XMLHttp", own)
    targets = {attributes["id"] for _, attributes in page.tags if "id" in attributes}
    links = {attributes["href"][1:] for tag, attributes in page.tags if tag == "a"}
    assert links <= targets
    assert {f"metric-{name}" for name in METRICS} <= targets
    heads = [attributes for tag, attributes in page.tags if tag == "th" and "data-column" in attributes]
    assert heads
    assert all(attributes["title"] for attributes in heads)


def test_the_page_says_what_is_missing(folder):
    text = " ".join(text for _, text in page_of(folder).texts)
    assert "a < b & 5% of {x}_y" in text
    assert f"maac, intersection, {ALONE}, seed 1: is not finished: training" in text
    assert f"ppo, intersection, {SOCIAL}, seed 1: has not begun" in text
    assert "1 were invalid" in text
    assert "Of centralised_v, MAAC, PPO: 3 of 8 runs are finished" in text
    assert "smarts-bench run hand.yaml" in text
    assert "abacus" in text
    assert "0123456789ab" in text


def test_page_text_and_table_have_the_same_numbers(folder):
    rows = csv.DictReader(io.StringIO((folder / "values.csv").read_text()))
    values = {(row["algorithm"], row["mode"], row["metric"]): row for row in rows}
    pair = [float(values["ppo", "greedy", name]["value"]) for name in ("collision_rate", "completion_rate")]
    bounds = [
        float(values["ppo", "greedy", name][end])
        for name in ("collision_rate", "completion_rate")
        for end in ("low", "high")
    ]
    shown = "{:.2f} / {:.2f}".format(*pair)
    interval = "[{:.2f}, {:.2f}] / [{:.2f}, {:.2f}]".format(*bounds)
    markdown = (folder / "report.md").read_text()
    line = next(line for line in markdown.splitlines() if line.startswith("| PPO |"))
    latex = (folder / "main_table_greedy.tex").read_text()
    texts = [text for _, text in page_of(folder).texts]
    assert shown in line
    assert interval in line
    assert rf"PPO & \textbf{{{shown}}} & --" in latex
    assert interval in latex
    assert shown in texts
    assert interval in texts


def test_not_available_has_its_reason_and_no_number(folder):
    rows = csv.DictReader(io.StringIO((folder / "values.csv").read_text()))
    found = {row["metric"]: row for row in rows if (row["algorithm"], row["mode"]) == ("ppo", "greedy")}
    assert (found["cut_in_ratio"]["value"], found["cut_in_ratio"]["low"]) == ("", "")
    assert found["cut_in_ratio"]["note"] == "n/a: no lane change was completed"
    assert found["agility"]["value"] == "0.5"
    markdown = (folder / "report.md").read_text()
    line = next(line for line in markdown.splitlines() if line.startswith("| Cut-in ratio |"))
    number = re.search(r"n/a \((\d+)\)", line)[1]
    assert f"{number}. n/a: no lane change was completed" in markdown
    assert "n/a: no lane change was completed" in [text for _, text in page_of(folder).texts]


def test_latex_prints_names_as_they_are(folder):
    latex = (folder / "main_table_greedy.tex").read_text()
    assert r"centralised\_v" in latex
    assert not re.search(r"(?<!\\)_", latex)
    assert latex.count("{") == latex.count("}")
    rows = [line for line in latex.splitlines() if line.endswith(r"\\")]
    assert {len(re.findall(r"(?<!\\)&", line)) for line in rows[1:]} == {2}
    assert escaped("50%_{\\") == r"50\%\_\{\textbackslash{}"


def test_pictures_are_pictures(folder):
    for name in ("radar", "learning_curves", "outcomes"):
        assert (folder / f"{name}.png").read_bytes().startswith(b"\x89PNG")
        assert f"({name}.png)" in (folder / "report.md").read_text()


def test_what_cannot_be_measured_is_a_gap_in_the_radar(folder):
    report = make_report(read_results(folder.parent))
    axes = new_figure(3, 3).add_subplot(projection="polar")
    draw_radar(axes, report, "intersection", ALONE)
    line = {line.get_label(): line for line in axes.get_lines()}["PPO"]
    drawn = dict(zip(axes_of_radar(), line.get_ydata(), strict=False))
    assert (drawn["agility"], drawn["stability"]) == (0.5, 0.25)
    assert np.isnan(drawn["control_diversity"])
    assert axes.get_ylim() == (0.0, 1.0)


def test_curves_end_where_their_seeds_end():
    long = pd.DataFrame({"agent_steps": [0, 100], "return": [0.0, 1.0]})
    short = pd.DataFrame({"agent_steps": [0, 25, 50], "return": [1.0, np.nan, 0.0]})
    steps, rows = seeds_curve([long, short], "return")
    np.testing.assert_allclose(rows[0], steps / 100)
    np.testing.assert_allclose(rows[1], np.where(steps <= 50, 1 - steps / 50, np.nan))
    assert seeds_curve([], "return")[0].size == 0


def test_a_report_takes_the_place_of_a_report_and_of_nothing_else(tmp_path):
    """Nothing of the experiment is finished, either."""
    write_experiment(tmp_path / "results")
    out = tmp_path / "thesis"
    out.mkdir()
    (out / "chapter.tex").write_text("years of work")
    with pytest.raises(ResultsError, match=r"chapter\.tex"):
        write_report(tmp_path / "results", out)
    assert (out / "chapter.tex").read_text() == "years of work"
    old = tmp_path / "results" / "report" / "report.html"
    old.parent.mkdir()
    old.write_text("of last year")
    page = write_report(tmp_path / "results")
    assert page == old
    assert "0 of 1 runs are finished" in page.read_text()
    assert "no finished run" in (page.parent / "report.md").read_text()
    there = sorted(path.name for path in (tmp_path / "results").iterdir())
    assert there == ["command.json", "experiment.json", "report"]


@pytest.mark.slow
def test_the_command_needs_neither_simulator_nor_learners(tmp_path):
    write_experiment(tmp_path)
    write_run(tmp_path, "ppo", [agent_episodes(MIXED, mode="greedy")])
    program = (
        "import sys; from benchmark.cli import app\n"
        "app(['report', sys.argv[1]], standalone_mode=False)\n"
        "print(sorted({'torch', 'ray', 'libsumo', 'pybullet', 'gymnasium', 'smarts.env'} & set(sys.modules)))"
    )
    done = subprocess.run(
        [sys.executable, "-c", program, str(tmp_path)], capture_output=True, text=True, check=True
    )
    assert done.stdout.split("\n")[:2] == [str(tmp_path / "report" / "report.html"), "[]"]
