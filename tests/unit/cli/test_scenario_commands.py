"""`smarts-bench scenario ...` as a user meets it."""

import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from matplotlib.image import imread

from benchmark.cli import main

TINY = {
    "map.nod.xml": """<nodes>
        <node id="a" x="0" y="0"/><node id="b" x="200" y="0"/><node id="c" x="400" y="40"/></nodes>""",
    "map.edg.xml": """<edges>
        <edge id="first" from="a" to="b" numLanes="2" speed="13.9"/>
        <edge id="second" from="b" to="c" numLanes="2" speed="13.9"/></edges>""",
    "scenario.py": """
from pathlib import Path
from smarts.sstudio import gen_scenario, types as t
route = t.Route(begin=("first", 0, 5), end=("second", 1, "max"))
flow = t.Flow(route=route, rate=1200, actors={t.TrafficActor("car"): 1.0})
gen_scenario(
    t.Scenario(ego_missions=[t.Mission(route)], traffic={"busy": t.Traffic(flows=[flow])}),
    output_dir=Path(__file__).parent,
)
""",
}


@pytest.fixture
def tiny(tmp_path):
    folder = tmp_path / "tiny"
    folder.mkdir()
    for name, text in TINY.items():
        (folder / name).write_text(text)
    return folder


@pytest.fixture
def smarts_bench(monkeypatch, capfd):
    """Return a function that runs a command line in this process."""
    monkeypatch.setenv("COLUMNS", "200")

    def run(*arguments, cwd="."):
        monkeypatch.setattr(sys, "argv", ["smarts-bench", *map(str, arguments)])
        monkeypatch.chdir(cwd)
        with pytest.raises(SystemExit) as ended:
            main()
        written = capfd.readouterr()
        return subprocess.CompletedProcess(arguments, ended.value.code or 0, written.out, written.err)

    return run


def test_help_reaches_no_heavy_import():
    code = (
        "import sys\n"
        "from benchmark.cli import app\n"
        "app(['--help'], standalone_mode=False)\n"
        "heavy = {'numpy', 'numba', 'matplotlib', 'shapely', 'sumolib', 'libsumo', 'torch', 'ray', 'yaml'}\n"
        "assert not heavy & set(sys.modules), heavy & set(sys.modules)\n"
    )
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert result.returncode == 0, result.stderr
    assert "scenario" in result.stdout


def test_build_reports_and_is_idempotent(smarts_bench, tiny):
    first, second = smarts_bench("scenario", "build", tiny), smarts_bench("scenario", "build", tiny)
    assert first.returncode == second.returncode == 0, first.stderr
    assert "tiny: " in first.stdout
    assert "traffic busy" in first.stdout
    assert first.stdout.splitlines()[1] == second.stdout.splitlines()[1]


AGENT = 't.SocialAgentActor("a", "{}")'
BUBBLE = f"bubbles=[t.Bubble(t.PositionalZone((200, 0), (60, 40)), {AGENT}, id='left-turn')]"


def test_build_refuses_agents_that_are_not_in_the_zoo(smarts_bench, tiny):
    script, text, place = tiny / "scenario.py", TINY["scenario.py"], "bubble 'left-turn'"

    def built(locator):
        script.write_text(text.replace("traffic=", f"{BUBBLE.format(locator)}, traffic="))
        return smarts_bench("scenario", "build", tiny)

    ended = built("idmm-v0")
    assert ended.returncode == 2
    assert all(each in ended.stderr for each in ("'idmm-v0'", place, "remedy", "'idm-v0'"))
    ended = built("own_policies_of_a_user:mine-v0")  # which runs get by --import
    assert ended.returncode == 0
    assert "own_policies_of_a_user" in ended.stdout
    assert place in ended.stdout
    ended = built("idm-v0")
    assert (ended.returncode, "note" in ended.stdout) == (0, False)


def test_run_counts_vehicles_and_draws(smarts_bench, tiny):
    out = tiny / "pictures" / "end.png"
    result = smarts_bench("scenario", "run", tiny, "--seconds", "30", "--out", out)
    assert result.returncode == 0, result.stderr
    assert "300 steps of 0.1 s" in result.stdout
    # 1,200 vehicles an hour for 30 s: ten departures, the last ones still under way.
    assert "10 at most" in result.stdout
    assert out.read_bytes().startswith(b"\x89PNG")


def test_show_draws_several_scenarios_on_a_sheet(smarts_bench, tiny):
    """Each in its half, cropped to its mission's route, which is 10 times as long as it is wide."""
    out, other = tiny / "sheet.png", shutil.copytree(tiny, tiny.with_name("other"))
    assert smarts_bench("scenario", "show", tiny, other, "--out", out).returncode == 0
    red, green, blue = np.moveaxis(imread(out)[..., :3], 2, 0)
    is_route = (red > green + 0.3) & (red > blue + 0.3)
    is_route[int(0.75 * len(red)) :] = False  # the legend
    for half in np.split(is_route, 2, axis=1):
        rows, columns = (np.flatnonzero(half.any(axis=axis)) for axis in (1, 0))
        assert np.ptp(columns) > 0.9 * half.shape[1]
        assert np.ptp(rows) == pytest.approx(0.1 * np.ptp(columns), rel=0.25)


def test_show_draws_a_scenario(smarts_bench, tiny):
    out = tiny / "picture.svg"
    result = smarts_bench("scenario", "show", tiny, "--seconds", "5", "--out", out)
    assert result.returncode == 0, result.stderr
    assert out.stat().st_size > 5_000


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["build", "intersektion"], "did you mean 'intersection'"),
        (["build"], "no scenario is named"),
        (["show", "TINY", "--out", "picture.bmpx"], "picture.bmpx"),
        (["run", "TINY", "--traffic", "bussy"], "did you mean 'busy'"),
    ],
)
def test_bad_input_ends_in_one_message_and_exit_code_2(smarts_bench, tiny, arguments, said):
    result = smarts_bench("scenario", *(a.replace("TINY", str(tiny)) for a in arguments), cwd=tiny)
    assert result.returncode == 2
    assert said in result.stderr
    assert "Traceback" not in result.stderr
    assert not list(Path(tiny).glob("*.bmpx"))
