"""An agent that needs the kit alone: its actions depend on all bits of what it sees and draws."""

import numpy as np

from smarts_agent_kit import BatchAgent, uniform


class Easing(BatchAgent):
    """Drives at 5 to 7 m/s."""

    interface = {"action": "LaneWithContinuousSpeed", "vehicle_model": "kinematic"}  # noqa: RUF012
    observation = ("speed", "neighbors")

    def act(self, obs):
        seen = np.concatenate([each.reshape(len(each), -1) for each in obs.observations.values()], axis=1)
        speed = 5.0 + np.abs(seen).sum(axis=1, dtype=np.float64) % 1.0 + uniform(obs.seed, obs.step, 1)[:, 0]
        return np.column_stack([speed, np.zeros(len(speed))])
