"""All vehicles of all simulations, advanced together."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import astuple, dataclass
from typing import NoReturn

import numpy as np
from numpy.typing import NDArray

from smarts.dynamics import chassis, layout, readout, single_track
from smarts.dynamics.bullet import Box, BulletWorld
from smarts.errors import SmartsError, UnknownNameError, nearest_names

Floats = NDArray[np.float64]

MODELS = ("bullet", "dynamic", "kinematic")
"""A car in Bullet on four wheels; a planar single track with tyre forces; one that goes where it is
steered."""
DRY_ASPHALT = 0.9
"""Friction of a road that nobody described."""


class ControlError(SmartsError):
    """Controls that no vehicle can follow, or a row that cannot take a vehicle."""


class MotionError(SmartsError):
    """A vehicle's motion has left the finite numbers."""


@dataclass(frozen=True)
class TyreFault:
    """What is wrong with one tyre. The default is a sound tyre."""

    radius: float = 1.0
    """Factor on the rolling radius."""
    stiffness: float = 1.0
    """Factor on slip and carcass stiffness."""
    grip: float = 1.0
    """Factor on the road's friction."""
    resistance: float = 0.0
    """Rolling resistance over load that comes on top."""


SOUND_TYRE = TyreFault()
FLAT_TYRE = TyreFault(radius=0.93, stiffness=0.3, grip=0.7, resistance=0.1)
"""An aired-out tyre: orders of magnitude only, no measured set lies behind them."""


@dataclass(frozen=True)
class Road:
    """The road under each vehicle. Written by whoever knows it, kept until written again."""

    friction: Floats
    """Largest longitudinal force over load at each wheel, shape (E, 4)."""
    normal: Floats
    """Unit normal of the plane that the vehicle drives on, shape (E, 3). Only "bullet" vehicles know
    slopes."""
    offset: Floats
    """Distance of that plane from the origin along the normal [m], shape (E,)."""


@dataclass(frozen=True)
class Motion:
    """How the vehicles move; row *i* of every array is vehicle *i*.

    The arrays are read-only and overwritten by the next step.
    """

    active: NDArray[np.bool_]
    """Whether the row holds a vehicle; the other values of a row without are meaningless. Shape (E,)."""
    substeps: Floats
    """x, y of the footprint's centre [m] and heading [rad] after each sub-step, shape (E, S, 3)."""
    position: Floats
    """Centre of the footprint [m], shape (E, 2)."""
    heading: Floats
    """[rad], shape (E,)."""
    velocity: Floats
    """Of the centre of gravity, forward and left [m/s], shape (E, 2)."""
    yaw_rate: Floats
    """[rad/s], shape (E,)."""
    acceleration: Floats
    """Of the centre of gravity, forward and left, the mean over the step [m/s^2], shape (E, 2)."""
    steering: Floats
    """Angle of an imagined wheel between the front wheels, positive to the left [rad], shape (E,)."""


@dataclass(frozen=True)
class Wheels:
    """The wheels after the last sub-step, shape (E, 4): front left, front right, rear left, rear right."""

    position: Floats
    """Where they stand on the map [m], shape (E, 4, 2): there the road's friction is to be looked up."""
    spin: Floats
    """[rad/s]."""
    slip: Floats
    """Longitudinal slip at the contact, positive when driving. Zero for single-track vehicles."""
    slip_angle: Floats
    """[rad], positive when the tyre pushes to the left."""
    load: Floats
    """[N]."""
    force_x: Floats
    """Of the tyre along its heading [N]."""
    force_y: Floats
    """Of the tyre to its left [N]."""


