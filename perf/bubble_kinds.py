"""Record an episode with each kind of bubble on the suite's intersection, and draw it.

    python -m perf.bubble_kinds OUT [--kinds lanes boids ...] [--seconds 40] [--film]

OUT gets a folder of records, a picture `KIND.png` of four moments for each kind, with `--film` an animation
`KIND.gif`, and a table: vehicles that agents began to observe, began to drive and gave back, vehicles that
left the simulation from an agent, by reason, and the counts of the bubbles.
"""

from __future__ import annotations

import argparse
import shutil
from collections import Counter
from collections.abc import Sequence
from contextlib import closing
from pathlib import Path

import numpy as np

from smarts.agents import AgentInterface, DoneCriteria
from smarts.env import HiWayEnv
from smarts.envision.animation import write_moving, write_still
from smarts.envision.episode_picture import EpisodePicture
from smarts.sim.assembly import Options
from smarts.sim.episode_files import RecordedEpisode, episodes_in
from smarts.sstudio import build_scenario
from smarts.types.actions import ActionSpaceType
from smarts.types.bubbles import COUNTS
from smarts.types.transfers import Departure, Reason

SCENARIO = """
from pathlib import Path
from smarts.sstudio import gen_scenario, types as t

car, bus = t.TrafficActor("car"), t.TrafficActor("bus", vehicle_type="bus")
ways = [("south", "north"), ("north", "south"), ("west", "east"), ("east", "west")]
flows = [
    t.Flow(t.Route((f"{a}_approach", lane, 5), (f"{b}_exit", lane, "max")), 160, actors={car: 4, bus: 1})
    for a, b in ways for lane in (0, 1)
]
flows.append(t.Flow(t.Route(("west_approach", 0, 5), ("east_exit", 0, "max")), 200, actors={bus: 1}))
flows.append(t.Flow(t.Route(("west_approach", 0, 5), ("south_exit", 0, "max")), 100, actors={car: 1}))
leader = t.Trip("leader", t.Route(("west_in", 1, 5), ("east_out", 1, "max")), depart=24)
mission = t.Mission(t.Route(("south_in", 0, 20), ("north_out", 0, "max")))
keeper = t.SocialAgentActor("keeper", "smarts.zoo:keep-lane-v0")
idm = t.SocialAgentActor("idm", "smarts.zoo:idm-v0")
flock = t.BoidAgentActor("flock", "smarts.zoo:boids-v0", capacity=t.BubbleLimits(4, 6))
middle = t.PositionalZone((0, 0), (110, 110))
west, east = t.PositionalZone((-22, 0), (60, 60)), t.PositionalZone((22, 0), (60, 60))
star = t.ConfigurableZone([(-90, -8), (-8, -90), (90, -8), (8, 90)], rotation=0.3)
social = None
BODY
gen_scenario(
    t.Scenario(
        traffic={"all": t.Traffic(flows=flows, trips=[leader], warm_up=20)},
        ego_missions=[mission],
        social_agent_missions=social,
        bubbles=bubbles,
    ),
    output_dir=Path(__file__).parent,
)
"""
KINDS = {
    "lanes": "bubbles = [t.Bubble(t.MapZone(('west_in', 0, 10), 60, 2), keeper, margin=15)]",
    "position": "bubbles = [t.Bubble(middle, idm, margin=15)]",
    "polygon": "bubbles = [t.Bubble(star, idm, margin=10)]",
    "follows-agent": (
        "bubbles = [t.Bubble(t.PositionalZone((0, 0), (40, 50)), idm, margin=8, follow_actor_id='ego',"
        " follow_offset=(0, 20))]"
    ),
    "follows-vehicle": (
        "bubbles = [t.Bubble(t.PositionalZone((0, 0), (30, 60)), keeper, margin=8,"
        " follow_vehicle_id='leader', follow_offset=(0, -10))]"
    ),
    "boids": "bubbles = [t.Bubble(middle, flock, margin=15, keep_alive=True)]",
    "engine": "bubbles = [t.Bubble(middle, t.TrafficEngineActor('local', max_speed=8), margin=15)]",
    "conditions": (
        "window = t.TimeWindowCondition(5, 25)\n"
        "bubbles = [t.Bubble(middle, idm, margin=15, active_condition=window,"
        " airlock_condition=-t.VehicleTypeCondition('bus'))]"
    ),
    "triggers": (
        "there = t.DependeeActorCondition('leader').trigger(4)\n"
        "bubbles = [t.Bubble(middle, idm, margin=15, active_condition=there.expire(25))]"
    ),
    "overlap": (
        "bubbles = [t.Bubble(west, keeper, margin=10, id='first'),"
        " t.Bubble(east, idm, margin=10, id='second')]"
    ),
    "prefixes": "bubbles = [t.Bubble(middle, idm, margin=15, exclusion_prefixes=['bus'])]",
    "limits": "bubbles = [t.Bubble(middle, idm, margin=15, limit=t.BubbleLimits(2, 3))]",
    "social-missions": (
        "social = {'g': ([keeper, idm], [t.Mission(t.Route(('west_in', 1, 40), ('east_out', 1, 'max'))),"
        " t.Mission(t.Route(('north_in', 0, 30), ('south_out', 0, 'max')), start_time=4)])}\n"
        "bubbles = [t.Bubble(t.PositionalZone((0, 0), (30, 40)), idm, margin=8, follow_offset=(0, 0),"
        " follow_actor_id=t.Bubble.to_actor_id(keeper, 'g'))]"
    ),
}
"""What each scenario adds."""
MOMENTS = (0.25, 0.5, 0.75, 1.0)
"""Of the pictures, as shares of the episode."""
SPEED = 3.0
"""Of the ego [m/s]."""
EGO = AgentInterface(
    action=ActionSpaceType.LaneWithContinuousSpeed,
    vehicle_model="kinematic",
    done_criteria=DoneCriteria(collision=False, off_road=False, off_route=False, not_moving=False),
)


