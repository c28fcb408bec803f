"""Wraps Bullet: the rigid bodies of one simulation.

Every simulation has its own client (world). Compared with one shared client, that costs 0.7 us per sub-step
and simulation, and makes a simulation's bits independent of the other simulations in the batch.

The world has no ground and no gravity: `chassis.advance` turns all forces into velocities, and Bullet
integrates the motion and resolves contacts; steps without possible contacts skip Bullet, see
`bullet_worlds`. A velocity per body and sub-step is one call where force and torque are two. Reading a body
back costs two calls of 1 us each and cannot be had for less.
"""

from __future__ import annotations

import struct
import weakref
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from smarts.arrays import Floats
from smarts.dynamics.layout import BODY_SIZE
from smarts.dynamics.quiet_pybullet import pybullet
from smarts.errors import SmartsError

EGO, BOX = 1, 2
"""Collision groups: egos meet egos and boxes; boxes, which follow their own script, do not meet each
other."""
BOX_MASS = 1e7
"""Mass of a box [kg]: to a car, a wall that moves."""
FRICTION = 0.3
"""Friction of a body against a body."""
RESTITUTION = 0.1

_ROW = struct.Struct(f"{BODY_SIZE}d")


@dataclass(frozen=True)
class Box:
    """A road user that Bullet does not drive but that egos can hit."""

    position: tuple[float, float, float]
    """Centre [m]."""
    heading: float
    """[rad]."""
    speed: float
    """Speed along the heading [m/s]."""
    length: float
    width: float
    height: float
    lateral_speed: float = 0.0
    """Speed to the left of the heading [m/s]."""
    yaw_rate: float = 0.0
    """[rad/s]; the velocity does not turn with it."""


class BulletContact(NamedTuple):
    """A contact between a vehicle and another road user in one sub-step."""

    row: int
    """Row of the vehicle."""
    other_row: int
    """Row of the other vehicle; -1 if it is a box."""
    box: int
    """Key of the box; -1 if it is a vehicle."""
    speed: float
    """How fast the two approached each other [m/s]."""


def _connected() -> int:
    """Return a new client of Bullet's."""
    client = pybullet.connect(pybullet.DIRECT)
    if client < 0:
        raise SmartsError(
            "there is no room for another simulation in this process",
            place="Bullet",
            remedy="step fewer simulations, close other environments, or spread them over processes; "
            "a process holds about 1,000",
        )
    return client


