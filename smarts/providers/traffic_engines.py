"""Constructs traffic engines, and runs several side by side, one per simulation."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from functools import partial

import numpy as np

from smarts.arrays import Bools, Bytes, Ints
from smarts.errors import TrafficError
from smarts.providers.own_engine import make_own_engine
from smarts.providers.traffic_engine import KeepsVehicles, TrafficEngine
from smarts.registry import is_own_name
from smarts.roads.lane_graph import LaneGraph
from smarts.types.episode import EpisodeStart
from smarts.types.traffic import DEFAULT_ENGINE, TRAFFIC_ENGINES
from smarts.types.transfers import Refusal
from smarts.types.world import World


def traffic_of(
    names: Sequence[str], world: World, maps: Sequence[LaneGraph], step: float | None = None
) -> TrafficEngine:
    """Return the traffic of simulations whose episodes use these engines.

    Args:
        names: Names of the engines, keys of `TRAFFIC_ENGINES`.
        world: The world.
        maps: The maps, by their number in the atlas.
        step: Duration of the engine's step [s], by default the world's.

    Raises:
        UnknownNameError: A name is not registered.
        TrafficError: An engine cannot be constructed, or has no step of its own.
        OwnCodeError: An engine is a user's own and raises.
    """
    kinds: dict[str, Callable[..., TrafficEngine]] = {name: TRAFFIC_ENGINES[name] for name in names}
    if step is not None:
        for name in names:
            check_has_step(name)
        kinds = {name: partial(kind, step=step) for name, kind in kinds.items()}
    with ExitStack() as on_failure:
        engines: dict[str, TrafficEngine] = {}
        for name, kind in kinds.items():
            engines[name] = (
                make_own_engine(name, kind, world, maps) if is_own_name(name) else kind(world, maps)
            )
            on_failure.callback(engines[name].close)
        on_failure.pop_all()
    return next(iter(engines.values())) if len(engines) == 1 else EnginesByEpisode(engines, world.worlds)


def check_has_step(name: str) -> None:
    """Raise unless a traffic engine can have a longer step than the world.

    Raises:
        TrafficError: It has none.
    """
    if name != DEFAULT_ENGINE:
        raise TrafficError(
            f"the traffic engine {name} moves vehicles in the world's steps",
            place="traffic_step",
            remedy=f"leave out traffic_step, or use the traffic engine {DEFAULT_ENGINE}",
        )


class EnginesByEpisode(TrafficEngine):
    """Runs each simulation with the engine that its episode names.

    Args:
        engines: The engines, by name.
        worlds: Number of simulations.
    """

    def __init__(self, engines: Mapping[str, TrafficEngine], worlds: int) -> None:
        self.failures: Mapping[int, TrafficError] = {}
        self.is_full = np.zeros(worlds, np.bool_)
        self._engines = dict(engines)
        self._driven = {name: np.zeros(worlds, np.bool_) for name in engines}
        """The simulations of each engine, by name, shape (B,)."""

    def reset(self, starts: Mapping[int, EpisodeStart]) -> None:
        """See `TrafficEngine`."""
        for name, engine in self._engines.items():
            own = {row: start for row, start in starts.items() if start.engine == name}
            self._driven[name][list(starts)] = False
            self._driven[name][list(own)] = True
            engine.reset(own)
            self.is_full[list(own)] = engine.is_full[list(own)]

    def step(self, env_mask: Bools) -> None:
        """See `TrafficEngine`."""
        for name, engine in self._engines.items():
            engine.step(env_mask & self._driven[name])
            self.is_full[self._driven[name]] = engine.is_full[self._driven[name]]
        self.failures = {
            row: error for engine in self._engines.values() for row, error in engine.failures.items()
        }

    def can_accept(self, rows: Ints, slots: Ints) -> Bytes:
        """See `TrafficEngine`."""
        asked = {name: engine.can_accept for name, engine in self._engines.items()}
        return self._answers(asked, rows, slots)

    def can_release(self, rows: Ints, slots: Ints) -> Bytes:
        """See `KeepsVehicles`."""
        keeping = {name: each for name, each in self._engines.items() if isinstance(each, KeepsVehicles)}
        return self._answers({name: each.can_release for name, each in keeping.items()}, rows, slots)

    def _answers(self, asked: Mapping[str, Callable[[Ints, Ints], Bytes]], rows: Ints, slots: Ints) -> Bytes:
        """Return each vehicle's answer of its own simulation's engine, NONE of engines that are not asked."""
        answers = np.full(len(rows), Refusal.NONE, np.int8)
        for name, ask in asked.items():
            of_engine = self._driven[name][rows]
            answers[of_engine] = ask(rows[of_engine], slots[of_engine])
        return answers

    def close(self) -> None:
        """See `TrafficEngine`."""
        for engine in self._engines.values():
            engine.close()
