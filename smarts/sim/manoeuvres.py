"""Manoeuvres: where the missions' tasks lead their agents now."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from smarts.geometry.binding import bind
from smarts.geometry.compiling import kernel
from smarts.roads.curves import curve_into, station_near, stations_of
from smarts.roads.guide import Guide, guide_of
from smarts.roads.scene import Scene
from smarts.sim.cut_in import pace_cut_in, plan_cut_in
from smarts.sim.surroundings import Surroundings, surroundings_of
from smarts.sim.u_turn import plan_u_turn
from smarts.types.agent_states import AgentStatus
from smarts.types.guidance import GuidePhase
from smarts.types.mission import TaskKind
from smarts.types.world import World

Bools = NDArray[np.bool_]

STRAYED = 6.0
"""So far off the curve an agent is led no longer, and begins anew [m]."""

_NONE, _CUT_IN = int(TaskKind.NONE), int(TaskKind.CUT_IN)
_FREE, _MANOEUVRE, _OVER = int(GuidePhase.FREE), int(GuidePhase.MANOEUVRE), int(GuidePhase.OVER)
_SHADOWING, _ACTIVE = int(AgentStatus.SHADOWING), int(AgentStatus.ACTIVE)


class Manoeuvres:
    """Writes `world.guidance`; a part of the locator stage, which has just said where everybody is.

    Args:
        scene: The world, its maps and the agents' routes.
    """

    def __init__(self, scene: Scene) -> None:
        around, guide = surroundings_of(scene), guide_of(scene.world)
        self._plan = bind(plan_manoeuvres, around, guide, scene.world.agents.state)

    def plan(self, world: World, env_mask: Bools) -> None:
        """Say where tasks lead in some simulations."""
        self._plan(env_mask)


@kernel
def plan_manoeuvres(around: Surroundings, guide: Guide, state: NDArray[np.int8], env_mask: Bools) -> None:
    """Write the guidance of the occupied agents of some simulations that have a task, shape (B, A)."""
    for b in range(len(env_mask)):
        if not env_mask[b]:
            continue
        for a in range(state.shape[1]):
            if around.task[b, a] == _NONE or state[b, a] not in (_ACTIVE, _SHADOWING):
                continue
            if around.slot[b, a] < 0 or guide.phase[b, a] == _OVER:
                continue
            if guide.phase[b, a] == _MANOEUVRE:
                _go_on(around, guide, b, a)
            elif around.task[b, a] == _CUT_IN:
                plan_cut_in(around, guide, b, a)
            else:
                plan_u_turn(around, guide, b, a)


@kernel
def _go_on(around: Surroundings, guide: Guide, b: int, a: int) -> None:
    """End a manoeuvre when the curve is behind the vehicle, or far off."""
    lane = around.roads.lane_base[around.map[b]] + guide.lane[b, a]
    control = curve_into(around.roads, guide.begin[b, a], lane, guide.s[b, a])
    stations = stations_of(control)
    x, y = around.position[b, around.slot[b, a]]
    station, distance = station_near(control, stations, x, y)
    if station >= stations[-1]:
        guide.phase[b, a], guide.speed[b, a] = _OVER, 0.0
    elif distance > STRAYED:
        guide.phase[b, a], guide.speed[b, a] = _FREE, 0.0
    elif around.task[b, a] == _CUT_IN:
        pace_cut_in(around, guide, b, a)