class BulletWorld:
    """The bodies of one simulation.

    Args:
        bodies: Motion of all vehicles of all simulations, shape (E, 13); rows of this world's bodies are
            read when they come in and are put, and written by sub-steps.
        dt: Sub-step [s].

    Raises:
        SmartsError: Bullet has no room for so many worlds in one process.
    """

    def __init__(self, bodies: Floats, dt: float) -> None:
        self._bodies = bodies
        self._motion = bodies.reshape(-1).data.cast("B")
        self._dt = dt
        self._client = _connected()
        self._close = weakref.finalize(self, pybullet.disconnect, self._client)
        self._begin()

    def close(self) -> None:
        """Free the world; its bodies are gone."""
        self._close()

    def clear(self) -> None:
        """Remove every body, and Bullet's memory of them."""
        self._pending.clear()
        if self._shapes:
            self._begin()

    def _begin(self) -> None:
        """Reset the world; a reset takes as long as a step, so unused worlds are not reset."""
        client = self._client
        # By keyword: its first positional argument is flags, and a client given there resets client 0.
        pybullet.resetSimulation(physicsClientId=client)
        pybullet.setTimeStep(self._dt, client)
        pybullet.setGravity(0.0, 0.0, 0.0, client)
        # Without it the order of contacts, and so the last bits, depend on memory addresses.
        pybullet.setPhysicsEngineParameter(deterministicOverlappingPairs=1, physicsClientId=client)
        self._shapes: dict[tuple[float, ...], int] = {}
        self._pending: dict[int, NDArray[np.void]] = {}
        self._egos: dict[int, int] = {}
        self._boxes: dict[int, tuple[int, tuple[float, ...]]] = {}
        self._egos_in_order: list[tuple[int, int]] = []

    def add(self, row: int, car: NDArray[np.void]) -> None:
        """Add a vehicle; its body is created from `bodies` before the next step of this world.

        Creating a body takes as long as three steps of one, and most episodes end before Bullet runs.

        Args:
            row: Row of the vehicle in `bodies`.
            car: Its record of `layout.PARAMETERS`.
        """
        self._pending[row] = car

    def _create_pending(self) -> None:
        """Create the bodies of added vehicles."""
        for row, car in self._pending.items():
            self._create_body(row, car)
        self._pending.clear()
        self._egos_in_order = sorted(self._egos.items())

    def _create_body(self, row: int, car: NDArray[np.void]) -> None:
        offset = (-float(car["centre_to_cog"]), 0.0, float(car["box_height"]))
        shape = self._shape(tuple(map(float, car["half_size"])), offset)
        body = self._body(shape, float(car["mass"]), tuple(map(float, car["inertia"])), EGO, EGO | BOX)
        pose = self._bodies[row, :7].tolist()
        pybullet.resetBasePositionAndOrientation(body, pose[:3], pose[3:], self._client)
        self._egos[row] = body

    def remove(self, row: int) -> None:
        """Take a vehicle out of the world."""
        if self._pending.pop(row, None) is not None:
            return
        pybullet.removeBody(self._egos.pop(row), self._client)
        self._egos_in_order = sorted(self._egos.items())

    def put(self) -> None:
        """Put the vehicles where they have come to without Bullet."""
        for row, body in self._egos_in_order:
            pose = self._bodies[row, :7].tolist()
            pybullet.resetBasePositionAndOrientation(body, pose[:3], pose[3:], self._client)

    def place_boxes(self, boxes: Mapping[int, Box]) -> None:
        """Say which boxes there are from now on.

        Args:
            boxes: By a key that stays with the road user. A key seen before is moved, one missing now is
                removed. Boxes keep their velocity through the sub-steps.
        """
        client = self._client
        if boxes and self._pending:
            self._create_pending()
        for key in self._boxes.keys() - boxes.keys():
            pybullet.removeBody(self._boxes.pop(key)[0], client)
        for key, box in boxes.items():
            size = (0.5 * box.length, 0.5 * box.width, 0.5 * box.height)
            if key in self._boxes and self._boxes[key][1] != size:
                pybullet.removeBody(self._boxes.pop(key)[0], client)
            if key not in self._boxes:
                inertia = (BOX_MASS * 10.0,) * 3
                body = self._body(self._shape(size, (0.0, 0.0, 0.0)), BOX_MASS, inertia, BOX, EGO)
                self._boxes[key] = body, size
            body = self._boxes[key][0]
            half, cos, sin = 0.5 * box.heading, np.cos(box.heading), np.sin(box.heading)
            quaternion = (0.0, 0.0, float(np.sin(half)), float(np.cos(half)))
            vx, vy = box.speed * cos - box.lateral_speed * sin, box.speed * sin + box.lateral_speed * cos
            pybullet.resetBasePositionAndOrientation(body, box.position, quaternion, client)
            pybullet.resetBaseVelocity(body, (float(vx), float(vy), 0.0), (0.0, 0.0, box.yaw_rate), client)

    def substep(self, velocities: list[list[list[float]]]) -> None:
        """Set the bodies' velocities, step Bullet, and read the bodies back.

        Args:
            velocities: Linear and angular velocity by row, nested lists of shape (E, 2, 3).
        """
        if self._pending:
            self._create_pending()
        client, motion = self._client, self._motion
        set_velocity = pybullet.resetBaseVelocity
        read_pose, read_velocity = pybullet.getBasePositionAndOrientation, pybullet.getBaseVelocity
        for row, body in self._egos_in_order:
            linear, angular = velocities[row]
            set_velocity(body, linear, angular, client)
        pybullet.stepSimulation(client)
        for row, body in self._egos_in_order:
            position, quaternion = read_pose(body, client)
            linear, angular = read_velocity(body, client)
            _ROW.pack_into(motion, row * _ROW.size, *position, *quaternion, *linear, *angular)

    def contacts(self, velocities: list[list[list[float]]]) -> Iterator[BulletContact]:
        """Yield the contacts of the last sub-step, given the velocities at its beginning."""
        points = pybullet.getContactPoints(physicsClientId=self._client)
        if not points:
            return
        rows = {body: row for row, body in self._egos_in_order}
        keys = {body: key for key, (body, _) in self._boxes.items()}
        for _, one, two, _, _, *places, normal, _, force, _, _, _, _ in points:
            if force <= 0.0:
                continue
            moving = [
                self._velocity_at(body, rows, velocities, at)
                for body, at in zip((one, two), places, strict=True)
            ]
            # The normal points from the second body to the first.
            speed = sum((there - here) * n for here, there, n in zip(*moving, normal, strict=True))
            if one not in rows:
                one, two = two, one
            yield BulletContact(rows[one], rows.get(two, -1), keys.get(two, -1), max(speed, 0.0))

    def _velocity_at(
        self, body: int, rows: Mapping[int, int], velocities: list[list[list[float]]], place: Sequence[float]
    ) -> Sequence[float]:
        """Return the velocity of a body's point before the last sub-step [m/s]."""
        centre, _ = pybullet.getBasePositionAndOrientation(body, self._client)
        moved, turned = pybullet.getBaseVelocity(body, self._client)
        linear, (p, q, r) = velocities[rows[body]] if body in rows else (moved, turned)
        # Places are from before the sub-step, and the centre has moved since.
        x, y, z = (
            at - middle + self._dt * speed for at, middle, speed in zip(place, centre, moved, strict=True)
        )
        return linear[0] + q * z - r * y, linear[1] + r * x - p * z, linear[2] + p * y - q * x

    def _shape(self, half_size: tuple[float, ...], offset: tuple[float, ...]) -> int:
        """Return a box shape, shared by all bodies of that size."""
        key = (*half_size, *offset)
        if key not in self._shapes:
            self._shapes[key] = pybullet.createCollisionShape(
                pybullet.GEOM_BOX,
                halfExtents=half_size,
                collisionFramePosition=offset,
                physicsClientId=self._client,
            )
        return self._shapes[key]

    def _body(self, shape: int, mass: float, inertia: tuple[float, ...], group: int, mask: int) -> int:
        client = self._client
        body = pybullet.createMultiBody(mass, shape, physicsClientId=client)
        pybullet.changeDynamics(
            body,
            -1,
            # Bullet's default damping stops a car 45% early.
            linearDamping=0.0,
            angularDamping=0.0,
            localInertiaDiagonal=inertia,
            lateralFriction=FRICTION,
            restitution=RESTITUTION,
            physicsClientId=client,
        )
        pybullet.setCollisionFilterGroupMask(body, -1, group, mask, client)
        return body
