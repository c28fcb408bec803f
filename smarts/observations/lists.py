"""Observations as lists of features: by name in `observations.yaml`, as a dict, or as a `FeatureList`."""

from __future__ import annotations

import inspect
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import Any, get_type_hints

import yaml
from pydantic import TypeAdapter, ValidationError

from smarts.errors import SmartsError, UnknownNameError, nearest_names
from smarts.observations import FEATURES
from smarts.observations.context import AdapterContext
from smarts.observations.feature import Feature
from smarts.registry import guarded, is_own_name

_FILE = Path(__file__).with_name("observations.yaml")
_KEYS = ("base", "drop", "frames", "stacked", "features")


@dataclass(frozen=True)
class FeatureChoice:
    """A feature of a list."""

    source: str | type[Feature]
    """A name of `FEATURES`, or a user's own: "module:Class", or the class itself."""
    options: Mapping[str, Any] = field(default_factory=dict)

    @property
    def name(self) -> str:
        """For errors and layouts."""
        return self.source if isinstance(self.source, str) else self.source.__name__

    @property
    def is_own(self) -> bool:
        """Whether the feature is a user's."""
        return not isinstance(self.source, str) or is_own_name(self.source)

    def kind(self) -> type[Feature]:
        """Return the class.

        Raises:
            UnknownNameError: There is no such feature.
            OwnCodeError: It is not importable, or not a feature.
        """
        return FEATURES[self.source] if isinstance(self.source, str) else self.source

    def make(self, context: AdapterContext) -> Feature:
        """Return the feature of some agents.

        Raises:
            SmartsError: It has no such option, or an option is not possible.
            OwnCodeError: It is the user's own and raises.
        """
        kind = self.kind()
        known = [*inspect.signature(kind).parameters][1:]
        for option in self.options:
            if option not in known:
                raise SmartsError(
                    f"the feature {self.name!r} has no option {option!r}",
                    place="observation",
                    remedy=nearest_names(str(option), known),
                )
        if self.is_own:
            return guarded(kind, f"the feature {self.name!r}")(context, **self.options)
        types: Mapping[str, Any] = get_type_hints(kind.__init__, include_extras=True)
        for option, value in self.options.items():
            try:
                TypeAdapter(types[option]).validate_python(value, strict=True)
            except ValidationError as error:
                problem = f"{option} of the feature {self.name!r} is {value!r}"
                raise SmartsError(problem, place="observation", remedy=error.errors()[0]["msg"]) from error
        made: Any = kind
        return made(context, **self.options)


@dataclass(frozen=True)
class FeatureList:
    """What agents observe."""

    stacked: tuple[FeatureChoice, ...] = ()
    """Kept for the last `frames` decisions, oldest first; at first, all are the first decision's."""
    features: tuple[FeatureChoice, ...] = ()
    """Features of the last decision alone, behind the stacked ones."""
    frames: int = 3
    reward: str = "benchmark"
    """Name of the reward that agents get if the caller gives none."""

    def __post_init__(self) -> None:
        if isinstance(self.frames, bool) or not isinstance(self.frames, int) or self.frames < 1:
            remedy = "give a whole number of decisions, 1 or more"
            raise SmartsError(f"frames is {self.frames!r}", place="observation", remedy=remedy)
        for each in (*self.stacked, *self.features):
            each.kind()

    def plus(self, stacked: Sequence[Any] = (), features: Sequence[Any] = ()) -> FeatureList:
        """Return the list with more features at the ends.

        Args:
            stacked: Names, own classes, or dicts of a name and its options.
            features: The same.
        """
        return replace(
            self,
            stacked=(*self.stacked, *map(_choice, stacked)),
            features=(*self.features, *map(_choice, features)),
        )

    def without(self, dropped: Sequence[Any]) -> FeatureList:
        """Return the list without some features.

        Args:
            dropped: Their names.

        Raises:
            UnknownNameError: The list has no such feature.
        """
        known = [each.name for each in (*self.stacked, *self.features)]
        for name in dropped:
            if name not in known:
                raise UnknownNameError(
                    f"there is no feature {name!r} to drop",
                    place="observation",
                    remedy=nearest_names(str(name), known),
                )
        kept = [
            tuple(each for each in choices if each.name not in dropped)
            for choices in (self.stacked, self.features)
        ]
        return replace(self, stacked=kept[0], features=kept[1])

    @property
    def needs_equal_sensors(self) -> bool:
        """Whether agents need the same sensors to be observed together."""
        return any(each.kind().needs_equal_sensors for each in (*self.stacked, *self.features))

    def layout(self, agents: int) -> dict[str, slice]:
        """Return where each feature's numbers are in the vector of one of some agents; newest frame only."""
        places, begin = {}, 0
        for choices, frames in ((self.stacked, self.frames), (self.features, 1)):
            kinds = [(each.name, each.kind()) for each in choices]
            sizes = {name: kind.size_for(agents) for name, kind in kinds if kind.in_vector}
            begin += (frames - 1) * sum(sizes.values())
            for name, size in sizes.items():
                places[name] = slice(begin, begin + size)
                begin += size
        return places


