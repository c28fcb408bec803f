"""A report's numbers, worked out by hand, and its files."""

import csv
import io
import json
import re
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path
from xml.etree import ElementTree

import pytest

from benchmark.metrics import METRICS
from benchmark.report.against_paper import compare_with
from benchmark.report.content import make_report
from benchmark.report.html import main_table, pictures, report_text
from benchmark.report.marl_eval import marl_eval_json
from benchmark.report.paper import printed, task_differences, task_label
from benchmark.report.robustness import robustness_of
from benchmark.report.summary import summaries_of
from benchmark.report.tables import difference_notes
from benchmark.report.values import Value
from benchmark.report.wording import (
    COUNTERPARTS,
    TASK_DIFFERENCES,
    count,
    figures,
    intervals,
    mark,
    not_counted,
    printed_text,
    standing,
)
from benchmark.report.writing import differences_csv, write_report
from benchmark.results.files import ResultsError
from benchmark.results.reading import read_results
from tests.hand_made_results import ALONE, SOCIAL, agent_episodes, write_experiment, write_run, write_test

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
    write_test(root, "centralised_v", [*MIXED, ["invalid", "invalid"]])
    write_run(root, "maac", None, progress=lines[:1])
    write_test(root, "keep_lane", HOPELESS[:4])


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    root = tmp_path_factory.mktemp("results") / "hand_made"
    write_hand_made(root)
    return write_report(root).parent


def report_of(root):
    return make_report(read_results(root))


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
    report = report_of(tmp_path)
    assert report.algorithms == ["dqn", "maddpg", "a2c"]
    assert [name for name, is_scripted in report.names if is_scripted] == ["gap_acceptance", "parked"]
    assert report.columns == [
        ("two_way", ALONE),
        ("intersection", ALONE),
        ("two_way", SOCIAL),
        ("intersection", SOCIAL),
    ]


def test_scripted_policies_alone_have_a_report(tmp_path):
    write_experiment(tmp_path, algorithms=[], scripted=["keep_lane", "parked"])
    for name in ("keep_lane", "parked"):
        write_test(tmp_path, name, MIXED)
    latex = (write_report(tmp_path).parent / "main_table_scripted.tex").read_text()
    assert latex.count("0.25 / 0.75") == 2


def test_a_cells_numbers(folder):
    report = make_report(read_results(folder.parent))
    cell = cells_of(report, "ppo")["intersection", ALONE]
    assert figures(cell) == "0.25 / 0.75"
    # Wilson at n = 8: (p + z^2/16) / (1 + z^2/8) -+ z / (1 + z^2/8) sqrt(p (1 - p) / 8 + z^2/256)
    assert intervals(cell) == "[0.07, 0.59] / [0.41, 0.93]"
    # Far more arrive than in the paper, but of eight agents 2 collide.
    assert (printed_text(cell.printed), mark(cell)) == ("0.1 / 0.07", "undecided")
    assert count(cell) == "1 seed, 4 episodes; this checkpoint"
    assert (cell.completion.n, cell.completion.episodes, cell.completion.seeds) == (8, 4, 1)
    assert figures(cells_of(report, "ppo", "sampled")["intersection", ALONE]) == "1.00 / 0.00"
    reference = cells_of(report, "keep_lane", "sampled")["intersection", ALONE]
    assert (figures(reference), reference.printed, reference.standing.rank) == ("1.00 / 0.00", (), None)
    missing = cells_of(report, "ppo")["intersection", SOCIAL]
    assert (figures(missing), missing.comparison, printed_text(missing.printed)) == ("", None, "0.5 / 0.45")


def rate(value, low, high):
    """Return a rate with its interval."""
    return Value("", value, low, high, 0, 0.0, "", 0, 0, "", "")