def record(kind: str, out: Path, seconds: float) -> RecordedEpisode:
    """Play an episode with one kind of bubble; return its record."""
    folder, records = out / "scenarios" / kind, out / "records" / kind
    for each in (folder, records):
        shutil.rmtree(each, ignore_errors=True)
    folder.mkdir(parents=True)
    for source in build_scenario("intersection").source.glob("map.*.xml"):
        shutil.copy(source, folder)
    (folder / "scenario.py").write_text(SCENARIO.replace("BODY", KINDS[kind]))
    with closing(HiWayEnv([folder], {"ego": EGO}, simulation=Options(record=records))) as env:
        env.reset(seed=42)
        for _ in range(round(seconds / 0.1)):
            *_, terminated, truncated, infos = env.step({"ego": (SPEED, 0)})
            if infos["ego"].get("social_failures"):
                raise SystemExit(f"{kind}: {infos['ego']['social_failures']}")
            if terminated["__all__"] or truncated["__all__"]:
                break
    return RecordedEpisode(episodes_in(records)[0])


def draw(episode: RecordedEpisode, out: Path, *, is_film: bool) -> None:
    """Draw four moments side by side, and an animation."""
    picture = EpisodePicture(episode, pixels=620)
    images = [picture.image(round(share * picture.steps)) for share in MOMENTS]
    rows = [np.concatenate(images[:2], axis=1), np.concatenate(images[2:], axis=1)]
    write_still(np.concatenate(rows), out.with_suffix(".png"))
    if is_film:
        write_moving(picture.images(range(0, picture.steps, 2)), out.with_suffix(".gif"), 0.2)


def summary(kind: str, episode: RecordedEpisode) -> str:
    """Return a row of the table."""
    transfers, bubbles = episode.table("transfers"), episode.table("bubbles")
    reasons = Counter(transfers["reason"].tolist())
    left = Counter(
        Departure(number).name.lower()
        for number, reason in zip(transfers["departure"], transfers["reason"], strict=True)
        if reason == Reason.LEAVE
    )
    counts = {name: int(bubbles[name].sum()) for name in COUNTS if bubbles[name].any()}
    changed = (reasons[each] for each in (Reason.SHADOW, Reason.TAKE, Reason.RELEASE))
    return f"| {kind} | {' | '.join(map(str, changed))} | {dict(left)} | {counts} |"


def main(arguments: Sequence[str] | None = None) -> None:
    """Record and draw the kinds that the command line names."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("out", type=Path)
    parser.add_argument("--kinds", nargs="+", choices=KINDS, default=[*KINDS], metavar="KIND")
    parser.add_argument("--seconds", type=float, default=40.0)
    parser.add_argument("--film", action="store_true")
    given = parser.parse_args(arguments)
    print("| kind | observed | driven | given back | left | counts |\n|---|---|---|---|---|---|")
    for kind in given.kinds:
        episode = record(kind, given.out, given.seconds)
        draw(episode, given.out / kind, is_film=given.film)
        print(summary(kind, episode), flush=True)


if __name__ == "__main__":
    main()
