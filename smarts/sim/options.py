"""How a simulation is run: what callers choose beside scenarios and interfaces."""

from __future__ import annotations

import math
import os
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NoReturn

from smarts.agents.options import InterfaceError
from smarts.errors import SmartsError
from smarts.providers.vehicle import SUBSTEPS
from smarts.sim.outlet import Address

ENVISION = "SMARTS_ENVISION"
"""Environment variable: address of a viewer's server for simulations whose options name none."""
VIEWER = "127.0.0.1:8081"
"""Where `smarts-bench view --live` is by default."""
LONGEST_SUBSTEP = 0.02
"""Of the vehicles' dynamics [s]; made for 0.01."""
LONGEST_TRAFFIC_STEP = 1.0
"""Reaction time of SUMO's drivers [s]."""
LONGEST_LATENCY = 10.0
"""Of actions [s]."""


@dataclass(frozen=True)
class Options:
    """How a simulation is run.

    Raises:
        SmartsError: A step is longer than the tyres' bristles take in `SUBSTEPS` parts, or none at all; a
            path has no points; or the friction is out of its range.
    """

    dt: float = 0.1
    """Length of a step [s], 0.001 to 0.2; with SUMO a whole number of milliseconds."""
    path: int = 64
    """The most points of a path that an agent gives as its action."""
    record: str | Path | None = None
    """Where episodes are written to; None: nowhere."""
    record_all: bool = False
    """Whether vehicles far from agents are recorded, too, in a table of their own."""
    record_observations: Sequence[str] = ()
    """Names of learning agents of which is recorded, too, what they observe: by the sensors of their
    interfaces, and as arrays."""
    envision: str | None = None
    """Server of `smarts-bench view --live` that shows the simulations, as "host:port" or "token@host:port".
    It may come and go. None: what the environment variable SMARTS_ENVISION says; "": nowhere."""
    policy: str = ""
    """Name of what drives the learning agents, for those who watch: an algorithm's, "" if it has none."""
    traffic_engine: str | None = None
    """Which of `TRAFFIC_ENGINES` drives the traffic; None: the one that the scenario names."""
    traffic_step: float | None = None
    """Length of SUMO's step [s], a multiple of `dt` up to 1, for training: 0.5 halves the time of training.
    Between SUMO's poses, vehicles move evenly. Such episodes cannot be recorded. None: `dt`."""
    friction: float | None = None
    """Of the road under agents' vehicles where the scenario has no patch, 0.05 to 2; None: dry, 0.9."""
    action_latency: float = 0.0
    """Time from an action of a learning agent to when its vehicle carries it out [s], a multiple of `dt` up
    to 10; the last action that has arrived is kept until then. Social agents have `hosts` instead."""

    def __post_init__(self) -> None:
        longest = LONGEST_SUBSTEP * SUBSTEPS
        if not 0.001 <= self.dt <= longest:
            remedy = f"give 0.001 to {longest} s, for which tyres are made"
            self._refuse("dt", f"a step of {self.dt} s", remedy)
        self._check_traffic_step()
        latency = self.action_latency
        if not 0 <= latency <= LONGEST_LATENCY or abs(self.latency_steps * self.dt - latency) > 1e-9:
            multiple = f"give a multiple of dt, {self.dt} s, up to {LONGEST_LATENCY:g} s"
            self._refuse("action_latency", f"a latency of {latency} s", multiple)
        for name in ("record_all", "record_observations"):
            if getattr(self, name) and self.record is None:
                remedy = f"name a folder with record, or leave out {name}"
                self._refuse(name, f"{name} is set, and nothing is recorded", remedy)
        if isinstance(self.record_observations, str):
            problem = f"record_observations is {self.record_observations!r}, not a list"
            self._refuse("record_observations", problem, f"give a list: [{self.record_observations!r}]")
        if self.envision:
            Address.parse(self.envision, "Options.envision")
        if self.friction is not None and not 0.05 <= self.friction <= 2.0:
            remedy = "give 0.05 to 2; ice has about 0.1, a wet road 0.5, dry asphalt 0.9"
            self._refuse("friction", f"a friction of {self.friction}", remedy)
        if isinstance(self.path, bool) or not isinstance(self.path, int) or self.path < 1:
            raise InterfaceError(
                f"path is {self.path!r}", place="Options", remedy="give a number of points, 1 or more"
            )

    @property
    def latency_steps(self) -> int:
        """Steps from an action to when it is carried out."""
        return round(self.action_latency / self.dt)

    def _check_traffic_step(self) -> None:
        step = self.traffic_step
        if step is None:
            return
        steps = round(step / self.dt) if math.isfinite(step) else 0
        if steps < 1 or step > LONGEST_TRAFFIC_STEP or abs(steps * self.dt - step) > 1e-9:
            multiple = f"give a multiple of dt, {self.dt} s, up to {LONGEST_TRAFFIC_STEP} s"
            self._refuse("traffic_step", f"a traffic step of {step} s", multiple)
        if self.record is not None:
            problem = f"traffic_step is {step}, and episodes are recorded, for tests"
            self._refuse("traffic_step", problem, "leave out traffic_step: tests run with exact traffic")

    def _refuse(self, name: str, problem: str, remedy: str) -> NoReturn:
        raise SmartsError(problem, place=f"Options.{name}", remedy=remedy)


def check_envision(envision: object) -> None:
    """Raise unless a value says whether and where simulations are shown.

    Raises:
        SmartsError: It is neither a truth value nor None nor an address.
    """
    if isinstance(envision, str):
        Address.parse(envision, "envision")
    elif envision is not None and not isinstance(envision, bool):
        raise SmartsError(
            f"envision is {envision!r}",
            place="envision",
            remedy="give True to show the simulations, False not to, or the address of a viewer, host:port",
        )


def shown(options: Options | None, envision: bool | str | None) -> Options | None:
    """Return options that show the simulations in a browser, or do not.

    Args:
        options: The simulations'.
        envision: See `EnvSettings`; checked.
    """
    if envision is None:
        return options
    options = options or Options()
    if isinstance(envision, str) or not envision:
        return replace(options, envision=envision or "")
    if options.envision or (options.envision is None and os.environ.get(ENVISION)):
        return options
    print(f"envision: shown by `smarts-bench view --live` at http://{VIEWER}", file=sys.stderr)
    return replace(options, envision=VIEWER)
