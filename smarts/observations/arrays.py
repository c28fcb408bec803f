"""Observations of many agents as arrays, made from a list of features."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from smarts.arrays import Bools
from smarts.errors import OwnCodeError
from smarts.geometry.binding import bind
from smarts.observations.context import AdapterContext
from smarts.observations.feature import Feature
from smarts.observations.lists import FeatureChoice, Observed, feature_list
from smarts.observations.stacking import write_stack, write_vector
from smarts.registry import guarded
from smarts.types.interface import Field

VECTOR = "observation"
"""Name of the array that the features' numbers are joined in."""

Observe = Callable[[Bools], object]


class ArrayObservation:
    """The observations of some agents of B simulations, computed by kernels: no Python for each agent.

    Args:
        context: The agents.
        features: What they observe.

    Raises:
        SmartsError: There is no such observation, feature or option.
        OwnCodeError: A feature is the user's own and raises.
    """

    def __init__(self, context: AdapterContext, features: Observed) -> None:
        self._context, self._features = context, feature_list(features)
        self._shape = context.scene.world.worlds, len(context.agents)
        self._is_new = np.ones(self._shape, np.bool_)
        self._observe: list[Observe] = []
        self.arrays: dict[str, NDArray] = {}
        """By field, shape (B, G, *shape); valid until the next decision."""
        self.fields: tuple[Field, ...] = ()
        """One agent's observation."""
        made = [
            (choice, choice.make(context)) for choice in (*self._features.stacked, *self._features.features)
        ]
        stacked = len(self._features.stacked)
        self._add_vector([each for each in made[:stacked] if each[1].in_vector], made[stacked:])
        for number, (choice, feature) in enumerate(made):
            if not feature.in_vector:
                self._add_arrays(choice, feature, is_stacked=number < stacked)

    def observe(self, observe_mask: Bools) -> Mapping[str, NDArray]:
        """Observe the agents in a mask, shape (B, G), and return all agents' observations.

        The others keep what they have: an agent whose episode has ended its last observation until its reset.
        """
        for observe in self._observe:
            observe(observe_mask)
        np.copyto(self._is_new, False, where=observe_mask)
        return self.arrays

    def reset(self, agents: Bools) -> None:
        """Begin episodes of some agents, shape (B, G): their observations become zero."""
        self._is_new[agents] = True
        for array in self.arrays.values():
            array[agents] = 0

    def _add_vector(
        self,
        stacked: Sequence[tuple[FeatureChoice, Feature]],
        others: Sequence[tuple[FeatureChoice, Feature]],
    ) -> None:
        single = [each for each in others if each[1].in_vector]
        parts = [*stacked, *single]
        if not parts:
            return
        sizes = [feature.fields()[0].shape[0] for _, feature in parts]
        first = np.cumsum([0, *sizes])
        rows, frames = int(np.prod(self._shape)), self._features.frames
        numbers = np.zeros(first[-1] * rows, np.float32)
        for (choice, feature), begin, end in zip(parts, first[:-1], first[1:], strict=True):
            out = numbers[begin * rows : end * rows].reshape(*self._shape, end - begin)
            self._observe.append(self._bound(choice, feature, out))
        size = int(first[-1] + (frames - 1) * first[len(stacked)])
        meaning = f"numbers of {len(parts)} features, of {frames} decisions"
        vectors = self._allocate(Field(VECTOR, (size,), np.float32, -1.0, 1.0, "", meaning))
        known = numbers, first, len(stacked), frames, self._is_new
        self._observe.append(bind(write_vector, *known, vectors))

    def _add_arrays(self, choice: FeatureChoice, feature: Feature, *, is_stacked: bool) -> None:
        fields, frames = feature.fields(), self._features.frames
        if not is_stacked:
            arrays = [self._allocate(field) for field in fields]
            if arrays:
                self._observe.append(self._bound(choice, feature, *arrays))
            return
        arrays = [field.allocate(*self._shape) for field in fields]
        self._observe.append(self._bound(choice, feature, *arrays))
        for field, now in zip(fields, arrays, strict=True):
            shape = (*field.shape[:-1], frames * field.shape[-1])
            meaning = f"{field.meaning}; of {frames} decisions, oldest first"
            stack = self._allocate(replace(field, shape=shape, meaning=meaning))
            flat = (array.reshape(*self._shape, -1, array.shape[-1]) for array in (now, stack))
            now_flat, stack_flat = flat
            self._observe.append(bind(write_stack, now_flat, self._is_new, stack_flat))

    def _allocate(self, field: Field) -> NDArray:
        self.fields = (*self.fields, field)
        self.arrays[field.name] = field.allocate(*self._shape)
        return self.arrays[field.name]

    def _bound(self, choice: FeatureChoice, feature: Feature, *out: NDArray) -> Observe:
        """Return the function that observes a feature; of a user's own one that checks what it writes."""
        if not choice.is_own:
            return feature.bind(*out)
        doing, fields = f"the feature {choice.name!r}", feature.fields()
        observe: Any = guarded(guarded(feature.bind, doing)(*out), doing)

        def checked(observe_mask: Bools) -> None:
            observe(observe_mask)
            for field, array in zip(fields, out, strict=True):
                self._check(doing, field, array, observe_mask)

        return checked

    def _check(self, doing: str, field: Field, array: NDArray, observe_mask: Bools) -> None:
        """Raise if a user's feature wrote a number out of its bounds."""
        flat = array.reshape(*self._shape, -1)
        bad = observe_mask & ~((flat >= field.low) & (flat <= field.high)).all(axis=-1)
        if bad.any():
            row, agent = np.argwhere(bad)[0].tolist()
            raise OwnCodeError(
                f"{doing} is {flat[row, agent].tolist()} for {self._context.agents[agent]!r}",
                remedy=f"write numbers from {field.low:g} to {field.high:g}",
            )
