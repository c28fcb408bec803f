"""Restored weights reach the runners, and replay buffers fit where they are put."""

import numpy as np
import pytest
from rigs import Rig

from algorithms.joint.replay import JointReplay
from tests.games.games import Ragged


def stored(replay):
    """Return the stored rewards, oldest first."""
    state = replay.get_state()
    rewards = state["arrays"]["rewards"]
    return rewards if state["size"] < replay.capacity else np.roll(rewards, -state["place"], axis=0)


@pytest.mark.parametrize("capacity", [20, 80])
def test_a_replay_buffer_restored_into_another_capacity_holds_the_newest_in_order(capacity):
    rig = Rig("dqn", Ragged, capacity=50)
    filled = rig.learner.replay
    rollouts = [rig.rollout(16) for _ in range(4)]
    other = JointReplay(rig.spec, capacity)
    for rollout in rollouts[:3]:
        filled.add(rollout)
    assert len(filled) == 50
    kept = stored(filled)[-capacity:]
    other.set_state(filled.get_state())
    np.testing.assert_array_equal(stored(other), kept)
    other.add(rollouts[3])
    new = np.concatenate([kept, rollouts[3].rewards[rollouts[3].views.alive[:-1].any(-1)]])
    np.testing.assert_array_equal(stored(other), new[-capacity:])
