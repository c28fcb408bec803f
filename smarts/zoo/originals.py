"""The agents that the original's scenario files name, and what stands for them here."""

from __future__ import annotations

MODULE = "zoo.policies"
"""Their module in the original."""

SERVED = {
    "keep-lane-agent-v0": "keep-lane-v0",
    "non-interactive-agent-v0": "non-interactive-v0",
    "chase-via-points-agent-v0": "chase-via-points-v0",
}
"""Name in `zoo.policies` -> name here."""

NOT_SERVED = {
    "replay-agent-v0": "record an episode, then drive by its poses with 'trajectory-v0'",
}
"""Name in `zoo.policies` -> what to use instead."""
