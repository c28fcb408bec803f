"""The controllers of all action types in use, as the stage of the step."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from smarts.controllers import CONTROLLERS
from smarts.controllers.neutral import Neutral
from smarts.controllers.protocol import Controller
from smarts.roads.scene import Scene
from smarts.types.actions import Actions, ActionSpaceType, CommandMode, Commands
from smarts.types.seats import NEITHER, ChangePhase, SeatState
from smarts.types.world import World

Bools = NDArray[np.bool_]
Floats = NDArray[np.float64]

_ACTIVE, _NONE = int(SeatState.ACTIVE), int(CommandMode.NONE)

LANE_TYPES = (ActionSpaceType.Lane, ActionSpaceType.LaneWithContinuousSpeed)


class ControllerSet:
    """Turns the actions of all active seats into commands, each by the controller of its type.

    An agent that has not acted since it entered keeps its lane and its distance, whatever its type.

    Args:
        scene: What the controllers work in.
        kinds: The action types in use, as in `SeatRules.action`.
        speeds: The largest speed of the discrete lane actions on each map [m/s], shape (M,); the lanes'
            limits alone if not given.
    """

    def __init__(self, scene: Scene, kinds: Iterable[int], speeds: Floats | None = None) -> None:
        self._scene = scene
        shape = scene.world.seats.slot.shape
        self._commands = Commands.allocate(*shape)
        self._controllers: list[Controller] = []
        for kind in sorted({ActionSpaceType(kind) for kind in kinds}):
            made = CONTROLLERS[kind.name]
            is_discrete = kind == ActionSpaceType.Lane
            self._controllers.append(made(scene, speeds) if is_discrete else made(scene))
        self._neutral = Neutral(scene, speeds)

    def command(self, world: World, actions: Actions, rows: Bools) -> Commands:
        """Return what the vehicles of all active seats are to do in this step."""
        seats, out = world.seats, self._commands
        active = (seats.state == _ACTIVE) & rows[:, None]
        out.mode[rows] = _NONE
        given = active & actions.given
        for controller in self._controllers:
            chosen = given & (actions.kind == int(controller.action))
            if chosen.any():
                controller.command(self._scene, actions, chosen, out)
                if controller.action not in LANE_TYPES:
                    self._steer_freely(world, chosen)
        silent = active & ~actions.given
        if silent.any():
            self._neutral.command(self._scene, actions, silent, out)
        return out

    def _steer_freely(self, world: World, chosen: Bools) -> None:
        """Say of seats that steer by other means than lanes: bound for none, as fast as is allowed here."""
        seats, vehicles = world.seats, world.vehicles
        row, seat = np.nonzero(chosen)
        slot = seats.slot[row, seat]
        seats.target_lane[row, seat] = NEITHER
        seats.change_phase[row, seat] = ChangePhase.NONE
        lane = vehicles.lane[row, slot]
        roads = self._scene.atlas.roads
        limits = roads.lane_speed[roads.lane_base[world.map[row]] + np.maximum(lane, 0)]
        vehicles.desired_speed[row, slot] = np.where(lane >= 0, limits, 0.0)