class Fleet:
    """Vehicles in rows: row `b * egos + i` is ego `i` of simulation `b`.

    Args:
        simulations: B.
        egos: Rows per simulation; E = B * egos.
        step: [s].
        substeps: S per step.

    Attributes:
        road: The road under each row, to be written.
        motion: How the vehicles move, to be read.
        wheels: What their wheels do, to be read.
    """

    def __init__(self, simulations: int, egos: int, step: float = 0.1, substeps: int = 10) -> None:
        rows = simulations * egos
        self._egos, self._step, self._dt = egos, step, step / substeps
        self._cars = np.zeros(rows, layout.PARAMETERS)
        self._states = np.zeros(rows, layout.STATE)
        self._bodies = np.zeros((rows, layout.BODY_SIZE))
        self._velocities = np.zeros((rows, 2, 3))
        self._before = np.zeros((rows, 2))
        self._controls = np.zeros((rows, 3))
        self._model = np.full(rows, -1)
        self._rows = [np.zeros(0, np.int64) for _ in MODELS]
        self._worlds = [BulletWorld(self._bodies, self._dt) for _ in range(simulations)]

        self._road = np.zeros((rows, 8))
        self.road = Road(self._road[:, 0:4], self._road[:, 4:7], self._road[:, 7])
        self._level(slice(None))
        self._active = np.zeros(rows, np.bool_)
        self._poses = np.zeros((rows, substeps, 3))
        self._velocity, self._yaw_rate = np.zeros((rows, 2)), np.zeros(rows)
        self._acceleration = np.zeros((rows, 2))
        self.motion = Motion(
            active=_view(self._active),
            substeps=_view(self._poses),
            position=_view(self._poses[:, -1, 0:2]),
            heading=_view(self._poses[:, -1, 2]),
            velocity=_view(self._velocity),
            yaw_rate=_view(self._yaw_rate),
            acceleration=_view(self._acceleration),
            steering=_view(self._states["steering"]),
        )
        self._wheel_position = np.zeros((rows, layout.WHEELS, 2))
        names = ("spin", "slip", "slip_angle", "load", "force_x", "force_y")
        self.wheels = Wheels(
            position=_view(self._wheel_position), **{name: _view(self._states[name]) for name in names}
        )

    def __enter__(self) -> Fleet:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Free Bullet's worlds."""
        for world in self._worlds:
            world.close()

    def clear(self, simulation: int) -> None:
        """Take everything out of a simulation, forget its past, and make its road level and dry.

        Raises:
            ControlError: There is no such simulation.
        """
        self._require_simulation(simulation)
        rows = slice(simulation * self._egos, (simulation + 1) * self._egos)
        self._worlds[simulation].clear()
        self._model[rows] = -1
        self._level(rows)
        self._index()

    def spawn(
        self,
        row: int,
        name: str,
        position: tuple[float, float],
        heading: float,
        speed: float = 0.0,
        *,
        steering: float = 0.0,
        model: str = "bullet",
        tyres: str = "pacejka",
    ) -> None:
        """Put a vehicle on the road as if it had always rolled there: wheels at speed, suspension settled.

        Whether the place is free is for the caller to know: bodies that overlap in Bullet are pushed apart
        within a few steps, at speeds of their own.

        Args:
            row: Of the vehicle; must be free.
            name: Of the vehicle type, one of `parameters.vehicle_names`.
            position: Centre of the footprint [m].
            heading: [rad].
            speed: Forward [m/s].
            steering: Angle of an imagined wheel between the front wheels [rad]; the vehicle is on its circle
                already.
            model: One of `MODELS`.
            tyres: One of `layout.TYRE_MODELS`.

        Raises:
            ControlError: There is no such row, it holds a vehicle, or a number is not finite.
            UnknownNameError: A name is unknown.
        """
        self._require_row(row)
        place = f"vehicle in row {row}"
        for kind, given, known in (("model", model, MODELS), ("tyre model", tyres, layout.TYRE_MODELS)):
            if given not in known:
                raise UnknownNameError(
                    f"no {kind} {given!r}", place=place, remedy=nearest_names(given, known)
                )
        if self._model[row] >= 0:
            raise ControlError("the row is taken", place=place, remedy="despawn its vehicle first")
        if not np.isfinite([*position, heading, speed, steering]).all():
            raise ControlError(
                f"position {position}, heading {heading}, speed {speed}, steering {steering}: not all finite",
                place=place,
                remedy="give finite numbers",
            )
        self._cars[row] = car = layout.pack(name, tyres)
        steering = min(max(steering, -float(car["max_steering"])), float(car["max_steering"]))
        yaw_rate = speed * math.tan(steering) / float(car["cog_to_front_axle"] + car["cog_to_rear_axle"])
        self._states[row] = layout.fresh_state(car, speed, steering)
        self._bodies[row] = layout.settled_body(car, position, heading, speed, yaw_rate, self._road[row, 4:8])
        self._model[row] = MODELS.index(model)
        if model == "bullet":
            self._worlds[row // self._egos].add(row, car, self._bodies[row])
        self._index()
        self._poses[row] = *position, heading
        self._velocity[row] = speed, yaw_rate * car["cog_to_rear_axle"]
        self._yaw_rate[row] = yaw_rate
        self._acceleration[row] = 0.0
        readout.show_wheels(self._active, self._cars, self._poses, self._wheel_position)

    def despawn(self, row: int) -> None:
        """Take a vehicle off the road.

        Raises:
            ControlError: There is none.
        """
        self._require_vehicle(row)
        if self._model[row] == MODELS.index("bullet"):
            self._worlds[row // self._egos].remove(row)
        self._model[row] = -1
        self._index()

    def set_fault(self, row: int, wheel: int, fault: TyreFault = FLAT_TYRE) -> None:
        """Let one tyre of a vehicle fail, or mend it with `SOUND_TYRE`. It lasts until the vehicle despawns.

        Args:
            row: Of the vehicle.
            wheel: 0 front left, 1 front right, 2 rear left, 3 rear right.
            fault: What is wrong.

        Raises:
            ControlError: There is no such vehicle or wheel.
        """
        self._require_vehicle(row)
        if not 0 <= wheel < layout.WHEELS:
            raise ControlError(
                f"there is no wheel {wheel}", place=f"vehicle in row {row}", remedy="wheels are 0 to 3"
            )
        names = ("radius_factor", "stiffness_factor", "grip_factor", "extra_resistance")
        for name, value in zip(names, astuple(fault), strict=True):
            self._states[name][row, wheel] = value

    def set_assistance(self, row: int, *, abs: bool, traction_control: bool) -> None:
        """Switch a vehicle's driver assistance; its type's file says how it spawns.

        Args:
            row: Of the vehicle.
            abs: Whether brakes hold the wheels at the slip of largest force instead of locking them.
            traction_control: Whether the engine does so instead of spinning them. Single-track vehicles have
                both.

        Raises:
            ControlError: There is no such vehicle.
        """
        self._require_vehicle(row)
        self._cars["abs"][row] = abs
        self._cars["traction_control"][row] = traction_control

    def body(self, row: int) -> Floats:
        """Return a copy of a vehicle's spatial motion, shape (13,), as `layout.BODY_SIZE` says.

        Raises:
            ControlError: There is no such vehicle.
        """
        self._require_vehicle(row)
        return self._bodies[row].copy()

    def put_body(self, row: int, body: Floats) -> None:
        """Give a vehicle in Bullet another spatial motion, as `layout.BODY_SIZE` says; wheels keep theirs.

        Raises:
            ControlError: There is no such vehicle, it is not in Bullet, or a number is not finite.
        """
        self._require_vehicle(row)
        body = np.asarray(body, np.float64)
        if self._model[row] != MODELS.index("bullet") or not np.isfinite(body).all():
            raise ControlError(
                f"body {body.tolist()} for a vehicle of model '{MODELS[self._model[row]]}'",
                place=f"vehicle in row {row}",
                remedy="give finite numbers, to a vehicle of model 'bullet'",
            )
        world = self._worlds[row // self._egos]
        world.remove(row)
        self._bodies[row] = body
        world.add(row, self._cars[row], body)

    def place_boxes(self, simulation: int, boxes: Mapping[int, Box]) -> None:
        """Say which road users that others drive egos of a simulation can hit from now on.

        Args:
            simulation: b.
            boxes: By a key that stays with the road user. Name those near an ego only, and where they are
                now: each costs two calls a step, coming and going 0.1 ms.

        Raises:
            ControlError: There is no such simulation.
        """
        self._require_simulation(simulation)
        self._worlds[simulation].place_boxes(boxes)

    def step(self, controls: Floats) -> Motion:
        """Advance every vehicle by one step and return `motion`.

        Args:
            controls: Throttle in [-1, 1] (below 0 drives backwards), brake in [0, 1], steering in [-1, 1] of
                the lock (positive to the left), shape (E, 3); clipped. Rows without a vehicle are ignored.

        Raises:
            ControlError: A control is NaN, or their shape is wrong. Nothing has moved.
            MotionError: A vehicle's motion is no longer finite.
        """
        controls = np.asarray(controls, np.float64)
        if controls.shape != self._controls.shape:
            raise ControlError(
                f"controls have shape {controls.shape}", remedy=f"send shape {self._controls.shape}"
            )
        bad = readout.take_controls(self._active, controls, self._controls)
        if bad >= 0:
            raise ControlError(
                f"controls {controls[bad].tolist()} (throttle, brake, steering) are not numbers",
                place=f"vehicle in row {bad}",
                remedy="send finite controls",
            )
        readout.remember_velocity(self._bodies, self._before)
        in_bullet, dynamic, kinematic = self._rows
        if in_bullet.size:
            self._step_bullet(in_bullet)
        shared = (self._cars, self._states, self._bodies, self._controls, self._road, self._poses, self._dt)
        if dynamic.size:
            single_track.advance_dynamic(dynamic, *shared)
        if kinematic.size:
            single_track.advance_kinematic(kinematic, *shared)
        bad = readout.show_motion(
            self._active,
            self._bodies,
            self._before,
            self._velocity,
            self._yaw_rate,
            self._acceleration,
            self._step,
        )
        if bad >= 0:
            self._refuse_motion(bad)
        readout.show_wheels(self._active, self._cars, self._poses, self._wheel_position)
        return self.motion

    def _step_bullet(self, rows: NDArray[np.int64]) -> None:
        """Advance the vehicles in Bullet: forces before each sub-step, all simulations in one call."""
        cars, states, bodies, velocities = self._cars, self._states, self._bodies, self._velocities
        for substep in range(self._poses.shape[1]):
            bad = chassis.advance(
                rows, cars, states, bodies, self._controls, self._road, velocities, self._dt
            )
            if bad >= 0:
                self._refuse_motion(bad)
            commands = velocities.tolist()
            for world in self._worlds:
                world.substep(commands)
            readout.record_poses(rows, cars, bodies, self._poses, substep)

    def _refuse_motion(self, row: int) -> NoReturn:
        body, road = self._bodies[row].tolist(), self._road[row].tolist()
        raise MotionError(
            f"motion is no longer finite: body {body}, road (friction, normal, offset) {road}",
            place=f"vehicle in row {row}",
            remedy="see that the road is of finite numbers, then clear the simulation",
        )

    def _require_row(self, row: int) -> None:
        # A negative number would be another row to NumPy, but not to Bullet.
        if not 0 <= row < len(self._model):
            raise ControlError(f"there is no row {row}", remedy=f"rows go from 0 to {len(self._model) - 1}")

    def _require_vehicle(self, row: int) -> None:
        self._require_row(row)
        if self._model[row] < 0:
            raise ControlError("there is no vehicle", place=f"row {row}", remedy="spawn one first")

    def _require_simulation(self, simulation: int) -> None:
        if not 0 <= simulation < len(self._worlds):
            raise ControlError(
                f"there is no simulation {simulation}",
                remedy=f"simulations go from 0 to {len(self._worlds) - 1}",
            )

    def _level(self, rows: slice) -> None:
        self.road.friction[rows] = DRY_ASPHALT
        self.road.normal[rows] = 0.0, 0.0, 1.0
        self.road.offset[rows] = 0.0

    def _index(self) -> None:
        self._rows = [np.flatnonzero(self._model == number) for number in range(len(MODELS))]
        self._active[:] = self._model >= 0


def _view(array: NDArray) -> NDArray:
    """Return a read-only view."""
    view = array.view()
    view.flags.writeable = False
    return view