class TestAgainstThePaper:
    """Words from both uncertainties; the paper's interval is Wilson's at n = 20."""

    def word(self, theirs, collision, completion, spread=0.0):
        """Return the word of two rates whose intervals reach as far as `spread` to both sides."""
        ours = tuple(rate(x, max(x - spread, 0.0), min(x + spread, 1.0)) for x in (collision, completion))
        found = compare_with(theirs, ours, ours)
        return found and found.word

    def test_the_interval_of_the_difference(self):
        # Wilson of 0 of 20: up to z^2 / (20 + z^2) = 0.1611; that of 20 of 20 is its mirror image.
        (theirs,) = printed("maddpg", "intersection", ALONE)
        ours = rate(0.1, 0.04, 0.2), rate(0.9, 0.8, 0.96)
        collision, completion = compare_with([theirs], ours, ours).gaps
        # 0.1 - hypot(0.06, 0.1611) and 0.1 + hypot(0.1, 0), and their mirror images.
        assert (collision.value, collision.low, collision.high) == pytest.approx(
            (0.1, -0.0719, 0.2), abs=1e-4
        )
        assert (completion.low, completion.high) == pytest.approx((-0.2, 0.0719), abs=1e-4)

    @pytest.mark.parametrize(
        ("collision", "completion", "spread", "word"),
        [
            pytest.param(0.0, 1.0, 0.0, "non-inferior", id="the same, surely"),
            # Against 0 and 1 only our own spread counts on the pessimistic side: 0.02 + 0.05.
            pytest.param(0.02, 0.98, 0.05, "non-inferior", id="within the margin"),
            pytest.param(0.03, 0.97, 0.05, "undecided", id="not surely within the margin"),
            pytest.param(0.0, 0.97, 0.05, "undecided", id="the weaker of two counts"),
            pytest.param(0.5, 0.5, 0.05, "worse", id="surely worse"),
        ],
    )
    def test_words_where_the_paper_is_perfect(self, collision, completion, spread, word):
        assert self.word(printed("maddpg", "intersection", ALONE), collision, completion, spread) == word

    def test_better_needs_both_figures(self):
        # 0.5 / 0.45; Wilson at n = 20 reaches 0.2 to each side.
        theirs = printed("ppo", "intersection", SOCIAL)
        assert self.word(theirs, 0.2, 0.75) == "better"
        assert self.word(theirs, 0.2, 0.62) == "non-inferior"
        assert self.word(theirs, 0.38, 0.75) == "non-inferior"

    def test_tasks_of_version_1_are_compared_with_the_papers_and_said_to_differ(self, tmp_path):
        tasks = ["intersection_v1", "double_merge_v1", "two_way_v1"]
        write_experiment(tmp_path, tasks=tasks)
        for task in tasks:
            write_test(tmp_path, "ppo", PERFECT, task=task)
        report = report_of(tmp_path)
        assert report.tasks == tasks[::-1]  # the paper's order
        for task in tasks:
            assert report.printed("ppo", task, ALONE) == printed("ppo", task.removesuffix("_v1"), ALONE) != ()
            assert task_label(task) == f"{task_label(task.removesuffix('_v1'))} v1"
        assert COUNTERPARTS in standing(report)
        assert "misprint" in not_counted(cells_of(report, "ppo")["intersection_v1", ALONE])

    def test_all_printed_variants_count(self):
        both = printed("commnet", "double_merge", ALONE)
        assert printed_text(both) == "0.46 / 0.45 (main text 0.7 / 0.25)"
        # Better than 0.7 / 0.25, but not than the other.
        assert self.word(both[1:], 0.4, 0.5) == "better"
        assert self.word(both, 0.4, 0.5) != "better"
        assert printed("commnet", "double_merge", SOCIAL)[0].completion == 0.5

    def test_a_cell_that_degenerate_driving_passes_does_not_count(self, tmp_path):
        # The paper's PPO has 0.1 / 0.07 here.
        write_experiment(tmp_path, algorithms=["ppo", "maddpg"], scripted=["parked", "random"])
        ends = {"ppo": "goal goal", "maddpg": "goal goal", "random": "goal time_out"}
        for name in (*ends, "parked", "keep_lane"):
            write_test(tmp_path, name, [ends.get(name, "not_moving not_moving").split()] * 200)
        report = report_of(tmp_path)
        cell = cells_of(report, "ppo")["intersection", ALONE]
        assert mark(cell) == "better"
        assert "random" in not_counted(cell)
        assert "misprint" in not_counted(cell)
        assert cells_of(report, "maddpg")["intersection", ALONE].counts
        _, first, left_out = standing(report)
        assert "1 of 1 conditions that count" in first
        assert "not counted: Intersection, No Social Vehicle: PPO (random passes" in left_out
        assert "MADDPG" not in left_out

    def test_a_cell_does_not_count_until_degenerate_driving_was_played_in_it(self, tmp_path):
        """Parked agents are not finished in one of two cells, and random driving was in another scenario."""
        write_experiment(tmp_path, algorithms=["maddpg", "maac"], traffic=[ALONE, SOCIAL])
        for traffic in (ALONE, SOCIAL):
            for name in ("maddpg", "maac", "random", "keep_lane", "parked"):
                if (name, traffic) != ("parked", SOCIAL):
                    ends = "goal" if name in ("maddpg", "maac") else "not_moving"
                    digest = "old" if (name, traffic) == ("random", SOCIAL) else "new"
                    given = {"traffic": traffic, "scenarios": {"intersection": digest}}
                    write_test(tmp_path, name, [[ends, ends]] * 200, **given)
        report = report_of(tmp_path)
        alone, social = cells_of(report, "maddpg").values()
        assert (alone.counts, social.counts) == (True, False)
        assert "random, parked" in social.reasons[0]
        assert not_counted(social).startswith("not counted: not known whether random, parked passes")


