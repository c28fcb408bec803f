"""Types of settings' values: ranges, schedules, groups, graphs; and what is wrong with others."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import Annotated, Any, Literal, NamedTuple

from pydantic import AfterValidator, BaseModel, Discriminator, Field, InstanceOf, Tag, ValidationError
from pydantic.json_schema import SkipJsonSchema
from pydantic_core import PydanticCustomError

Count = Annotated[int, Field(ge=1)]
Number = Annotated[int, Field(ge=0)]
Fraction = Annotated[float, Field(ge=0, le=1)]
Positive = Annotated[float, Field(gt=0)]
NotNegative = Annotated[float, Field(ge=0)]
Place = Annotated[str, AfterValidator(os.path.abspath)]
# YAML has lists only, which a strict tuple refuses.
LIST = Field(strict=False)
Widths = Annotated[tuple[Count, ...], LIST]
SomeWidths = Annotated[tuple[Count, ...], Field(min_length=1), LIST]
FirstAndLast = Annotated[tuple[Fraction, Fraction], LIST]
FirstAndLastPositive = Annotated[tuple[Positive, Positive], LIST]


@dataclass(frozen=True)
class Near:
    """Agents within a distance of each other are neighbours.

    Attributes:
        radius: Largest distance, in the unit of the positions.
        leaf: Observation leaf that holds each agent's position.
        components: Places of the coordinates in the flattened leaf.
    """

    radius: float
    leaf: str = ""
    components: tuple[int, ...] = (0, 1)


PLAIN, POINTS, GROUPS, FUNCTION, PAIRS, NEAR = (
    Tag(name) for name in ("plain", "points", "groups", "function", "pairs", "near")
)
TAGS = {tag.tag for tag in (PLAIN, POINTS, GROUPS, FUNCTION, PAIRS, NEAR)}


def _choose(kinds: dict[Tag, Any]) -> Discriminator:
    """Check a value against the alternative of its Python type, so that it has one error and not several."""

    def tag_of(value: object) -> str:
        return next((tag.tag for tag, kind in kinds.items() if isinstance(value, kind)), PLAIN.tag)

    return Discriminator(tag_of)


def _rising(points: tuple[tuple[float, float], ...]) -> tuple[tuple[float, float], ...]:
    steps = [step for step, _ in points]
    if len(steps) < 2 or steps[0] != 0 or any(later <= earlier for earlier, later in pairwise(steps)):
        raise PydanticCustomError(
            "schedule",
            "Input should be a number, or two or more points whose steps begin at 0 and rise: "
            "[[0, 0.01], [10000, 0.001]]",
        )
    return points


SCHEDULE = _choose({POINTS: list | tuple})
"""A number, or points [environment step, value] that straight lines join, as RLlib writes schedules."""
FractionPoint = Annotated[tuple[NotNegative, Fraction], LIST]
WeightPoint = Annotated[tuple[NotNegative, NotNegative], LIST]
ScheduledFraction = Annotated[
    Annotated[Fraction, PLAIN] | Annotated[tuple[FractionPoint, ...], LIST, AfterValidator(_rising), POINTS],
    SCHEDULE,
]
ScheduledWeight = Annotated[
    Annotated[NotNegative, PLAIN] | Annotated[tuple[WeightPoint, ...], LIST, AfterValidator(_rising), POINTS],
    SCHEDULE,
]


def _apart(groups: dict[str, tuple[str, ...]]) -> dict[str, tuple[str, ...]]:
    counts = Counter(agent for members in groups.values() for agent in members)
    for agent, count in counts.items():
        if count > 1:
            raise ValueError(f"{agent} is in {count} groups, instead of in one")
    return groups


Members = Annotated[tuple[str, ...], LIST]
Sharing = Annotated[
    Annotated[Literal["none", "all"], PLAIN]
    | Annotated[dict[str, Members], AfterValidator(_apart), GROUPS]
    | SkipJsonSchema[Annotated[Callable[[str], str], FUNCTION]],
    _choose({GROUPS: dict, FUNCTION: Callable}),
]
Pair = Annotated[tuple[str, str], LIST]
Graph = Annotated[
    Annotated[Literal["auto", "environment", "all", "ring"], PLAIN]
    | Annotated[tuple[Pair, ...], LIST, PAIRS]
    | SkipJsonSchema[Annotated[InstanceOf[Near], NEAR]],
    _choose({PAIRS: list | tuple, NEAR: Near}),
]


def check_heads(heads: int, hidden: tuple[int, ...]) -> None:
    """Raise ValueError if the heads of an attention do not divide the width that they share."""
    if hidden[-1] % heads:
        raise ValueError(f"attention_heads={heads} does not divide the last of hidden={hidden}")


class SettingFault(NamedTuple):
    """A value that does not fit.

    Attributes:
        key: Name of the setting and places within its value; () for settings that do not fit each other.
        value: The value.
        problem: What it should be.
        is_unknown: Whether there is no such setting.
    """

    key: tuple[str | int, ...]
    value: Any
    problem: str
    is_unknown: bool

    def __str__(self) -> str:
        """Return name, value and problem, as in "lr[0][1]=3: Input should be ..."."""
        name, *places = self.key or ("",)
        where = str(name) + "".join(f"[{place}]" for place in places)
        return f"{where}={self.value!r}: {self.problem}" if self.key else self.problem


def faults(settings: type[BaseModel], values: dict[str, Any]) -> list[SettingFault]:
    """Return what is wrong with values of settings."""
    try:
        settings.model_validate(values)
    except ValidationError as error:
        return [
            SettingFault(
                tuple(part for depth, part in enumerate(each["loc"]) if depth != 1 or part not in TAGS),
                each["input"],
                each["msg"].removeprefix("Value error, ").replace("valid tuple", "list"),
                each["type"] == "extra_forbidden",
            )
            for each in error.errors(include_url=False)
        ]
    return []
