"""A custom scenario on a map of the suite: an agent among slow trucks, written, built and driven."""

import shutil
import tempfile
from pathlib import Path

from smarts.env import SingleHiWayEnv
from smarts.sstudio import build_scenario

SCENARIO = """
from pathlib import Path

from smarts.sstudio import gen_scenario
from smarts.sstudio import types as t

trucks = t.Flow(
    route=t.Route(begin=("south_in", 0, 5), end=("north_out", 0, "max")),
    rate=400,
    actors={t.TrafficActor("truck", vehicle_type="truck", speed=t.Distribution(0.5, 0)): 1.0},
)
gen_scenario(
    t.Scenario(
        traffic={"trucks": t.Traffic(flows=[trucks], warm_up=20)},
        ego_missions=[t.Mission(t.Route(begin=("south_in", 1, 30), end=("north_out", 0, "max")))],
    ),
    output_dir=Path(__file__).parent,
)
"""


def main() -> str:
    """Build the scenario and play one episode; return how it ended."""
    with tempfile.TemporaryDirectory() as root:
        folder = Path(root) / "trucks"
        folder.mkdir()
        for source in Path(build_scenario("intersection").source).glob("map.*.xml"):
            shutil.copy(source, folder)
        (folder / "scenario.py").write_text(SCENARIO)
        env = SingleHiWayEnv([folder])
        try:
            env.reset(seed=42)
            decisions, is_over, info = 0, False, {}
            while not is_over:
                _, _, terminated, truncated, info = env.step(0)  # keep the lane
                decisions, is_over = decisions + 1, terminated or truncated
        finally:
            env.close()
    print(f"{info['outcome']} after {decisions} decisions")
    return info["outcome"]


if __name__ == "__main__":
    main()
