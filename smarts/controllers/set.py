"""The controllers of all action types in use, as the stage of the step."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from smarts.controllers import CONTROLLERS
from smarts.controllers.fallback import FallbackController
from smarts.controllers.protocol import Controller
from smarts.geometry.binding import bind
from smarts.geometry.compiling import kernel
from smarts.roads.scene import Scene
from smarts.types.actions import KINKED, Actions, ActionSpaceType, CommandMode, Commands
from smarts.types.agent_states import UNSET, AgentStatus, ChangePhase
from smarts.types.world import World

Bools = NDArray[np.bool_]
Bytes = NDArray[np.int8]
Floats = NDArray[np.float64]

_ACTIVE, _NONE = int(AgentStatus.ACTIVE), int(CommandMode.NONE)


class ControllerSet:
    """Turns the actions of all active agents into commands, each by the controller of its type.

    An agent that has not acted since it entered keeps its lane and its distance, whatever its type.

    Args:
        scene: What the controllers work in.
        kinds: The action types in use, as in `AgentRules.action`.
        speeds: The largest speed of the discrete lane actions on each map [m/s], shape (M,); the lanes'
            limits alone if not given.
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
        self._neutral = FallbackController(scene, speeds)
        types = np.array(in_order, np.int8)
        self._chosen = np.zeros((len(types) + 1, *shape), np.bool_)
        self._part = bind(
            group_by_action_type,
            scene.world.agents.state,
            types,
            self._commands.mode,
            self._commands.window,
            self._chosen,
        )

    def command(self, world: World, actions: Actions, env_mask: Bools) -> Commands:
        """Return what the vehicles of all active agents are to do in this step."""
        out = self._commands
        in_use = self._part(actions.kind, actions.given, env_mask)
        for number, controller in enumerate(self._controllers):
            if in_use >> number & 1:
                chosen = self._chosen[number]
                controller.command(self._scene, actions, chosen, out)
                if not controller.follows_lanes:
                    self._steer_freely(world, chosen)
        if in_use >> len(self._controllers):
            self._neutral.command(self._scene, actions, self._chosen[-1], out)
        return out

    def _steer_freely(self, world: World, chosen: Bools) -> None:
        """Say of agents that steer by other means than lanes: bound for none, as fast as is allowed here."""
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
    state: Bytes,
    types: Bytes,
    mode: Bytes,
    window: Floats,
    chosen: Bools,
    kind: Bytes,
    given: Bools,
    env_mask: Bools,
) -> int:
    """Say which active agents of some simulations each controller is to command.

    Args:
        state: `AgentStatus` of all agents, shape (B, A).
        types: Action types of the K controllers, shape (K,).
        mode: Of the commands, shape (B, A); written: none for all agents of these simulations.
        window: Of the commands, shape (B, A); written: the usual one.
        chosen: Written, shape (K + 1, B, A); the last is for those who have not acted yet.
        kind: How the agents act, shape (B, A).
        given: Who has acted, shape (B, A).
        env_mask: Which simulations, shape (B,).

    Returns:
        Bit k is set if controller k has anything to do, bit K if anybody has not acted yet.
    """
    in_use = 0
    chosen[:] = False
    for b in range(len(env_mask)):
        if not env_mask[b]:
            continue
        for a in range(state.shape[1]):
            mode[b, a], window[b, a] = _NONE, KINKED
            if state[b, a] != _ACTIVE:
                continue
            if not given[b, a]:
                chosen[-1, b, a] = True
                in_use |= 1 << len(types)
                continue
            for k in range(len(types)):
                if types[k] == kind[b, a]:
                    chosen[k, b, a] = True
                    in_use |= 1 << k
    return in_use
