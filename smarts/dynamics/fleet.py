"""All vehicles of all simulations, advanced together."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import astuple
from typing import Any

import numpy as np
from numpy.typing import NDArray

from smarts.arrays import Bools, Floats, Longs
from smarts.dynamics import chassis, free_motion, layout, readout, single_track
from smarts.dynamics.bullet import Box, BulletContact
from smarts.dynamics.bullet_worlds import BulletWorlds
from smarts.dynamics.layout import MODELS, FleetArrays
from smarts.dynamics.motion import Motion, Road, SubstepDriver, Wheels
from smarts.dynamics.tyre_faults import FLAT_TYRE, TyreFault
from smarts.errors import SmartsError
from smarts.geometry.binding import bind

DRY_ASPHALT = 0.9
"""Default friction of a road."""


class MotionError(SmartsError):
    """A vehicle's motion is not finite."""


class Fleet:
    """Vehicles in rows: row `b * egos + i` is ego `i` of simulation `b`.

    Args:
        simulations: B.
        egos: Rows per simulation; E = B * egos.
        step: [s].
        substeps: S per step.

    Attributes:
        road: The road under each row; written by the caller.
        motion: The vehicles' motion; read-only.
        wheels: Their wheels; read-only.
        contacts: Contacts in Bullet in the last step, each with its sub-step; read-only.
    """

    def __init__(self, simulations: int, egos: int, step: float = 0.1, substeps: int = 10) -> None:
        rows = simulations * egos
        self._egos = egos
        self._arrays = arrays = FleetArrays(
            cars=np.zeros(rows, layout.PARAMETERS),
            states=np.zeros(rows, layout.STATE),
            bodies=np.zeros((rows, layout.BODY_SIZE)),
            before=np.zeros((rows, 2)),
            velocities=np.zeros((rows, 2, 3)),
            controls=np.zeros((rows, 3)),
            road=np.zeros((rows, 8)),
            poses=np.zeros((rows, substeps, 3)),
            wheel_position=np.zeros((rows, layout.WHEELS, 2)),
            active=np.zeros(rows, np.bool_),
            lost=np.zeros(rows, np.bool_),
            step=float(step),
            dt=step / substeps,
        )
        self._cars, self._states, self._bodies = arrays.cars, arrays.states, arrays.bodies
        self._model = np.full(rows, -1)
        self._rows = [np.zeros(0, np.int64) for _ in MODELS]
        self._is_changed = False
        """Whether vehicles have come or gone since `_rows` was written."""
        self._bullet = BulletWorlds(arrays, simulations)
        self.road = Road(arrays.road[:, 0:4], arrays.road[:, 4:7], arrays.road[:, 7])
        self._level(slice(None))
        self.lost = _view(arrays.lost)
        """Whether the motion is no longer finite, shape (E,); `clear` these simulations."""
        self._motion = Motion(
            active=arrays.active,
            substeps=arrays.poses,
            position=arrays.poses[:, -1, 0:2],
            heading=arrays.poses[:, -1, 2],
            velocity=np.zeros((rows, 2)),
            yaw_rate=np.zeros(rows),
            acceleration=np.zeros((rows, 2)),
            steering=arrays.states["steering"],
            overhang=np.zeros(rows),
        )
        self.motion = Motion(*map(_view, self._motion))
        names = ("spin", "slip", "slip_angle", "load", "force_x", "force_y")
        wheels = {name: _view(arrays.states[name]) for name in names}
        self.wheels = Wheels(position=_view(arrays.wheel_position), **wheels)
        self.contacts: list[tuple[int, BulletContact]] = []
        self._take_controls = bind(readout.take_controls, arrays)
        self._remember_velocity = bind(readout.remember_velocity, arrays)
        self._advance_bodies = bind(chassis.advance, arrays)
        self._advance_free = bind(free_motion.advance_free, arrays)
        self._advance_dynamic = bind(single_track.advance_dynamic, arrays)
        self._advance_kinematic = bind(single_track.advance_kinematic, arrays)
        self._record_poses = bind(readout.record_poses, arrays)
        self._show_motion = bind(readout.show_motion, arrays, self._motion)
        self._show_wheels = bind(readout.show_wheels, arrays)

    def __enter__(self) -> Fleet:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Free Bullet's worlds."""
        self._bullet.close()

    def clear(self, simulation: int) -> None:
        """Take everything out of a simulation, forget its past, and make its road level and dry."""
        rows = slice(simulation * self._egos, (simulation + 1) * self._egos)
        self._bullet.clear(simulation)
        self._model[rows] = -1
        self._level(rows)
        self._arrays.active[rows], self._is_changed = False, True

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
        size: tuple[float, float] | None = None,
    ) -> None:
        """Put a vehicle on the road with wheels at speed and settled suspension.

        The caller ensures that the place is free. Where bodies overlap, Bullet pushes them apart: at
        2 m/s, within a second if they overlap a little, after some seconds if one stands in another.

        Args:
            row: Row of the vehicle; must be free.
            name: Name of the vehicle type, one of `parameters.vehicle_names`.
            position: Centre of the footprint [m].
            heading: [rad].
            speed: Forward [m/s].
            steering: Angle of an imagined wheel between the front wheels [rad]; the vehicle is on its circle
                already.
            model: One of `MODELS`.
            tyres: One of `layout.TYRE_MODELS`.
            size: Length and width of its body [m], by default those of its type.
        """
        self._cars[row] = layout.pack(name, tyres)
        car = self._cars[row]
        if size is not None:
            # Contacts use the footprint that other vehicles see, whatever the type.
            car["half_size"][:2] = 0.5 * size[0], 0.5 * size[1]
        steering = min(max(steering, -float(car["max_steering"])), float(car["max_steering"]))
        yaw_rate = speed * math.tan(steering) / float(car["cog_to_front_axle"] + car["cog_to_rear_axle"])
        self._states[row] = layout.fresh_state(car, speed, steering)
        plane = self._arrays.road[row, 4:8]
        self._bodies[row] = layout.settled_body(car, position, heading, speed, yaw_rate, plane)
        self._model[row] = MODELS.index(model)
        if model == "bullet":
            self._bullet.add(row)
        self._arrays.active[row] = self._is_changed = True
        self._arrays.poses[row] = *position, heading
        self._motion.velocity[row] = speed, yaw_rate * car["cog_to_rear_axle"]
        self._motion.yaw_rate[row] = yaw_rate
        self._motion.acceleration[row] = self._motion.overhang[row] = 0.0
        self._show_wheels()

    def despawn(self, row: int) -> None:
        """Take a vehicle off the road."""
        if self._model[row] == MODELS.index("bullet"):
            self._bullet.remove(row)
        self._model[row] = -1
        self._arrays.active[row], self._is_changed = False, True

    def lift(self, row: int, height: float) -> None:
        """Move a vehicle with the road under it to a height [m], without its feeling any of it."""
        self._bodies[row, 2] += height - self.road.offset[row]
        self.road.offset[row] = height

    def set_fault(self, row: int, wheel: int, fault: TyreFault = FLAT_TYRE) -> None:
        """Set the fault of one tyre until the vehicle despawns; `TyreFault()` removes it.

        Args:
            row: Row of the vehicle.
            wheel: 0 front left, 1 front right, 2 rear left, 3 rear right.
            fault: What is wrong.
        """
        names = ("radius_factor", "stiffness_factor", "grip_factor", "extra_resistance")
        for name, value in zip(names, astuple(fault), strict=True):
            self._states[name][row, wheel] = value

    def set_assistance(self, row: int, *, abs: bool, traction_control: bool) -> None:
        """Switch a vehicle's driver assistance; its type's file says how it spawns.

        Args:
            row: Row of the vehicle.
            abs: Whether brakes hold the wheels at the slip of largest force instead of locking them.
            traction_control: Whether the engine does so instead of spinning them. Single-track vehicles have
                both.
        """
        self._cars["abs"][row] = abs
        self._cars["traction_control"][row] = traction_control

    def body(self, row: int) -> Floats:
        """Return a copy of a vehicle's spatial motion, shape (13,), as `layout.BODY_SIZE` says."""
        return self._bodies[row].copy()

    def place_boxes(self, simulation: int, boxes: Mapping[int, Box]) -> None:
        """Set the boxes that the egos of a simulation can hit.

        Args:
            simulation: b.
            boxes: By a key that stays with the road user, at their present poses. Pass only road users within
                reach in this step (`geometry.boxes.may_meet`): a simulation with boxes runs in Bullet, which
                takes twice as long.
        """
        self._bullet.place_boxes(simulation, boxes)

    def driver(self, law: Any, *arguments: Any) -> SubstepDriver:
        """Return a driver that follows a law.

        Args:
            law: A kernel that writes `controls` of a `FleetArrays` within their bounds. It takes the
                `FleetArrays`, then the arguments, and last the rows of the vehicles that move, shape (R,).
            arguments: See `bind`.
        """
        return bind(law, self._arrays, *arguments)

    def step(
        self,
        controls: Floats,
        *,
        simulations: Bools | None = None,
        driver: SubstepDriver | None = None,
        kinematic: SubstepDriver | None = None,
    ) -> Motion:
        """Advance every vehicle by one step and return `motion`.

        Args:
            controls: Throttle in [-1, 1] (below 0 drives backwards), brake in [0, 1], steering in [-1, 1] of
                the lock (positive to the left), shape (E, 3); clipped. Rows without a vehicle are ignored.
            simulations: Which simulations make the step, shape (B,); all if not given. The others stay.
            driver: Called before each sub-step; may write the controls.
            kinematic: Moves the kinematic vehicles through all sub-steps, in place of the fleet and `driver`.

        Raises:
            MotionError: A vehicle's motion is no longer finite; see `lost`. The other vehicles have moved.
        """
        moving, rows = self._chosen(simulations)
        self._take_controls(moving, np.asarray(controls, np.float64))
        self._arrays.lost[:] = False
        self.contacts.clear()
        self._remember_velocity()
        free, touching = self._bullet.part(rows[0])
        of_model = [free, *rows[1:]]
        if kinematic is not None:
            kinematic(of_model.pop())
        driven = np.concatenate([touching, *of_model])
        kernels = self._advance_free, self._advance_dynamic, self._advance_kinematic
        advanced = [(kernel, each) for kernel, each in zip(kernels, of_model, strict=False) if each.size]
        for substep in range(self._arrays.poses.shape[1] if driven.size else 0):
            if driver is not None:
                driver(driven)
            for advance, each in advanced:
                advance(each, substep)
            if touching.size:
                self._advance_bodies(touching)
                velocities = self._arrays.velocities.tolist()
                for world in self._bullet.moving:
                    world.substep(velocities)
                    self.contacts += [(substep, contact) for contact in world.contacts(velocities)]
                self._record_poses(touching, substep)
        bad = self._show_motion(moving)
        self._show_wheels()
        if bad >= 0:
            raise self.motion_error(bad)
        return self.motion

    def motion_error(self, row: int) -> MotionError:
        """Return the error of a row that is `lost`."""
        body, road = self._bodies[row].tolist(), self._arrays.road[row].tolist()
        return MotionError(
            f"motion is no longer finite: body {body}, road (friction, normal, offset) {road}",
            place=f"vehicle in row {row}",
            remedy="give the road finite numbers, and clear the simulation",
        )

    def _chosen(self, simulations: Bools | None) -> tuple[Bools, list[Longs]]:
        """Return which rows are to move, shape (E,), and the rows of each model."""
        if self._is_changed:
            self._rows = [np.flatnonzero(self._model == number) for number in range(len(MODELS))]
            self._is_changed = False
        if simulations is None or simulations.all():
            return self._arrays.active, self._rows
        chosen = np.repeat(simulations, self._egos)
        return self._arrays.active & chosen, [of_model[chosen[of_model]] for of_model in self._rows]

    def _level(self, rows: slice) -> None:
        self.road.friction[rows] = DRY_ASPHALT
        self.road.normal[rows] = 0.0, 0.0, 1.0
        self.road.offset[rows] = 0.0


def _view(array: NDArray) -> NDArray:
    """Return a read-only view."""
    view = array.view()
    view.flags.writeable = False
    return view
