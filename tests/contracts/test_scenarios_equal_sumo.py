"""Without agents, every scenario's traffic equals SUMO's own simulation of the same files."""

import subprocess
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import numpy as np
import pytest
import sumo

from smarts.providers.sumo_traffic import SumoTraffic
from smarts.sstudio.build import build_scenario, suite
from smarts.types.world import World

SEED = 7
SECONDS = 60.0
DT = 0.1
OPTIONS = (
    f"--seed {SEED} --step-length {DT} --lanechange.duration 3 --time-to-teleport -1 --collision.action none"
    " --collision.check-junctions true --no-step-log --no-warnings"
).split()
"""SUMO's options, stated independently of `sumo_options`."""

SUMO = Path(sumo.__file__).parent / "bin" / "sumo"

EXACTLY = 1e-12
"""Rounding of SUMO's output with 17 digits [m, m/s]."""
COLUMNS = ("x", "y", "speed", "acceleration")


def moments(files, end, output):
    """Yield (time, vehicles) for every step of plain SUMO up to the end; vehicles are FCD elements."""
    inputs = ["--net-file", files.net, "--route-files", ",".join(map(str, files.routes))]
    if files.additional:
        inputs += ["--additional-files", ",".join(map(str, files.additional))]
    output_options = ["--fcd-output", output, "--precision", "17", "--fcd-output.acceleration", "--end", end]
    command = [SUMO, *inputs, *OPTIONS, *output_options]
    subprocess.run([*map(str, command)], check=True, stdout=subprocess.DEVNULL)
    for _, element in ElementTree.iterparse(output):
        if element.tag == "timestep":
            yield float(element.get("time")), element
            element.clear()


@pytest.mark.parametrize(
    "name",
    [name if name == "bus_stop_merge" else pytest.param(name, marks=pytest.mark.nightly) for name in suite()],
)
def test_a_minute_of_traffic_equals_sumo(name, tmp_path):
    built = build_scenario(name)
    files, roads = built.traffic["random_social_vehicles"], built.roads()
    world = World(worlds=1, capacity=1024, agents=0, lanes=len(roads.lane_ids), dt=DT)
    traffic = SumoTraffic(world, 0)
    traffic.reset(files, SEED, roads)
    steps, compared = 0, 0
    end = files.warm_up + SECONDS
    for time, vehicles in moments(files, end, tmp_path / "fcd.xml"):
        # SUMO names the state at the end of a step by the time at which the step began.
        if time < files.warm_up - DT / 2:
            continue
        traffic.step()
        steps += 1
        compared += compare(vehicles, world)
    traffic.close()
    assert steps == round(SECONDS / DT)
    assert not traffic.is_full
    assert compared > 0


def compare(vehicles, world):
    """Check every vehicle of one moment, and return their number."""
    states = world.vehicles.of(0)
    expected = {vehicle.get("id"): vehicle for vehicle in vehicles}
    rows = np.flatnonzero(states.alive)
    names = [world.registry.name(0, row) for row in rows]
    assert sorted(names) == sorted(expected)
    heading = states.heading[rows]
    forward = np.stack([np.cos(heading), np.sin(heading)], -1)
    front = states.position[rows] + forward * states.length[rows, None] / 2
    found = np.column_stack([front[:, :2], states.speed[rows], states.acceleration[rows]])
    sumos = [[float(expected[name].get(column)) for column in COLUMNS] for name in names]
    np.testing.assert_allclose(
        found, np.reshape(sumos, found.shape), rtol=0, atol=EXACTLY, equal_nan=False, err_msg=f"of {names}"
    )
    return len(expected)
