"""How a simulation is run: what callers choose beside scenarios and interfaces."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

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
    """Folder that episodes are written to; None: episodes are not written."""
    record_all: bool = False
    """Whether vehicles far from agents are recorded, too."""
    record_observations: Sequence[str] = ()
    """Names of learning agents of which is recorded, too, what they observe: by the sensors of their
    interfaces, and as arrays."""
    envision: str | None = None
    """Server of `smarts-bench view --live` that shows the simulations, as "host:port" or "token@host:port".
    It may come and go. None: what the environment variable SMARTS_ENVISION says; "": nowhere."""
    policy: str = ""
    """Name of the learning agents' policy, for viewers: an algorithm's, "" if it has none."""
    traffic_engine: str | None = None
    """Name among `TRAFFIC_ENGINES` of the one that drives the traffic; None: the scenario's."""
    traffic_step: float | None = None
    """Length of SUMO's step [s], a multiple of `dt` up to 1, for training: 0.5 halves the time of training.
    Between SUMO's poses, vehicles move evenly. Such episodes cannot be recorded. None: `dt`."""
    friction: float | None = None
    """Friction of the road under agents' vehicles beside a scenario's patches, 0.05 to 2; None: dry, 0.9."""
    action_latency: float = 0.0
    """Time from an action of a learning agent to when its vehicle carries it out [s], a multiple of `dt` up
    to 10; the last action that has arrived is kept until then. Social agents have `hosts` instead."""
    weights: Sequence[float] = ()
    """Weight of each of the scenarios: every episode draws one by them. Without weights, episodes go through
    all combinations of scenarios, traffic and missions in turns."""

    def __post_init__(self) -> None:
        longest, step = LONGEST_SUBSTEP * SUBSTEPS, self.traffic_step
        multiple = f"give a multiple of dt, {self.dt} s, up to"
        records = self.record is not None
        # Name, whether its value is right, and the remedy where it is not.
        rules = (
            ("dt", 0.001 <= self.dt <= longest, f"give 0.001 to {longest} s, for which tyres are made"),
            (
                "traffic_step",
                step is None or (step > 0 and self._is_multiple(step, LONGEST_TRAFFIC_STEP)),
                f"{multiple} {LONGEST_TRAFFIC_STEP:g} s",
            ),
            ("traffic_step", step is None or not records, "leave it out, or leave out record"),
            (
                "action_latency",
                self._is_multiple(self.action_latency, LONGEST_LATENCY),
                f"{multiple} {LONGEST_LATENCY:g} s",
            ),
            ("record_all", records or not self.record_all, "name a folder with record, or leave it out"),
            (
                "record_observations",
                not self.record_observations or (records and not isinstance(self.record_observations, str)),
                "give a list of names, and name a folder with record",
            ),
            (
                "friction",
                self.friction is None or 0.05 <= self.friction <= 2.0,
                "give 0.05 to 2; ice has about 0.1, a wet road 0.5, dry asphalt 0.9",
            ),
            ("weights", all(each > 0 for each in self.weights), "give a number above 0 for each scenario"),
            ("path", isinstance(self.path, int) and self.path >= 1, "give a number of points, 1 or more"),
        )
        for name, is_right, remedy in rules:
            if not is_right:
                problem = f"{name} is {getattr(self, name)!r}"
                raise SmartsError(problem, place=f"Options.{name}", remedy=remedy)
        if self.envision:
            Address.parse(self.envision, "Options.envision")

    def _is_multiple(self, time: float, longest: float) -> bool:
        """Return whether a time is a multiple of `dt`, from 0 to `longest` [s]."""
        return 0 <= time <= longest and self.dt > 0 and abs(round(time / self.dt) * self.dt - time) <= 1e-9

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
