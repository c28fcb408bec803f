import numpy as np
import pytest

from smarts.dynamics import Fleet


class Rig:
    """One vehicle on a test track."""

    def __init__(
        self, name="passenger", *, speed=0.0, friction=0.9, slope=0.0, step=0.1, substeps=10, **options
    ):
        self.fleet = Fleet(1, 1, step=step, substeps=substeps)
        self.fleet.road.friction[:] = friction
        self.fleet.road.normal[:] = -np.sin(np.arctan(slope)), 0.0, np.cos(np.arctan(slope))
        self.fleet.spawn(0, name, (0.0, 0.0), 0.0, speed, **options)
        self.step = step
        self.log = []

    def drive(self, seconds, throttle=0.0, brake=0.0, steering=0.0):
        for _ in range(round(seconds / self.step)):
            self.once(throttle, brake, steering)
        return self

    def hold(self, speed, seconds, steering=0.0):
        """Hold a speed with a proportional-integral driver."""
        integral = 0.0
        for _ in range(round(seconds / self.step)):
            gap = speed - self.speed
            integral += gap * self.step
            self.once(min(max(0.5 * gap + 0.1 * integral, 0.0), 1.0), 0.0, steering)
        return self

    def stop(self):
        """Brake with all force until it stands; return the distance [m]."""
        start = self.position.copy()
        while abs(self.speed) > 1e-3 and len(self.log) < 10_000:
            self.once(0.0, 1.0, 0.0)
        return float(np.linalg.norm(self.position - start))

    def once(self, throttle, brake, steering):
        motion = self.fleet.step(np.array([[throttle, brake, steering]]))
        self.log.append(motion.acceleration[0, 0])

    @property
    def speed(self):
        return float(self.fleet.motion.velocity[0, 0])

    @property
    def position(self):
        return self.fleet.motion.position[0]

    @property
    def heading(self):
        return float(self.fleet.motion.heading[0])

    @property
    def yaw_rate(self):
        return float(self.fleet.motion.yaw_rate[0])

    @property
    def steering(self):
        return float(self.fleet.motion.steering[0])


@pytest.fixture
def rig(closing):
    def make(*args, **options):
        made = Rig(*args, **options)
        return closing(made, made.fleet)

    return make
