"""How a simulation is run: what callers choose beside scenarios and interfaces."""

from __future__ import annotations

import os
import sys
from dataclasses import replace
from pathlib import Path
from typing import Annotated

from pydantic import Field

from smarts.agents.checks import Count, Listed, NumberFrom0, Plain, Positive, checked
from smarts.errors import SmartsError
from smarts.providers.vehicle import SUBSTEPS
from smarts.sim.outlet import Address

ENVISION = "SMARTS_ENVISION"
"""Environment variable: address of a viewer's server for simulations whose options name none."""
VIEWER = "127.0.0.1:8081"
"""Default address of `smarts-bench view --live`."""
LONGEST_SUBSTEP = 0.02
"""Longest sub-step of the vehicles' dynamics [s]; made for 0.01."""
LONGEST_TRAFFIC_STEP = 1.0
"""Reaction time of SUMO's drivers [s]."""
LONGEST_LATENCY = 10.0
"""Longest latency of actions [s]."""


@checked
class Options:
    """How a simulation is run.

    Raises:
        SmartsError: A step is longer than the tyres' bristles take in `SUBSTEPS` parts, or none at all; a
            path has no points; or the friction is out of its range.
    """

    dt: Annotated[float, Plain, Field(ge=0.001, le=LONGEST_SUBSTEP * SUBSTEPS)] = 0.1
    """Length of a step [s], 0.001 to 0.2; with SUMO a whole number of milliseconds."""
    path: Count = 64
    """The most points of a path that an agent gives as its action."""
    record: str | Path | None = None
    """Folder that episodes are written to; None: episodes are not written."""
    record_all: bool = False
    """Whether vehicles far from agents are recorded, too."""
    record_observations: Annotated[tuple[str, ...], Listed] = ()
    """Names of learning agents of which is recorded, too, what they observe: by the sensors of their
    interfaces, and as arrays."""
    envision: str | None = None
    """Server of `smarts-bench view --live` that shows the simulations, as "host:port". It may come and
    go. None: what the environment variable SMARTS_ENVISION says; "": nowhere."""
    policy: str = ""
    """Name of the learning agents' policy, for viewers: an algorithm's, "" if it has none."""
    traffic_engine: str | None = None
    """Name among `TRAFFIC_ENGINES` of the one that drives the traffic; None: the scenario's."""
    traffic_step: Positive | None = None
    """Length of SUMO's step [s], a multiple of `dt` up to 1, for training: 0.5 halves the time of training.
    Between SUMO's poses, vehicles move evenly. Such episodes cannot be recorded. None: `dt`."""
    friction: Annotated[float, Plain, Field(ge=0.05, le=2.0)] | None = None
    """Friction of the road under agents' vehicles beside a scenario's patches, 0.05 to 2; None: dry, 0.9."""
    action_latency: NumberFrom0 = 0.0
    """Time from an action of a learning agent to when its vehicle carries it out [s], a multiple of `dt` up
    to 10; the last action that has arrived is kept until then. Social agents have `hosts` instead."""
    weights: Annotated[tuple[Positive, ...], Listed] = ()
    """Weight of each of the scenarios: every episode draws one by them. Without weights, episodes go through
    all combinations of scenarios, traffic and missions in turns."""

    def __post_init__(self) -> None:
        self._check_multiple("traffic_step", self.traffic_step or 0.0, LONGEST_TRAFFIC_STEP)
        self._check_multiple("action_latency", self.action_latency, LONGEST_LATENCY)
        needs = "name a folder with record, or leave it out"
        rules = (
            ("traffic_step", self.record is not None, "leave it out, or leave out record"),
            ("record_all", self.record is None, needs),
            ("record_observations", self.record is None, needs),
        )
        for name, is_wrong, remedy in rules:
            if is_wrong and getattr(self, name):
                raise self._error(name, remedy)
        if self.envision:
            Address.parse(self.envision, "Options.envision")

    def _check_multiple(self, name: str, time: float, longest: float) -> None:
        """Require a multiple of `dt`, from 0 to `longest` [s]."""
        if not (time <= longest and abs(round(time / self.dt) * self.dt - time) <= 1e-9):
            raise self._error(name, f"give a multiple of dt, {self.dt} s, up to {longest:g} s")

    def _error(self, name: str, remedy: str) -> SmartsError:
        return SmartsError(f"{name} is {getattr(self, name)!r}", place=f"Options.{name}", remedy=remedy)

    @property
    def latency_steps(self) -> int:
        """Steps from an action to when it is carried out."""
        return round(self.action_latency / self.dt)


def shown(options: Options | None, envision: bool | str | None) -> Options | None:
    """Return options that show the simulations in a browser, or do not.

    Args:
        options: The simulations'.
        envision: See `EnvSettings`.
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
