"""The feature `sensors`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from numpy.typing import NDArray

from smarts.agents.checks import InterfaceError
from smarts.arrays import Bools
from smarts.observations.context import AdapterContext
from smarts.observations.feature import Feature
from smarts.sensors.suite import sensors_of
from smarts.types.interface import Field


class SensorReadings(Feature):
    """Every field of the agents' sensors, named "sensor/field"; the agents have equal sensors."""

    in_vector = False
    needs_equal_sensors = True

    def __init__(self, context: AdapterContext) -> None:
        super().__init__(context)
        self._sensors = sensors_of(context.interfaces[0])
        if any(sensors_of(each) != self._sensors for each in context.interfaces):
            raise InterfaceError(
                f"the agents {', '.join(context.agents)} have different sensors",
                place="feature sensors",
                remedy="give them equal interfaces",
            )

    def fields(self) -> tuple[Field, ...]:
        """Return the sensors' fields."""
        return tuple(
            replace(field, name=f"{name}/{field.name}")
            for name, sensor in self._sensors.items()
            for field in sensor.fields()
        )

    def bind(self, *out: NDArray) -> Callable[[Bools], object]:
        """Return the function that observes."""
        arrays, bound = iter(out), []
        for sensor in self._sensors.values():
            block = {field.name: next(arrays) for field in sensor.fields()}
            bound.append(sensor.bind(self.context.scene, self.context.agent_ids, block))

        def observe(observe_mask: Bools) -> None:
            for each in bound:
                each(observe_mask)

        return observe