Observed = str | FeatureList | Mapping[str, Any] | Sequence[Any]
"""A name of `observations.yaml`, a `FeatureList`, a dict: {"base": "benchmark", "drop": ["agent_index"],
"stacked": ["image"]}, or a list of features of the last decision: ["goal", "speed"]."""


def feature_list(given: Observed) -> FeatureList:
    """Return the features that a name, a dict or a list stands for.

    Raises:
        SmartsError: There is no such observation, key or feature; the remedy names the nearest.
    """
    if isinstance(given, FeatureList):
        return given
    if isinstance(given, str):
        return _named(given)
    if isinstance(given, Sequence):
        given = {"features": given}
    if not isinstance(given, Mapping):
        raise SmartsError(
            f"{given!r} is not an observation",
            place="observation",
            remedy="give a name, a list or dict of features, or FeatureList(...)",
        )
    for key in given:
        if key not in _KEYS:
            raise SmartsError(
                f"there is no key {key!r}", place="observation", remedy=nearest_names(str(key), _KEYS)
            )
    base = feature_list(given["base"]) if "base" in given else FeatureList()
    base = base.without(_sequence(given, "drop"))
    made = base.plus(_sequence(given, "stacked"), _sequence(given, "features"))
    return replace(made, frames=given["frames"]) if "frames" in given else made


def observation_names() -> list[str]:
    """Return the names of `observations.yaml`."""
    return [*_file()]


@cache
def _file() -> Mapping[str, Any]:
    return yaml.safe_load(_FILE.read_text())


def _named(name: str) -> FeatureList:
    if name not in _file():
        raise SmartsError(
            f"there is no observation {name!r}", place="observation", remedy=nearest_names(name, _file())
        )
    content = dict(_file()[name])
    reward = content.pop("reward")
    return replace(feature_list(content), reward=reward)


def _sequence(given: Mapping[str, Any], key: str) -> Sequence[Any]:
    names = given.get(key, ())
    if isinstance(names, str) or not isinstance(names, Sequence):
        raise SmartsError(
            f"{key} is {names!r}", place="observation", remedy="give a list of features: [goal, speed]"
        )
    return names


def _choice(given: Any) -> FeatureChoice:
    if isinstance(given, FeatureChoice):
        return given
    if isinstance(given, str) or (isinstance(given, type) and issubclass(given, Feature)):
        return FeatureChoice(given)
    if isinstance(given, Mapping) and len(given) == 1:
        ((name, options),) = given.items()
        if isinstance(name, str) and isinstance(options, Mapping):
            return FeatureChoice(name, dict(options))
    raise SmartsError(
        f"{given!r} is not a feature",
        place="observation",
        remedy="give a name, or a name and its options: {image: {size: 64}}",
    )
