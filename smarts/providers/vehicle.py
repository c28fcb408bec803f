"""The vehicle provider: moves the vehicles of agents as their commands say."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from smarts.arrays import Bools, Bytes, Ints
from smarts.controllers import tracking
from smarts.dynamics import MODELS, Box, Fleet, MotionError, SubstepDriver, vehicle
from smarts.errors import ActionError, SmartsError
from smarts.geometry.binding import LateBound, bind
from smarts.providers.vehicle_kernels import (
    NOWHERE,
    AgentGroups,
    HeldVehicles,
    find_changes,
    find_touchable,
    group_agents,
    place_vehicles,
    show_vehicles,
)
from smarts.providers.vehicle_surface import DRY, RoadSurfaces
from smarts.types.actions import CommandMode, Commands
from smarts.types.tracks import Tracks
from smarts.types.transfers import Refusal
from smarts.types.vehicles import VehicleKind
from smarts.types.world import World

SUBSTEPS = 10
TYPES = {kind: kind.name.lower() for kind in VehicleKind if kind != VehicleKind.TRAILER}
"""The type of `smarts.dynamics` that a kind of vehicle drives like; a trailer does not drive."""


class FleetVehicles:
    """All agents' vehicles of all simulations, in one `Fleet`: the stage that moves them.

    The world says which vehicle an agent drives. A vehicle that an agent takes over continues from its row:
    pose, velocity, yaw rate, steering on the circle that it drives. Vehicles that are commanded by poses are
    not in the fleet; they stand where commands put them, and the others collide with them as with traffic.

    Args:
        world: What is to be read and written.
        models: How each agent's vehicle moves, one of `smarts.dynamics.MODELS`, shape (A,) or one for all.
        surfaces: Friction patches by map.
        tyres: The tyre model of each agent's vehicle, shape (A,) or one for all.
        flat_tyres: Wheels of each agent's vehicle whose tyre is flat when it spawns, by agent.
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
        self.failures: dict[int, SmartsError] = {}
        """Errors of the last step by row: commands or motions that are not finite."""
        self._models = [models] * agents if isinstance(models, str) else list(models)
        self.fleet = Fleet(worlds, agents, step=world.dt, substeps=SUBSTEPS)
        """For read-outs and faults; row b * A + a is the vehicle of agent a of simulation b."""
        self._world = world
        self._surfaces = surfaces
        self._tyres = [tyres] * agents if isinstance(tyres, str) else list(tyres)
        self._flat_tyres = flat_tyres or {}
        shape = (worlds, agents)
        self._held = HeldVehicles(
            np.full(shape, NOWHERE, np.int32), np.zeros(shape, np.int32), np.zeros(shape, np.int32)
        )
        self._slips = np.tile([model != "kinematic" for model in self._models], worlds)
        self._memory = np.zeros((worlds * agents, tracking.MEMORY))
        self._tracks = Tracks.allocate(worlds, agents, world.vehicles.capacity, SUBSTEPS)
        self._no_controls = np.zeros((worlds * agents, 3))
        self._shown = np.zeros((worlds * agents, 3))
        self._boxed = np.zeros(world.vehicles.alive.shape, np.bool_)
        self._with_boxes: set[int] = set()
        self._has_contacts = False
        self._groups = AgentGroups(*(np.zeros((worlds, agents), np.bool_) for _ in AgentGroups._fields))
        state, motion = world.state, self.fleet.motion
        is_bullet = np.array([model == MODELS[0] for model in self._models])
        self._group_agents = LateBound(group_agents, state, is_bullet, self._groups)
        self._find_bad = LateBound(tracking.first_bad_command)
        self._find_changes = bind(find_changes, state, self._groups, self._held)
        self._show = bind(show_vehicles, state, motion, self._shown, self._tracks, self._groups)
        self._place = LateBound(place_vehicles, state, self._tracks, self._groups)
        self._find_touchable = bind(find_touchable, state, motion, self._groups, self._boxed)
        self._driver: tuple[Commands, SubstepDriver] | None = None

    def reset(self, env_mask: Bools) -> None:
        """Clear the vehicles of some simulations; their rows hold new ones."""
        for row in np.flatnonzero(env_mask).tolist():
            self.fleet.clear(row)
            self._held.slot[row] = NOWHERE
            self._boxed[row] = False
            self._with_boxes.discard(row)
            self._tracks.poses[row] = 0.0

    def step(self, commands: Commands, env_mask: Bools) -> Tracks:
        """Move the vehicles of active agents by one step; return how.

        Args:
            commands: From the controllers.
            env_mask: Which simulations make the step, shape (B,).

        Returns:
            Refilled by the next step. Those of simulations that are in `failures` after it mean nothing.
        """
        self.failures = failures = {}
        if self._has_contacts:
            self._tracks.touched[:] = 0
            self._tracks.touch_speed[:] = 0.0
            self._has_contacts = False
        placed, driven = self._group_agents.to(commands)(env_mask)
        while (bad := self._find_bad.to(commands)(self._groups.active)) >= 0:
            row = bad // self._held.slot.shape[1]
            failures[row] = self._refusal(commands, bad)
            env_mask = env_mask.copy()
            env_mask[row] = False
            placed, driven = self._group_agents.to(commands)(env_mask)
        if self._find_changes(env_mask):
            self._follow_ownership()
        if placed:
            self._place.to(commands)()
        if driven:
            self._drive(commands, env_mask)
        return self._tracks

    @property
    def columns(self) -> tuple[NDArray, ...]:
        """What is kept of each agent's vehicle, to be cleared for another agent, shape (B, A, ...)."""
        shape = self._held.slot.shape
        # A generation of 0 is no vehicle's, so the next vehicle is new to the fleet, even if it is the last.
        kept = (self._held.generation, self._memory.reshape(*shape, -1), self._shown.reshape(*shape, -1))
        return (*self._tracks, *kept)

    def can_accept(self, rows: Ints, slots: Ints) -> Bytes:
        """Return for each vehicle the `Refusal` to let an agent drive it: some kinds have no model."""
        can_drive = np.isin(self._world.vehicles.kind[rows, slots], [int(kind) for kind in TYPES])
        return np.where(can_drive, Refusal.NONE, Refusal.KIND).astype(np.int8)

    def close(self) -> None:
        """Give back Bullet's worlds."""
        self.fleet.close()

    def _driver_of(self, commands: Commands) -> SubstepDriver:
        """Return what writes the fleet's controls; a set of controllers keeps its commands' arrays."""
        if self._driver is not None and self._driver[0] is commands:
            return self._driver[1]
        count, reference = len(self._no_controls), commands.reference
        driver = self.fleet.driver(
            tracking.drive,
            commands.mode.reshape(count),
            commands.actuators.reshape(count, 3),
            reference.reshape(count, *reference.shape[2:]),
            commands.reference_length.reshape(count),
            commands.window.reshape(count),
            self._slips,
            self._memory,
            self._shown,
        )
        self._driver = commands, driver
        return driver

    def _drive(self, commands: Commands, env_mask: Bools) -> None:
        """Advance the fleet, and write its motion into the world."""
        self._place_boxes(env_mask)
        if self._surfaces is not None:
            self._surfaces.look_up(self._world, self._groups.driven, self.fleet)
        try:
            self.fleet.step(self._no_controls, simulations=env_mask, driver=self._driver_of(commands))
        except MotionError:
            for number in np.flatnonzero(self.fleet.lost).tolist():
                row = number // self._held.slot.shape[1]
                self.failures.setdefault(row, self.fleet.motion_error(number))
                self._groups.driven[row] = False
        self._show()
        if self.fleet.contacts:
            self._record_contacts()

    def _record_contacts(self) -> None:
        """Record each Bullet contact for both vehicles."""
        self._has_contacts = True
        capacity, agents = self._world.vehicles.capacity, self._held.slot.shape[1]
        for substep, contact in self.fleet.contacts:
            row, agent_id = divmod(contact.row, agents)
            slot = (
                contact.box % capacity
                if contact.other_row < 0
                else self._held.slot[row, contact.other_row % agents]
            )
            self._record_contact(row, agent_id, slot, substep, contact.speed)
            for other in np.flatnonzero(self._world.agents.slot[row] == slot).tolist():
                self._record_contact(row, other, self._held.slot[row, agent_id], substep, contact.speed)

    def _record_contact(self, row: int, agent_id: int, slot: int, substep: int, speed: float) -> None:
        tracks = self._tracks
        if not tracks.touched[row, agent_id, slot]:
            tracks.touched[row, agent_id, slot] = substep + 1
            tracks.touch_speed[row, agent_id, slot] = speed

    def _follow_ownership(self) -> None:
        """Add vehicles to the fleet and remove them, following the agents' slots."""
        agents, target_slot = self._world.agents, self._held.target_slot
        changed = (target_slot != self._held.slot) | (
            self._groups.active & (agents.generation != self._held.generation)
        )
        for row, agent_id in np.argwhere(changed).tolist():
            number = row * self._held.slot.shape[1] + agent_id
            if self._held.slot[row, agent_id] >= 0:
                self.fleet.despawn(number)
            self._held.slot[row, agent_id] = target_slot[row, agent_id]
            self._held.generation[row, agent_id] = agents.generation[row, agent_id]
            if target_slot[row, agent_id] >= 0:
                self._spawn(row, agent_id, number)

    def _spawn(self, row: int, agent_id: int, number: int) -> None:
        """Spawn an agent's vehicle in the fleet with its current pose, speed and yaw rate."""
        vehicles = self._world.vehicles
        slot = int(self._held.slot[row, agent_id])
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

    def _place_boxes(self, env_mask: Bools) -> None:
        """Show the road users that vehicles in Bullet may touch to Bullet as boxes."""
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
        generation = int(self._world.vehicles.generation[row, slot])
        return generation * self._world.vehicles.capacity + slot

    def _box(self, row: int, slot: int) -> Box:
        vehicles = self._world.vehicles
        kind = VehicleKind(int(vehicles.kind[row, slot]))
        height = vehicle(TYPES.get(kind, "truck")).height
        x, y = vehicles.position[row, slot].tolist()
        speed, sideways = float(vehicles.speed[row, slot]), float(vehicles.lateral_speed[row, slot])
        yaw_rate = float(vehicles.yaw_rate[row, slot])
        # In a bend the way goes along the heading of the step's middle.
        ahead = 0.5 * self._world.dt * yaw_rate
        cos, sin = math.cos(ahead), math.sin(ahead)
        return Box(
            (x, y, 0.5 * height),
            float(vehicles.heading[row, slot]),
            speed * cos - sideways * sin,
            float(vehicles.length[row, slot]),
            float(vehicles.width[row, slot]),
            height,
            speed * sin + sideways * cos,
            yaw_rate,
        )

    def _refusal(self, commands: Commands, bad: int) -> ActionError:
        """Return what is wrong with a command that is not finite; it must not come near Bullet."""
        row, agent_id = divmod(bad, self._held.slot.shape[1])
        mode = CommandMode(int(commands.mode[row, agent_id]))
        shown: Any = {
            CommandMode.TRACK: commands.reference[row, agent_id],
            CommandMode.PLACE: commands.poses[row, agent_id],
        }.get(mode, commands.actuators[row, agent_id])
        wrong = shown[~np.isfinite(shown).reshape(len(shown), -1).all(axis=1)]
        return ActionError(
            f"a command by {mode.name} is not finite: {wrong[:1].tolist()}",
            place=f"agent {agent_id} of simulation {row}",
            remedy="send finite actions",
        )