def test_ranks_and_ties(tmp_path):
    write_experiment(tmp_path, algorithms=["dqn", "ppo", "maac"], scripted=["parked"])
    for name, outcomes in (("dqn", PERFECT), ("ppo", HOPELESS), ("maac", PERFECT)):
        write_test(tmp_path, name, outcomes)
    write_test(tmp_path, "parked", HOPELESS)
    report = report_of(tmp_path)
    ranks = {}
    for row in report.main_table("greedy"):
        cell = row.cells[0]
        ranks[row.algorithm] = (cell.standing.rank, cell.standing.is_tied, cell.is_best)
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


@pytest.mark.parametrize(
    ("steps", "others"),
    [
        ((1000, 1060), {"ppo"}),
        ((500, 510), set()),
        ((500, 700), {"dqn", "ppo"}),
        ((500, 700, 710), {"dqn"}),
        ((1000, 1010, 700), {"maac"}),
        ((500, 700, 900), {"dqn", "ppo", "maac"}),
    ],
)
def test_usual_agent_steps_are_those_of_most_or_of_the_budget(tmp_path, steps, others):
    write_experiment(tmp_path, algorithms=["dqn", "ppo", "maac"][: len(steps)])
    for name, each in zip(("dqn", "ppo", "maac"), steps, strict=False):
        table = agent_episodes(PERFECT, mode="greedy")
        write_run(tmp_path, name, [table], progress=[[1, each, 10.0, 100, *[""] * 6]])
    report = report_of(tmp_path)
    assert {name for name, *_ in report.other_steps} == others
    assert any("No ranks" in line for line in standing(report)) == (len(others) == len(steps))


def test_runs_that_must_not_be_averaged_or_compared_do_not_count_and_are_marked(tmp_path):
    write_experiment(tmp_path, algorithms=["dqn", "ppo", "maac"], seeds=[1, 2])
    for name in ("dqn", "ppo", "maac"):
        write_test(tmp_path, name, PERFECT)
    small = {"agent_steps": 100, "minutes": None}
    write_test(tmp_path, "dqn", PERFECT, seed=2, budget=small)
    reason = "seeds were not trained alike"
    report = report_of(tmp_path)
    cells = {row.algorithm: row.cells[0] for row in report.main_table("greedy")}
    assert {name: (cell.unlike, cell.standing.rank) for name, cell in cells.items()} == {
        **{"dqn": (reason, None), "ppo": ("", 1), "maac": ("", 1)}
    }
    assert not cells["dqn"].counts
    assert count(cells["dqn"]).endswith(f"; {reason}")
    latex = main_table(report, "greedy")
    assert f"{reason})}}" in latex
    assert "% dqn, intersection, no_social_vehicles, seed 2 was not trained like seed 1" in latex
    is_noted = report.values["note"].str.endswith(reason)
    assert {*report.values[is_noted]["algorithm"]} == {"dqn"}


