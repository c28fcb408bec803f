"""The vehicle provider: moves the vehicles of agents by their commands."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from smarts.arrays import Bools, Bytes, Ints
from smarts.controllers import tracking
from smarts.dynamics import MODELS, Box, Fleet, MotionError, SubstepDriver, vehicle, vehicle_names
from smarts.dynamics.performance import Abilities
from smarts.errors import SmartsError
from smarts.geometry.binding import LateBound, bind
from smarts.providers.gates import NEAR, SOON, find_too_close
from smarts.providers.vehicle_kernels import (
    NOWHERE,
    AgentGroups,
    FleetSlots,
    find_changes,
    find_touchable,
    group_agents,
    place_vehicles,
    write_motion,
)
from smarts.providers.vehicle_surface import DRY, RoadSurfaces
from smarts.types import columns
from smarts.types.actions import Commands
from smarts.types.tracks import Tracks
from smarts.types.transfers import Refusal
from smarts.types.vehicles import VehicleKind
from smarts.types.world import World

SUBSTEPS = 10
TYPES = {kind: kind.name.lower() for kind in VehicleKind if kind.name.lower() in vehicle_names()}
"""Vehicle type of `smarts.dynamics` of each kind that agents can drive."""
_IS_DRIVABLE = np.array([kind in TYPES for kind in VehicleKind])
FASTEST_SIDEWAYS = 1.5
"""Lateral speed of the rear axle above which a vehicle is not taken over: an agent's vehicle begins without
it, so this is how far off its course it is, per second. SUMO's lane changes are slower [m/s]."""


