"""Let agents of the zoo turn left across oncoming traffic, in a bubble, and count how their drives end.

    python -m perf.left_turn [LOCATOR...] [--episodes 20] [--seconds 300] [--seed 7] [--beside 0]

Each agent drives the vehicles that turn left on the map of `examples/left_turn_bubble`, in `HiWayEnv`, with
an ego parked on the side road: an environment and a scenario in which nothing was trained. Traffic is the
same for all agents; with `--beside` so many vehicles an hour drive in the lane beside them, too. Printed: the
share of drives that ended by a collision, with Wilson's 95% interval; how many ended in which way (RELEASE:
the bubble gave the vehicle back to traffic).
"""

from __future__ import annotations

import argparse
import shutil
import tempfile
from collections import Counter
from collections.abc import Sequence
from contextlib import closing
from pathlib import Path

from benchmark.statistics import wilson_interval
from scenarios.drivers import flow
from smarts.agents import AgentInterface, DoneCriteria
from smarts.env import HiWayEnv
from smarts.sim.assembly import Options
from smarts.sim.episode_files import RecordedEpisode, episodes_in
from smarts.sstudio import gen_scenario
from smarts.sstudio import types as t
from smarts.types.actions import ActionSpaceType
from smarts.types.events import Outcome
from smarts.types.transfers import Reason

MAP = Path(__file__).parents[1] / "examples" / "left_turn_bubble"
TURNER, UNFINISHED = "turner", "UNFINISHED"
ZONE = [(-85, -8), (10, -8), (10, 30), (-6, 30), (-6, 8), (-85, 8)]
PARKED = DoneCriteria(
    collision=False, off_road=False, off_route=False, on_shoulder=False, wrong_way=False, not_moving=False
)


def make_scenario(folder: Path, locator: str, beside: float) -> None:
    """Write a scenario whose left-turning vehicles an agent of the zoo drives, one at a time."""
    for name in ("map.nod.xml", "map.edg.xml"):
        shutil.copy(MAP / name, folder)
    flows = [
        flow(("west_in", 1), ("north_out", 0), 240),
        flow(("east_in", 1), ("west_out", 1), 700),
        flow(("east_in", 0), ("west_out", 0), 250),
    ]
    if beside:
        flows.append(flow(("west_in", 0), ("east_out", 0), beside))
    bubble = t.Bubble(
        id="left-turn",
        zone=t.ConfigurableZone(ZONE),
        margin=10,
        limit=t.BubbleLimits(1, 1),
        collision_time=1.0,
        actor=t.SocialAgentActor(TURNER, agent_locator=locator),
        exclusion_prefixes=[f"mixed-flow-{number}" for number in range(1, len(flows))],
    )
    ego = t.Mission(t.Route(begin=("north_in", 0, 5.0), end=("south_out", 0, "max")))
    traffic = {"crossing": t.Traffic(flows=flows, warm_up=20.0)}
    gen_scenario(t.Scenario(traffic=traffic, ego_missions=[ego], bubbles=[bubble]), output_dir=folder)


def outcomes_of(locator: str, episodes: int, steps: int, seed: int, beside: float = 0.0) -> Counter[str]:
    """Play some episodes of so many steps; return how often an agent's drives ended in which way."""
    interface = AgentInterface(
        max_episode_steps=steps, action=ActionSpaceType.Lane, done_criteria=PARKED, accelerometer=False
    )
    with tempfile.TemporaryDirectory() as made:
        scenario, record = Path(made, "scenario"), Path(made, "episodes")
        scenario.mkdir()
        make_scenario(scenario, locator, beside)
        with closing(HiWayEnv([scenario], {"ego": interface}, simulation=Options(record=record))) as env:
            for number in range(episodes):
                env.reset(seed=seed if number == 0 else None)
                is_over = False
                while not is_over:
                    *_, terminated, truncated, _ = env.step({"ego": "slow_down"})
                    is_over = terminated["__all__"] or truncated["__all__"]
        return sum((_ended(RecordedEpisode(file)) for file in episodes_in(record)), Counter())


def _ended(episode: RecordedEpisode) -> Counter[str]:
    """Return how the drives of an episode's turners ended."""
    agents, holds = episode.table("agents"), episode.table("holds")
    outcomes = dict(zip(agents["name"], agents["outcome"], strict=True))
    ended: Counter[str] = Counter()
    for name, reason in zip(holds["name"], holds["ended"], strict=True):
        if not str(name).startswith(TURNER):
            continue
        if outcomes[name] != Outcome.NONE:
            ended[Outcome(outcomes[name]).name] += 1
        else:
            ended[UNFINISHED if reason < 0 else Reason(reason).name] += 1
    return ended


def main(argv: Sequence[str] | None = None) -> None:
    """Print a line for each agent."""
    parser = argparse.ArgumentParser(
        prog="python -m perf.left_turn", description=(__doc__ or "").split("\n", 1)[0]
    )
    parser.add_argument("locators", nargs="*", default=["keep-lane-v0", "idm-v0"])
    parser.add_argument("--episodes", type=int, default=20)
    parser.add_argument("--seconds", type=float, default=300.0)
    parser.add_argument("--seed", type=int, default=7)
    parser.add_argument("--beside", type=float, default=0.0, help="vehicles an hour")
    given = parser.parse_args(argv)
    for locator in given.locators:
        ended = outcomes_of(locator, given.episodes, round(10 * given.seconds), given.seed, given.beside)
        cut_off = ended.pop(UNFINISHED, 0)
        count = max(ended.total(), 1)
        share = ended["COLLISION"] / count
        low, high = wilson_interval(share, count)
        ends = ", ".join(f"{name} {number}" for name, number in ended.items())
        print(f"{locator}: collided {share:.3f} ({low:.3f} to {high:.3f}); {ends}; {cut_off} not over")


if __name__ == "__main__":
    main()
