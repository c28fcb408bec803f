"""With nobody else in the world, every scenario's traffic is exactly what SUMO makes of the same files."""

import subprocess
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import numpy as np
import pytest
import sumo

from smarts.providers.sumo_traffic import SumoTraffic, sumo_options
from smarts.sim.roster import Roster
from smarts.sstudio.build import build_scenario, suite
from smarts.types.vehicles import VehicleStates

SEED = 7
SECONDS = 60.0
DT = 0.1
SUMO = Path(sumo.__file__).parent / "bin" / "sumo"

EXACTLY = 1e-12
"""In the last digit of what SUMO prints with 17 digits, in metres and metres per second."""


def moments(files, end, output):
    """Yield (time, vehicles) for every step of plain SUMO up to the end; vehicles are FCD elements."""
    options = ["--fcd-output", output, "--precision", "17", "--fcd-output.acceleration", "--end", end]
    command = [SUMO, *sumo_options(files, SEED, DT), *options]
    subprocess.run([*map(str, command)], check=True, stdout=subprocess.DEVNULL)
    for _, element in ElementTree.iterparse(output):
        if element.tag == "timestep":
            yield float(element.get("time")), element
            element.clear()


@pytest.mark.slow
@pytest.mark.parametrize("variation", ["no_social_vehicles", "random_social_vehicles"])
@pytest.mark.parametrize("name", suite())
def test_a_minute_of_traffic_is_sumos(name, variation, tmp_path):
    built = build_scenario(name)
    files, roads = built.traffic[variation], built.roads()
    states = VehicleStates.allocate(1024)
    roster = Roster(states)
    traffic = SumoTraffic(dt=DT)
    traffic.reset(files, SEED, states, roster, roads)
    steps, compared = 0, 0
    end = files.warm_up + SECONDS
    for time, vehicles in moments(files, end, tmp_path / "fcd.xml"):
        # SUMO names the state at the end of a step by the time at which the step began.
        if time < files.warm_up - DT / 2:
            continue
        traffic.step(states)
        steps += 1
        compared += compare(vehicles, states, roster, roads)
    traffic.close()
    assert steps == round(SECONDS / DT)
    assert not traffic.is_full
    assert (compared > 0) == (variation != "no_social_vehicles")


def compare(vehicles, states, roster, roads):
    """Check every vehicle of one moment, and return how many there were."""
    said = {vehicle.get("id"): vehicle for vehicle in vehicles}
    rows = np.flatnonzero(states.alive)
    assert sorted(roster.name(row) for row in rows) == sorted(said)
    heading = states.heading[rows]
    forward = np.stack([np.cos(heading), np.sin(heading)], -1)
    front = states.position[rows] + forward * states.length[rows, None] / 2
    for row, (x, y) in zip(rows, front.tolist(), strict=True):
        vehicle = said[roster.name(row)]
        assert x == pytest.approx(float(vehicle.get("x")), rel=0, abs=EXACTLY)
        assert y == pytest.approx(float(vehicle.get("y")), rel=0, abs=EXACTLY)
        assert states.speed[row] == pytest.approx(float(vehicle.get("speed")), rel=0, abs=EXACTLY)
        assert states.acceleration[row] == pytest.approx(
            float(vehicle.get("acceleration")), rel=0, abs=EXACTLY
        )
        assert roads.lane_ids[states.lane[row]] == vehicle.get("lane")
    return len(said)