class FleetVehicles:
    """The stage that moves the agents' vehicles of all simulations, in one `Fleet`.

    `world.agents.slot` is the agent's vehicle. A vehicle that an agent takes over keeps its pose, velocity
    and yaw rate; its steering is derived from these. Vehicles that are commanded by poses are not in the
    fleet: they are placed by their commands, and other vehicles collide with them as with traffic.

    Args:
        world: The world, read and written.
        models: The dynamics model of each agent's vehicle (`smarts.dynamics.MODELS`), shape (A,) or one name.
        surfaces: Friction patches of all maps.
        tyres: The tyre model of each agent's vehicle, shape (A,) or one name.
        flat_tyres: Wheels with a flat tyre when the agent's vehicle spawns, by agent.
    """

    def __init__(
        self,
        world: World,
        models: str | Sequence[str] = "bullet",
        *,
        surfaces: RoadSurfaces | None = None,
        tyres: str | Sequence[str] = "pacejka",
        flat_tyres: Mapping[int, Sequence[int]] | None = None,
    ) -> None:
        worlds, agents = world.agents.slot.shape
        self._agents = agents
        self.failures: dict[int, SmartsError] = {}
        """Errors of the last step, by simulation: a motion that is no longer finite."""
        self._models = [models] * agents if isinstance(models, str) else list(models)
        self.fleet = Fleet(worlds, agents, step=world.dt, substeps=SUBSTEPS)
        """Row b * A + a is the vehicle of agent a of simulation b."""
        self._world = world
        self._surfaces = surfaces
        self._tyres = [tyres] * agents if isinstance(tyres, str) else list(tyres)
        self._flat_tyres = flat_tyres or {}
        shape = (worlds, agents)
        self._fleet_slots = columns.allocate(FleetSlots, shape, unset=("slot",))
        self._has_tyre_slip = np.tile([model != "kinematic" for model in self._models], worlds)
        self._memory = np.zeros((worlds * agents, tracking.MEMORY))
        self._tracks = Tracks.allocate(worlds, agents, world.vehicles.capacity, SUBSTEPS)
        self._no_controls = np.zeros((worlds * agents, 3))
        self._applied_controls = np.zeros((worlds * agents, 3))
        self._abilities = Abilities.of_all()
        self._boxed = np.zeros(world.vehicles.alive.shape, np.bool_)
        self._with_boxes: set[int] = set()
        self._has_contacts = False
        self._groups = columns.allocate(AgentGroups, shape)
        state, motion = world.state, self.fleet.motion
        is_bullet = np.array([model == MODELS[0] for model in self._models])
        self._group_agents = LateBound(group_agents, state, is_bullet, self._groups)
        self._find_changes = bind(find_changes, state, self._groups, self._fleet_slots)
        self._write_motion = bind(
            write_motion,
            state,
            motion,
            self._applied_controls,
            self._tracks,
            self._groups,
            self.fleet.road.offset,
        )
        self._place = LateBound(place_vehicles, state, self._tracks, self._groups)
        self._find_touchable = bind(find_touchable, state, motion, self._groups, self._boxed)
        self._find_too_close = bind(find_too_close, world.vehicles)
        self._drivers: tuple[Commands, list[SubstepDriver]] | None = None

    def reset(self, env_mask: Bools) -> None:
        """Remove the vehicles of some simulations from the fleet; vehicles in their rows now are new.

        Args:
            env_mask: The simulations to reset, shape (B,).
        """
        for row in np.flatnonzero(env_mask).tolist():
            self.fleet.clear(row)
            self._fleet_slots.slot[row] = NOWHERE
            self._boxed[row] = False
            self._with_boxes.discard(row)
            self._tracks.poses[row] = 0.0

    def step(self, commands: Commands, env_mask: Bools) -> Tracks:
        """Move the vehicles of active agents by one step.

        Args:
            commands: Commands of the controllers.
            env_mask: The simulations to step, shape (B,).

        Returns:
            The vehicles' poses and contacts within the step, overwritten by the next step. They are undefined
            for simulations in `failures`.
        """
        self.failures = {}
        if self._has_contacts:
            self._tracks.touched[:] = 0
            self._tracks.touch_speed[:] = 0.0
            self._has_contacts = False
        placed, driven = self._group_agents.to(commands)(env_mask)
        if self._find_changes(env_mask):
            self._update_fleet()
        if placed:
            self._place.to(commands)()
        if driven:
            self._drive(commands, env_mask)
        return self._tracks

    @property
    def columns(self) -> tuple[NDArray, ...]:
        """Arrays with an entry per agent, cleared when another agent takes its place, shape (B, A, ...)."""
        shape = self._fleet_slots.slot.shape
        # No vehicle has generation 0, so the fleet spawns the next vehicle even if its slot is the same.
        kept = (
            self._fleet_slots.generation,
            self._memory.reshape(*shape, -1),
            self._applied_controls.reshape(*shape, -1),
        )
        return (*self._tracks, *kept)

    def can_accept(self, rows: Ints, slots: Ints) -> Bytes:
        """Return for each vehicle whether an agent can drive it from now on, as a `Refusal`, shape (N,).

        KIND: there is no model of such vehicles. TOO_CLOSE: another vehicle is within `NEAR`, now or `SOON`.
        SIDEWAYS: traffic moves its rear axle sideways as no vehicle drives, faster than `FASTEST_SIDEWAYS`.

        Args:
            rows: Simulation of each vehicle, shape (N,).
            slots: Slot of each vehicle, shape (N,).
        """
        found = np.zeros(len(rows), np.bool_)
        self._find_too_close(rows, slots, NEAR, SOON, found)
        answers = np.where(found, Refusal.TOO_CLOSE, Refusal.NONE)
        vehicles = self._world.vehicles
        kinds, centre_to_rear = vehicles.kind[rows, slots], self._abilities.centre_to_rear
        sideways = (
            vehicles.lateral_speed[rows, slots] - vehicles.yaw_rate[rows, slots] * centre_to_rear[kinds]
        )
        answers[np.abs(sideways) > FASTEST_SIDEWAYS] = Refusal.SIDEWAYS
        answers[~_IS_DRIVABLE[kinds]] = Refusal.KIND
        return answers.astype(np.int8)

    def close(self) -> None:
        """Free Bullet's worlds."""
        self.fleet.close()

    def _drivers_of(self, commands: Commands) -> list[SubstepDriver]:
        """Return what drives the fleet by `commands`: in each sub-step, and kinematic vehicles in a step."""
        if self._drivers is None or self._drivers[0] is not commands:
            count, reference = len(self._no_controls), commands.reference
            followed = tracking.Followed(
                commands.mode.reshape(count),
                commands.actuators.reshape(count, 3),
                reference.reshape(count, *reference.shape[2:]),
                commands.reference_length.reshape(count),
                commands.window.reshape(count),
                self._has_tyre_slip,
                self._memory,
                self._applied_controls,
            )
            laws = tracking.drive, tracking.drive_kinematic
            self._drivers = commands, [self.fleet.driver(law, followed) for law in laws]
        return self._drivers[1]

    def _drive(self, commands: Commands, env_mask: Bools) -> None:
        """Advance the fleet and write its motion into the world."""
        self._place_boxes(env_mask)
        if self._surfaces is not None:
            self._surfaces.look_up(self._world, self._groups.driven, self.fleet)
        try:
            driver, kinematic = self._drivers_of(commands)
            self.fleet.step(self._no_controls, simulations=env_mask, driver=driver, kinematic=kinematic)
        except MotionError:
            for number in np.flatnonzero(self.fleet.lost).tolist():
                row = number // self._agents
                self.failures.setdefault(row, self.fleet.motion_error(number))
                self._groups.driven[row] = False
        if self._write_motion():
            for row, agent_id in np.argwhere(self._groups.driven).tolist():
                height = self._world.vehicles.height[row, self._fleet_slots.slot[row, agent_id]]
                self.fleet.lift(row * self._agents + agent_id, float(height))
        if self.fleet.contacts:
            self._record_contacts()

    def _record_contacts(self) -> None:
        """Record each Bullet contact for both vehicles."""
        self._has_contacts = True
        capacity, agents = self._world.vehicles.capacity, self._agents
        for substep, contact in self.fleet.contacts:
            row, agent_id = divmod(contact.row, agents)
            slot = (
                contact.box % capacity
                if contact.other_row < 0
                else self._fleet_slots.slot[row, contact.other_row % agents]
            )
            self._record_contact(row, agent_id, slot, substep, contact.speed)
            for other in np.flatnonzero(self._world.agents.slot[row] == slot).tolist():
                self._record_contact(
                    row, other, self._fleet_slots.slot[row, agent_id], substep, contact.speed
                )

    def _record_contact(self, row: int, agent_id: int, slot: int, substep: int, speed: float) -> None:
        tracks = self._tracks
        if not tracks.touched[row, agent_id, slot]:
            tracks.touched[row, agent_id, slot] = substep + 1
            tracks.touch_speed[row, agent_id, slot] = speed

    def _update_fleet(self) -> None:
        """Spawn and despawn vehicles of the fleet by `target_slot`."""
        agents, target_slot = self._world.agents, self._fleet_slots.target_slot
        changed = (target_slot != self._fleet_slots.slot) | (
            self._groups.active & (agents.generation != self._fleet_slots.generation)
        )
        for row, agent_id in np.argwhere(changed).tolist():
            number = row * self._agents + agent_id
            if self._fleet_slots.slot[row, agent_id] >= 0:
                self.fleet.despawn(number)
            self._fleet_slots.slot[row, agent_id] = target_slot[row, agent_id]
            self._fleet_slots.generation[row, agent_id] = agents.generation[row, agent_id]
            if target_slot[row, agent_id] >= 0:
                self._spawn(row, agent_id, number)

    def _spawn(self, row: int, agent_id: int, number: int) -> None:
        """Spawn an agent's vehicle in the fleet with the motion in its row of the world."""
        vehicles = self._world.vehicles
        slot = int(self._fleet_slots.slot[row, agent_id])
        name = TYPES[VehicleKind(int(vehicles.kind[row, slot]))]
        x, y = vehicles.position[row, slot].tolist()
        speed, heading = float(vehicles.speed[row, slot]), float(vehicles.heading[row, slot])
        wheelbase = vehicle(name).wheelbase
        yaw_rate = float(vehicles.yaw_rate[row, slot])
        steering = math.atan(wheelbase * yaw_rate / speed) if speed > 1.0 else 0.0
        self.fleet.spawn(
            number,
            name,
            (x, y),
            heading,
            speed,
            steering=steering,
            model=self._models[agent_id],
            tyres=self._tyres[agent_id],
            size=(float(vehicles.length[row, slot]), float(vehicles.width[row, slot])),
        )
        for wheel in self._flat_tyres.get(agent_id, ()):
            self.fleet.set_fault(number, wheel)
        self._memory[number] = 0.0
        self._memory[number, tracking.CURVATURE] = math.tan(steering) / wheelbase
        self.fleet.road.friction[number] = DRY
        self.fleet.lift(number, float(vehicles.height[row, slot]))

    def _place_boxes(self, env_mask: Bools) -> None:
        """Place the road users that Bullet's vehicles may touch as boxes in Bullet."""
        if not self._find_touchable(env_mask) and not self._with_boxes:
            return
        for row in np.flatnonzero(env_mask).tolist():
            slots = np.flatnonzero(self._boxed[row]).tolist()
            if slots or row in self._with_boxes:
                self.fleet.place_boxes(row, {self._key(row, slot): self._box(row, slot) for slot in slots})
            if slots:
                self._with_boxes.add(row)
            else:
                self._with_boxes.discard(row)

    def _key(self, row: int, slot: int) -> int:
        return int(self._world.vehicles.generation[row, slot]) * self._world.vehicles.capacity + slot

    def _box(self, row: int, slot: int) -> Box:
        vehicles = self._world.vehicles
        kind = VehicleKind(int(vehicles.kind[row, slot]))
        height = vehicle(TYPES.get(kind, "truck")).height
        x, y = vehicles.position[row, slot].tolist()
        speed, sideways = float(vehicles.speed[row, slot]), float(vehicles.lateral_speed[row, slot])
        yaw_rate = float(vehicles.yaw_rate[row, slot])
        # In a bend, the box moves along its heading at the middle of the step.
        ahead = 0.5 * self._world.dt * yaw_rate
        cos, sin = math.cos(ahead), math.sin(ahead)
        return Box(
            (x, y, float(vehicles.height[row, slot]) + 0.5 * height),
            float(vehicles.heading[row, slot]),
            speed * cos - sideways * sin,
            float(vehicles.length[row, slot]),
            float(vehicles.width[row, slot]),
            height,
            speed * sin + sideways * cos,
            yaw_rate,
        )
