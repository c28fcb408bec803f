"""The bare loop: the calls to SUMO and Bullet that driving in traffic cannot do without, and nothing else.

What is in it for a step of 0.1 s of one simulation:

- SUMO: every ego is put where it is (`moveToXY`) and given its speed, one `simulationStep`, then place,
  angle, speed and acceleration of every vehicle that SUMO drives, and arrivals and departures;
- Bullet: ten times the velocity of every ego's body, `stepSimulation`, and the pose and velocity of every
  body.

It follows an episode that was driven before: same traffic files, seed and poses of the egos. It has no
controllers, tyres, sensors, events, rewards or observations, and no vehicles of others in Bullet.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from typing import NamedTuple

import pybullet

from smarts.providers.sumo_library import SumoLibrary
from smarts.providers.sumo_traffic import sumo_options
from smarts.types.episode import EpisodeStart

DT, SUBSTEPS = 0.1, 10
HALF_SIZE = (2.2, 0.8, 0.6)
MASS = 1100.0
LANES_ARE_NEAR, LEAVES_NET = 8.0, 2

Pose = tuple[float, float, float, float]
"""Middle of the front [m], angle as SUMO counts it [degrees], speed [m/s]."""


class Beginning(NamedTuple):
    """How an episode of one simulation begins."""

    start: EpisodeStart
    poses: Sequence[Pose]
    """Poses of the egos."""
    traffic: Collection[str]
    """SUMO's vehicles that remain after the egos' places were cleared."""


class BareTraffic:
    """SUMO, and what is read from it."""

    def __init__(self) -> None:
        self._library = SumoLibrary()
        self._egos: list[str] = []
        self.driven: dict[str, tuple] = {}
        """What was read last of each vehicle that SUMO drives."""

    def reset(self, beginning: Beginning) -> None:
        """Load and warm up; the egos come in with the last step of it."""
        start, library = beginning.start, self._library
        options = sumo_options(start.traffic, start.traffic_seed, DT)
        library.start([*options, "--max-num-vehicles", str(start.limit)])
        if start.traffic.warm_up > DT:
            library.simulation.step(start.traffic.warm_up - DT)
        self._egos = [f"ego-{number}" for number in range(len(beginning.poses))]
        for ego in self._egos:
            library.vehicle.add(ego, "", typeID="DEFAULT_VEHTYPE")
            library.vehicle.setLaneChangeMode(ego, 0)
        self.driven = {}
        self.step(beginning.poses)
        self.driven = {}
        for name in library.vehicle.getIDList():
            if name in beginning.traffic:
                self.driven[name] = ()
            elif name not in self._egos:
                library.vehicle.remove(name)

    def step(self, poses: Sequence[Pose]) -> None:
        """Advance by `DT`."""
        vehicle, simulation, driven = self._library.vehicle, self._library.simulation, self.driven
        for ego, (x, y, angle, _) in zip(self._egos, poses, strict=True):
            vehicle.moveToXY(ego, "", -1, x, y, angle, LEAVES_NET, LANES_ARE_NEAR)
        simulation.step(0.0)
        for ego, (_, _, _, speed) in zip(self._egos, poses, strict=True):
            vehicle.setPreviousSpeed(ego, speed)
        for name in simulation.getArrivedIDList():
            driven.pop(name, None)
        for name in simulation.getDepartedIDList():
            if name not in self._egos:
                driven[name] = ()
        position, angle = vehicle.getPosition, vehicle.getAngle
        speed, acceleration = vehicle.getSpeed, vehicle.getAcceleration
        for name in driven:
            driven[name] = position(name), angle(name), speed(name), acceleration(name)

    def keep(self, names: Collection[str]) -> None:
        """Remove the vehicles that the episode did not have."""
        for name in [name for name in self.driven if name not in names]:
            self._library.vehicle.remove(name)
            del self.driven[name]

    def close(self) -> None:
        """Give the library back."""
        self._library.close()


class BareBodies:
    """Bullet, with a body for each ego."""

    def __init__(self, egos: int) -> None:
        self._client = client = pybullet.connect(pybullet.DIRECT)
        pybullet.setTimeStep(DT / SUBSTEPS, client)
        pybullet.setGravity(0.0, 0.0, 0.0, client)
        shape = pybullet.createCollisionShape(
            pybullet.GEOM_BOX, halfExtents=HALF_SIZE, physicsClientId=client
        )
        self._bodies = [pybullet.createMultiBody(MASS, shape, physicsClientId=client) for _ in range(egos)]
        for body in self._bodies:
            pybullet.changeDynamics(body, -1, linearDamping=0.0, angularDamping=0.0, physicsClientId=client)

    def reset(self, poses: Sequence[Pose]) -> None:
        """Put the bodies where the egos are."""
        for body, (x, y, angle, _) in zip(self._bodies, poses, strict=True):
            turned = pybullet.getQuaternionFromEuler((0.0, 0.0, math.radians(90.0 - angle)))
            pybullet.resetBasePositionAndOrientation(body, (x, y, 0.6), turned, self._client)

    def step(self, poses: Sequence[Pose]) -> None:
        """Advance by `DT` in sub-steps, each ego at its speed."""
        bodies, client = self._bodies, self._client
        linear = []
        for _, _, angle, speed in poses:
            heading = math.radians(90.0 - angle)
            linear.append((speed * math.cos(heading), speed * math.sin(heading), 0.0))
        set_velocity, go_on = pybullet.resetBaseVelocity, pybullet.stepSimulation
        read_pose, read_velocity = pybullet.getBasePositionAndOrientation, pybullet.getBaseVelocity
        for _ in range(SUBSTEPS):
            for body, velocity in zip(bodies, linear, strict=True):
                set_velocity(body, velocity, (0.0, 0.0, 0.0), client)
            go_on(client)
            for body in bodies:
                read_pose(body, client)
                read_velocity(body, client)

    def close(self) -> None:
        """Free the world."""
        pybullet.disconnect(self._client)


class BareLoop:
    """B simulations, one after another in each step."""

    def __init__(self, worlds: int, egos: int) -> None:
        self._worlds = [(BareTraffic(), BareBodies(egos)) for _ in range(worlds)]

    def reset(self, row: int, beginning: Beginning) -> None:
        """Begin an episode of one simulation."""
        traffic, bodies = self._worlds[row]
        traffic.reset(beginning)
        bodies.reset(beginning.poses)

    def step(self, poses: Sequence[Sequence[Pose]], but: Collection[int] = ()) -> None:
        """Advance all simulations but some by `DT`; the poses of their egos are those of the step's end."""
        for row, ((traffic, bodies), each) in enumerate(zip(self._worlds, poses, strict=True)):
            if row in but:
                continue
            bodies.step(each)
            traffic.step(each)

    def keep(self, traffic: Sequence[Collection[str]], but: Collection[int]) -> None:
        """Remove the vehicles that the episodes did not have: the room that ours keeps is not kept here."""
        for row, ((engine, _), names) in enumerate(zip(self._worlds, traffic, strict=True)):
            if row not in but:
                engine.keep(names)

    def vehicles(self) -> float:
        """Return how many vehicles SUMO drives in a simulation on average."""
        return sum(len(traffic.driven) for traffic, _ in self._worlds) / len(self._worlds)

    def close(self) -> None:
        """Give back what the simulations hold."""
        for traffic, bodies in self._worlds:
            traffic.close()
            bodies.close()