def test_only_runs_of_one_protocol_that_may_be_compared_are(tmp_path):
    """DQN's seeds were trained apart, Net-Q with another budget: neither has a pair, Holm's family is 2."""
    write_experiment(tmp_path, algorithms=["dqn", "ppo", "maac", "networked_q"], scripted=["parked"])
    small = {"agent_steps": 100, "minutes": None}
    half = [["goal", "goal"], ["collision", "collision"]] * 3
    for name, outcomes in (("dqn", HOPELESS[:6]), ("ppo", PERFECT[:6]), ("maac", half)):
        write_test(tmp_path, name, outcomes)
    write_test(tmp_path, "dqn", HOPELESS[:6], seed=2, budget=small)
    write_test(tmp_path, "networked_q", HOPELESS[:6], budget=small)
    write_test(tmp_path, "parked", HOPELESS[:6])
    report = report_of(tmp_path)
    rows = [*csv.DictReader(io.StringIO(differences_csv(report)))]
    pairs = [(row["first"], row["second"]) for row in rows]
    assert {*pairs} == {("maac", "ppo"), *(("maac", "parked"), ("networked_q", "parked"), ("parked", "ppo"))}
    assert len(pairs) == 8
    for row in rows[pairs.index(("maac", "ppo")) :][:1]:
        assert float(row["corrected"]) == pytest.approx(2 * float(row["p_value"]), rel=1e-4)
    place = "Intersection, No Social Vehicle"
    assert difference_notes(report)[-2:] == [
        f"Left out, since seeds were not trained alike: DQN in {place}.",
        f"Pairs of different protocols are left out in {place}.",
    ]


def test_the_scenario_of_most_runs_is_compared(tmp_path):
    write_experiment(tmp_path, algorithms=["dqn", "ppo", "maac"], scripted=["parked"])
    for name, digest in (("dqn", "new"), ("ppo", "new"), ("maac", "old"), ("parked", "older")):
        write_test(tmp_path, name, PERFECT, scenarios={"intersection": digest})
    cells = [row.cells[0] for row in report_of(tmp_path).main_table("greedy")]
    reason = "scenarios differ between runs"
    assert [(cell.unlike, cell.standing.rank) for cell in cells] == [
        *[("", 1), ("", 1)],
        *[(reason, None), (reason, None)],
    ]


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
    assert f"maac, seed 1, intersection, {ALONE}: not finished: training" in text
    assert f"ppo, seed 1, intersection, {SOCIAL}: not begun" in text
    assert "1 episode in which vehicles overlapped at the start: discarded." in text
    assert "centralised_v, MAAC, PPO: 2 of 6 runs finished, 13 test episodes measured." in text
    assert "Scripted policies: 1 of 2 runs finished, 4 test episodes measured." in text
    assert "smarts-bench run hand.yaml" in text
    assert "abacus" in text
    assert "0123456789ab" in text


def test_differences_from_the_papers_tasks_are_the_table_of_the_documents():
    lines = [f"| {' | '.join(row)} |" for row in (TASK_DIFFERENCES, *task_differences())]
    lines.insert(1, "| :-- | :-- | :-- |")
    assert "\n".join(lines) in (Path(__file__).parents[3] / "docs/guide/benchmark_v1.md").read_text()


def test_a_report_holds_no_html_of_names_and_descriptions(tmp_path):
    html = "<script>alert(1)</script> <img src=x> <!-- &lt;b&gt;"
    write_experiment(tmp_path, description=html)
    write_test(tmp_path, "ppo", PERFECT)
    folder = write_report(tmp_path).parent
    for name in ("report.html", "report.md"):
        text = (folder / name).read_text().replace("&gt;", ">")
        assert "&lt;script>alert(1)&lt;/script> &lt;img src=x> &lt;!-- &amp;lt;b&amp;gt;" in text
        assert not any(tag in text for tag in ("<script>alert", "<img src=x", "<!-- "))


