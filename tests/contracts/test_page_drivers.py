"""Drivers on the pages take vehicles over at speed: no hard braking in the first second, and no crash."""

import re

import numpy as np
import pytest

from smarts.env import VectorHiWayEnv
from smarts.registry import import_own
from smarts.types.actions import LaneAction
from smarts.types.vehicles import Owner
from tests.blocks import ROOT, blocks_of
from tests.unit.roads import maps

DRIVERS = {
    block.title: (block.text, match[1])
    for page in sorted((ROOT / "docs").rglob("*.md"))
    for block in blocks_of(page)
    if block.language == "python"
    and (match := re.search(r"^class (\w+)\((?:BatchAgent|Driver)\)", block.text, re.M))
}
"""File on a page -> its text, and the name of the agent in it."""
HARDEST = 3.5
"""[m/s^2]"""
ROAD = {
    "nod": '<nodes><node id="a" x="0" y="0"/><node id="b" x="900" y="0"/></nodes>',
    "edg": '<edges><edge id="road" from="a" to="b" numLanes="2" speed="20"/></edges>',
}
SCENARIO = """
from pathlib import Path
from smarts.sstudio import gen_scenario, types as t

flows = [
    t.Flow(t.Route(("road", lane, 0), ("road", lane, "max")), 900, actors={t.TrafficActor("car"): 1})
    for lane in (0, 1)
]
driver = t.SocialAgentActor("driver", "LOCATOR")
gen_scenario(
    t.Scenario(
        traffic={"busy": t.Traffic(flows, warm_up=60)},
        ego_missions=[t.Mission(t.Route(("road", 0, 850), ("road", 0, 890)))],
        bubbles=[t.Bubble(t.MapZone(("road", 0, 300), 300, 2), driver, margin=20)],
    ),
    output_dir=Path(__file__).parent,
)
"""


@pytest.mark.parametrize("title", DRIVERS)
def test_its_first_second(tmp_path, title):
    text, name = DRIVERS[title]
    module = tmp_path / f"of_page_{title}"
    module.write_text(f'{text}\n\nfrom smarts.zoo import register\n\nregister("of-page-v0", {name})\n')
    import_own([module])
    folder = maps.write(tmp_path / "road", **ROAD)
    (folder / "scenario.py").write_text(SCENARIO.replace("LOCATOR", f"{module.stem}:of-page-v0"))
    env = VectorHiWayEnv(1, [folder], 1, decision_interval=1)
    taken, firsts = {}, []
    try:
        env.reset(3)
        world = env._runner.world
        states = world.vehicles.of(0)
        for step in range(200):
            before, owned = states.speed.copy(), states.owner.copy()
            result = env.step([np.full((1, 1), LaneAction.keep_lane)])
            assert result.social_failures == {}
            ego = world.agents.slot[0, 0]
            for slot in np.flatnonzero(states.alive & (states.owner == Owner.AGENT)).tolist():
                if slot == ego:
                    continue
                if owned[slot] == Owner.TRAFFIC:
                    taken[slot] = step
                if slot in taken and step - taken[slot] < 10:
                    firsts.append((before[slot] - states.speed[slot]) / 0.1)
            cars = np.flatnonzero(states.alive)
            for one in (0, 1):  # bumpers in a lane, from the rear on
                lane = cars[(states.position[cars, 1] < -3.2) == bool(one)]
                lane = lane[np.argsort(states.position[lane, 0])]
                x, half = states.position[lane, 0], 0.5 * states.length[lane]
                assert ((x - half)[1:] > (x + half)[:-1]).all()
    finally:
        env.close()
    assert len(taken) > 3
    assert max(firsts) < HARDEST
