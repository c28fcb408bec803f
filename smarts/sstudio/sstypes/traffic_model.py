"""Lane-changing and junction models of drivers, with the attributes of the traffic engine.

SUMO's attributes have a prefix and capitals (`lcSpeedGain`); here they are plain arguments
(`LaneChangingModel(speed_gain=2)`). As a mapping, a model shows the engine's names.
"""

from __future__ import annotations

from typing import Any, ClassVar

from smarts.sstudio.sstypes.identity import DescribedMapping


class TrafficModel(DescribedMapping):
    """Parameters of a driver model, as a mapping from the engine's attribute names to values."""

    prefix: ClassVar[str] = ""
    """Prefix of the engine's attributes."""
    unprefixed: ClassVar[frozenset[str]] = frozenset()
    """Attributes that the engine names without the prefix."""

    def __init__(self, **arguments: Any) -> None:
        self.constructor_arguments = arguments
        super().__init__({self._attribute(name): value for name, value in arguments.items()})

    @classmethod
    def _attribute(cls, argument: str) -> str:
        if argument in cls.unprefixed:
            return argument
        return cls.prefix + "".join(word[:1].upper() + word[1:] for word in argument.split("_"))

    def __repr__(self) -> str:
        arguments = ", ".join(f"{name}={value!r}" for name, value in self.constructor_arguments.items())
        return f"{type(self).__name__}({arguments})"


class LaneChangingModel(TrafficModel):
    """A lane-changing model: SUMO's `lc` attributes, such as `speed_gain` or `cooperative`."""

    prefix = "lc"
    unprefixed = frozenset({"minGapLat"})


class JunctionModel(TrafficModel):
    """A junction model: SUMO's `jm` attributes, such as `drive_after_red_time`.

    `impatience`, which SUMO does not prefix, is the readiness in [0, 1] to make others brake.
    """

    prefix = "jm"
    unprefixed = frozenset({"impatience"})


class SmartsLaneChangingModel(LaneChangingModel):
    """Lane changes of the native traffic engine ("SMARTS"), which can cut in on purpose.

    Args:
        cutin_prob: Chance in [0, 1] of cutting in ahead of an agent when the occasion is there.
        assertive: The gaps that the driver wants are divided by this; above 0.
        dogmatic: Whether it cuts in even if that costs it its route.
        hold_period: How long it stays in the agent's lane [s].
        slow_down_after: Its target speed is multiplied by this during that time.
        multi_lane_cutin: Whether it crosses several lanes to cut in.
    """

    def __init__(
        self,
        cutin_prob: float = 0.0,
        assertive: float = 1.0,
        dogmatic: bool = True,
        hold_period: float = 3.0,
        slow_down_after: float = 1.0,
        multi_lane_cutin: bool = False,
    ) -> None:
        super().__init__(
            cutin_prob=cutin_prob,
            assertive=assertive,
            dogmatic=dogmatic,
            hold_period=hold_period,
            slow_down_after=slow_down_after,
            multi_lane_cutin=multi_lane_cutin,
        )


class SmartsJunctionModel(JunctionModel):
    """Junctions in the native traffic engine ("SMARTS").

    Args:
        yield_to_agents: "always", "never", or "normal": where the agent has the right of way.
        wait_to_restart: How long to stand after a stop at a signal or sign [s].
    """

    def __init__(self, yield_to_agents: str = "normal", wait_to_restart: float = 0.0) -> None:
        super().__init__(yield_to_agents=yield_to_agents, wait_to_restart=wait_to_restart)
