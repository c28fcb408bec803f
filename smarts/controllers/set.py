"""The stage that runs the controllers of all action types in use."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from smarts.arrays import Bools, Bytes, Floats
from smarts.controllers import CONTROLLERS
from smarts.controllers.fallback import FallbackController
from smarts.controllers.protocol import Controller
from smarts.geometry.binding import LateBound
from smarts.geometry.compiling import kernel
from smarts.roads.scene import Scene
from smarts.types.actions import KINKED, Actions, ActionSpaceType, CommandMode, Commands
from smarts.types.agent_states import UNSET, AgentStatus, ChangePhase
from smarts.types.world import State

_ACTIVE, _LEAVING = int(AgentStatus.ACTIVE), int(AgentStatus.LEAVING)
_NONE = int(CommandMode.NONE)


class ControllerSet:
    """Converts the actions of all active agents to commands, by the controller of each action type.

    `FallbackController` drives agents that have not acted since they entered, and those that are leaving.

    Args:
        scene: The world, its maps and its routes.
        kinds: The action types in use, as in `AgentRules.action`.
        speeds: Maximum speed of discrete lane actions on each map [m/s], shape (M,); by default only the
            lanes' speed limits apply.
    """

    def __init__(self, scene: Scene, kinds: Iterable[int], speeds: Floats | None = None) -> None:
        self._scene = scene
        shape = scene.world.agents.slot.shape
        self._commands = Commands.allocate(*shape)
        self._controllers: list[Controller] = []
        in_order = sorted({ActionSpaceType(kind) for kind in kinds})
        for kind in in_order:
            made = CONTROLLERS[kind.name]
            self._controllers.append(made(scene, speeds) if made.follows_lanes else made(scene))
        self._fallback = FallbackController(scene, speeds)
        types = np.array(in_order, np.int8)
        self._chosen = np.zeros((len(types) + 1, *shape), np.bool_)
        self._group = LateBound(group_by_action_type, scene.world.state, types, self._commands, self._chosen)

    @property
    def columns(self) -> tuple[NDArray, ...]:
        """Arrays with an entry per agent, cleared when another agent takes its place, shape (B, A, ...)."""
        kept = (array for each in self._controllers for array in getattr(each, "columns", ()))
        return (*self._commands, *kept)

    def command(self, actions: Actions, env_mask: Bools) -> Commands:
        """Return the commands of all active agents for this step.

        Args:
            actions: Actions of all agents, shape (B, A).
            env_mask: The simulations to step, shape (B,).
        """
        out = self._commands
        in_use = self._group.to(actions)(env_mask)
        for number, controller in enumerate(self._controllers):
            if in_use >> number & 1:
                chosen = self._chosen[number]
                controller.command(actions, chosen, out)
                if not controller.follows_lanes:
                    self._clear_lane_targets(chosen)
        if in_use >> len(self._controllers):
            self._fallback.command(actions, self._chosen[-1], out)
        return out

    def _clear_lane_targets(self, chosen: Bools) -> None:
        """Reset lane changes and set `desired_speed` to the lane's limit, for agents without lane control."""
        world = self._scene.world
        agents, vehicles = world.agents, world.vehicles
        row, agent_id = np.nonzero(chosen)
        slot = agents.slot[row, agent_id]
        agents.target_lane[row, agent_id] = UNSET
        agents.change_phase[row, agent_id] = ChangePhase.NONE
        lane = vehicles.lane[row, slot]
        roads = self._scene.atlas.roads
        limits = roads.lane_speed[roads.lane_base[world.map[row]] + np.maximum(lane, 0)]
        vehicles.desired_speed[row, slot] = np.where(lane >= 0, limits, 0.0)


@kernel
def group_by_action_type(
    state: State, types: Bytes, commands: Commands, chosen: Bools, actions: Actions, env_mask: Bools
) -> int:
    """Group the agents whose vehicles move in some simulations by controller.

    Args:
        state: The state of the world.
        types: Action types of the K controllers, shape (K,).
        commands: Mode and window of these simulations' agents are reset to NONE and `KINKED`.
        chosen: Agents of each controller, written, shape (K + 1, B, A); the last row holds the agents that
            have not acted yet, or are leaving.
        actions: Actions of all agents.
        env_mask: The simulations, shape (B,).

    Returns:
        A bit mask: bit k is set if controller k has agents, bit K if the fallback controller has.
    """
    status, kind = state.agents.state, actions.kind
    in_use = 0
    chosen[:] = False
    for b in range(len(env_mask)):
        if not env_mask[b]:
            continue
        for a in range(status.shape[1]):
            commands.mode[b, a], commands.window[b, a] = _NONE, KINKED
            if status[b, a] != _ACTIVE and status[b, a] != _LEAVING:
                continue
            if status[b, a] == _LEAVING or not actions.given[b, a]:
                chosen[-1, b, a] = True
                in_use |= 1 << len(types)
                continue
            for k in range(len(types)):
                if types[k] == kind[b, a]:
                    chosen[k, b, a] = True
                    in_use |= 1 << k
    return in_use
