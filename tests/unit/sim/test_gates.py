"""Hand-overs between SUMO and agents: none is lost, none jumps, and without one nothing changes."""

import hashlib

import numpy as np
import pytest

from perf.handover_errors import Tally
from perf.handover_safety import Safety
from perf.handovers import HELD, NO_ENDS, Run, run_scenario, with_big_vehicles
from smarts.agents import AgentInterface, PooledAgents
from smarts.sim.assembly import assemble
from smarts.sstudio import build_scenario
from smarts.types.actions import ActionSpaceType
from smarts.types.transfers import Refusal
from smarts.types.vehicles import Owner

KINEMATIC = AgentInterface(
    action=ActionSpaceType.Lane, vehicle_model="kinematic", done_criteria=NO_ENDS, max_episode_steps=None
)


@pytest.mark.parametrize(
    "scenario",
    [
        "intersection",
        *(pytest.param(name, marks=pytest.mark.nightly) for name in ("roundabout", "on_ramp_merge")),
    ],
)
def test_hand_overs_lose_no_vehicle_and_make_none_jump(scenario, tmp_path):
    tally, safety = Tally(), Safety()
    made = run_scenario(scenario, "kinematic", 100, 3, tally, tmp_path, safety)
    assert made >= 100
    taken, released = (sum(map(len, tally.errors[what])) for what in ("take", "release"))
    assert taken + released == made
    assert sum(tally.ends.values()) == taken, "each hold ends in one way"
    assert set(tally.ends) <= {
        "released",
        "arrived",
        "removed: collision",
        "obstacle at the end",
        "active at the end",
        "leaving at the end",
    }
    along, across, heading, speed = np.concatenate(tally.errors["take"]).max(axis=0)
    assert along < 0.05
    assert across < 0.25
    assert speed < 0.8
    for what in ("release", "release, step after"):
        along, across, heading, speed = np.concatenate(tally.errors[what]).max(axis=0)
        assert across < 0.15, what
        assert heading < 0.05, what
        assert speed < 0.6, what
    assert 0.0 < max(watch.hardest for watch in safety.driven) < 0.5


@pytest.mark.nightly
def test_equal_seeds_give_equal_hand_overs(tmp_path):
    twins = []
    for _ in range(2):
        tally = Tally()
        run_scenario("intersection", "kinematic", 40, 5, tally, tmp_path)
        rows = [np.concatenate(tally.errors[what]) for what in ("take", "release", "traffic")]
        twins.append((hashlib.sha256(b"".join(each.tobytes() for each in rows)).hexdigest(), tally.waits))
    assert twins[0] == twins[1]


class Unwilling:
    """A provider that drives no vehicle."""

    def can_accept(self, rows, slots):
        return np.full(len(rows), Refusal.TOO_CLOSE, np.int8)


def test_hand_overs_that_are_refused_change_no_trajectory(tmp_path):
    """Beside a run in which no vehicle is wanted, one in which many are, and none can be had."""
    built = build_scenario("intersection").with_traffic(["random_social_vehicles"])
    parts = assemble([built], [], pool=[PooledAgents(KINEMATIC, HELD)], worlds=1, seed=2)
    poses = []
    try:
        parts.ownership._drivers = {**parts.ownership._drivers, Owner.AGENT: Unwilling()}
        for most in (0, 100):
            parts.simulation.reset({0: with_big_vehicles(parts.schedule.start(0, 0), tmp_path)})
            Run(parts, np.random.Generator(np.random.Philox(1)), Tally()).play(150, most)
            vehicles = parts.simulation.world.vehicles.of(0)
            alive = vehicles.alive
            poses.append(np.column_stack([vehicles.position[alive], vehicles.speed[alive]]))
            assert (parts.ownership.refused[0, Refusal.TOO_CLOSE] > 10) == bool(most)
    finally:
        parts.simulation.close()
    assert len(poses[0]) > 10
    assert np.array_equal(*poses)