def test_an_own_experiment_is_reported_without_a_word_on_the_paper(tmp_path):
    write_experiment(
        tmp_path, algorithms=["ppo"], tasks=["roundabout"], traffic=[SOCIAL], scripted=["keep_lane"]
    )
    for name in ("ppo", "keep_lane"):
        write_test(tmp_path, name, MIXED, task="roundabout", traffic=SOCIAL)
    report = report_of(tmp_path)
    assert not report.has_paper
    assert standing(report) == []
    text = report_text(report, summaries_of(report), (), robustness_of(report))
    assert "gainst the paper" not in text
    assert "the paper's figures" not in text


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


def test_pictures_are_pictures_that_need_nothing_else(folder):
    for name in ("radar", "radar_all", "learning_curves", "outcomes"):
        picture = ElementTree.parse(folder / f"{name}.svg").getroot()
        assert picture.tag == "{http://www.w3.org/2000/svg}svg"
        assert not re.search(r"href|url\(|@import", (folder / f"{name}.svg").read_text())
        assert f"({name}.svg)" in (folder / "report.md").read_text()


def test_a_report_takes_the_place_of_a_report_and_of_nothing_else(tmp_path):
    """Nothing of the experiment is finished, either."""
    write_experiment(tmp_path / "results")
    out = tmp_path / "thesis"
    out.mkdir()
    (out / "chapter.tex").write_text("years of work")
    with pytest.raises(ResultsError, match=r"chapter\.tex"):
        write_report(tmp_path / "results", out)
    assert (out / "chapter.tex").read_text() == "years of work"
    (out / "chapter.tex").rename(out / "values.csv")
    with pytest.raises(ResultsError, match=r"values\.csv"):
        write_report(tmp_path / "results", out)
    assert (out / "values.csv").read_text() == "years of work"
    old = tmp_path / "results" / "report" / "report.html"
    old.parent.mkdir()
    old.write_text("of last year")
    page = write_report(tmp_path / "results")
    assert page == old
    assert "PPO: 0 of 1 run finished, 0 test episodes measured." in page.read_text()
    assert "no finished run" in (page.parent / "report.md").read_text()
    there = sorted(path.name for path in (tmp_path / "results").iterdir())
    assert there == ["command.json", "report"]


def test_the_command_needs_neither_simulator_nor_learners(tmp_path):
    write_experiment(tmp_path)
    write_test(tmp_path, "ppo", MIXED)
    program = (
        "import sys; from benchmark.cli import app\n"
        "app(['report', sys.argv[1]], standalone_mode=False)\n"
        "print(sorted({'torch', 'ray', 'libsumo', 'pybullet', 'gymnasium', 'smarts.env'} & set(sys.modules)))"
    )
    done = subprocess.run(
        [sys.executable, "-c", program, str(tmp_path)], capture_output=True, text=True, check=True
    )
    assert done.stdout.split("\n")[:2] == [str(tmp_path / "report" / "report.html"), "[]"]


