"""Manoeuvres: the guidance of agents by their missions' tasks."""

from __future__ import annotations

import numpy as np

from smarts.arrays import Bools
from smarts.geometry.compiling import kernel
from smarts.roads.arrays import Roads
from smarts.roads.curves import curve_into, station_near, stations_of
from smarts.sim.cut_in import pace_cut_in, plan_cut_in
from smarts.sim.u_turn import plan_u_turn
from smarts.types.agent_states import AgentStatus
from smarts.types.guidance import GuidePhase
from smarts.types.mission import TaskKind
from smarts.types.world import State

STRAYED = 6.0
"""This far off the curve an agent begins its task again [m]."""

_NONE, _CUT_IN = int(TaskKind.NONE), int(TaskKind.CUT_IN)
_FREE, _MANOEUVRE, _OVER = int(GuidePhase.FREE), int(GuidePhase.MANOEUVRE), int(GuidePhase.OVER)
_SHADOWING, _ACTIVE = int(AgentStatus.SHADOWING), int(AgentStatus.ACTIVE)


@kernel
def plan_manoeuvres(state: State, roads: Roads, env_mask: Bools) -> None:
    """Write the guidance of agents with a vehicle and a task, in some simulations, after map matching."""
    agents, missions, guidance = state.agents, state.missions, state.guidance
    for b in np.flatnonzero(env_mask):
        for a in range(agents.slot.shape[1]):
            if missions.task[b, a] == _NONE or agents.state[b, a] not in (_ACTIVE, _SHADOWING):
                continue
            if agents.slot[b, a] < 0 or guidance.phase[b, a] == _OVER:
                continue
            if guidance.phase[b, a] == _MANOEUVRE:
                _go_on(state, roads, b, a)
            elif missions.task[b, a] == _CUT_IN:
                plan_cut_in(state, roads, b, a)
            else:
                plan_u_turn(state, roads, b, a)


@kernel
def _go_on(state: State, roads: Roads, b: int, a: int) -> None:
    """End a manoeuvre when the curve is behind the vehicle, or far off."""
    guidance = state.guidance
    lane = roads.lane_base[state.map[b]] + guidance.lane[b, a]
    control = curve_into(roads, guidance.begin[b, a], lane, guidance.s[b, a])
    stations = stations_of(control)
    x, y = state.vehicles.position[b, state.agents.slot[b, a]]
    station, distance = station_near(control, stations, x, y)
    if station >= stations[-1]:
        guidance.phase[b, a], guidance.speed[b, a] = _OVER, 0.0
    elif distance > STRAYED:
        guidance.phase[b, a], guidance.speed[b, a] = _FREE, 0.0
    elif state.missions.task[b, a] == _CUT_IN:
        pace_cut_in(state, roads, b, a)