class TestSummaries:
    @pytest.fixture
    def report(self, tmp_path):
        """Two algorithms with two seeds in one cell, and one with a seed less."""
        write_experiment(tmp_path, algorithms=["ppo", "dqn", "maac"], seeds=[1, 2])
        for name, seed, goals in (("ppo", 1, 4), ("ppo", 2, 3), ("dqn", 1, 3), ("dqn", 2, 1), ("maac", 1, 4)):
            outcomes = [["goal", "goal"]] * goals + [["collision", "goal"]] * (4 - goals)
            lines = [
                [1, 500, 2.5, 200, 0.0, 0.5, 0.5, "", "", ""],
                [2, 1000, 5.0, 200, 0.0, 0.5, 0.5, 1, 0.5, 0.25],
            ]
            table = agent_episodes(outcomes, mode="greedy")
            write_run(tmp_path, name, [table], seed=seed, progress=lines)
        return report_of(tmp_path)

    def test_have_algorithms_with_equally_many_seeds(self, report):
        cell = cells_of(report, "ppo")["intersection", ALONE]
        assert count(cell) == "2 seeds, 8 episodes; these checkpoints"
        summaries = summaries_of(report)
        assert {name: values.tolist() for name, values in summaries.scores["completion"].items()} == {
            "dqn": [[7 / 8], [5 / 8]],
            "ppo": [[1.0], [7 / 8]],
            "maac": [[1.0]],
        }
        rows = {row[0]: row for row in summaries.mean_rows()}
        assert rows["PPO"][1].startswith("0.94 [")
        assert (rows["PPO"][3], rows["MAAC"][1]) == ("2 x 1", "1.00")
        improvement = {tuple(row[:2]): row[2] for row in summaries.improvement_rows()}
        # Of four pairs three are won and one is a tie.
        assert improvement["DQN", "PPO"].startswith("0.12 [")
        assert {text for pair, text in improvement.items() if "MAAC" in pair} == {"n/a: one seed"}
        for picture in pictures(report, summaries).values():
            ElementTree.fromstring(picture)

    def test_are_of_the_seeds_that_have_finished_all_cells(self, tmp_path):
        """PPO has a third seed in one cell; DQN has no seed that finished both."""
        write_experiment(tmp_path, algorithms=["ppo", "dqn"], traffic=[ALONE, SOCIAL], seeds=[1, 2, 3])
        for name, traffic, seed, goals in (
            *(("ppo", ALONE, seed, goals) for seed, goals in ((1, 4), (2, 3), (3, 0))),
            *(("ppo", SOCIAL, seed, goals) for seed, goals in ((1, 2), (2, 1))),
            *(("dqn", ALONE, 1, 4), ("dqn", SOCIAL, 2, 4)),
        ):
            outcomes = [["goal"]] * goals + [["collision"]] * (4 - goals)
            write_test(tmp_path, name, outcomes, traffic=traffic, seed=seed)
        summaries = summaries_of(report_of(tmp_path))
        found = {name: values.tolist() for name, values in summaries.scores["completion"].items()}
        assert found == {"ppo": [[1.0, 0.5], [0.75, 0.25]]}
        assert summaries.mean_rows()[0][3] == "2 x 2"

    def test_have_neither_runs_that_must_not_be_averaged_nor_pairs_of_different_protocols(self, tmp_path):
        write_experiment(tmp_path, algorithms=["ppo", "dqn", "maac"], seeds=[1, 2])
        small = {"agent_steps": 100, "minutes": None}
        large = {"agent_steps": 1000, "minutes": None}
        budgets = {"ppo": (large, large), "dqn": (large, small), "maac": (small, small)}
        for name, both in budgets.items():
            for seed, budget in enumerate(both, start=1):
                table = agent_episodes(PERFECT[:4], mode="greedy")
                write_run(tmp_path, name, [table], seed=seed, budget=budget)
        summaries = summaries_of(report_of(tmp_path))
        assert summaries.algorithms == ["ppo", "maac"]
        assert summaries.improvement_rows() == [["PPO", "MAAC", "n/a: different protocols"]]
        assert summaries.note.endswith(
            " Left out: DQN (Intersection, No Social Vehicle: seeds were not trained alike). "
            "Of different protocols, and not to be compared: PPO and MAAC."
        )

    def test_marl_eval_has_validations_and_episodes(self, report):
        found = json.loads(marl_eval_json(report.results, "greedy"))
        run = found["smarts_bench"][f"intersection, {ALONE}"]["dqn"]["seed_2"]
        assert run["step_0"] == {
            "step_count": 1000,
            "elapsed_time": 5.0,
            "return": [1.0],
            "completion_rate": [0.5],
            "collision_rate": [0.25],
        }
        assert "step_1" not in run
        assert run["absolute_metrics"]["completion_rate"] == [1.0, 0.5, 0.5, 0.5]
        assert run["absolute_metrics"]["collision_rate"] == [0.0, 0.5, 0.5, 0.5]
