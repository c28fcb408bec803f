"""Checks of users' values; each raises an error that names value, place and remedy."""

from __future__ import annotations

import functools
from dataclasses import field, fields
from typing import Annotated, Any, TypeVar, dataclass_transform

import numpy as np
from pydantic import BeforeValidator, ConfigDict, Field, ValidationError
from pydantic.dataclasses import dataclass

from smarts.errors import SmartsError, nearest_names, shown

Made = TypeVar("Made")


class InterfaceError(SmartsError):
    """An agent's interface, or another setting of an environment, has a value that is not allowed."""


def _plain(value: Any) -> Any:
    """Return a number of NumPy as one of Python: kernels do not take all types."""
    return value.item() if isinstance(value, np.generic) else value


def _members(value: Any) -> Any:
    """Return the members of a sequence of any kind as a tuple; a text is not a list of letters."""
    return value if isinstance(value, str) or not np.iterable(value) else tuple(value)


Plain = BeforeValidator(_plain)
Sequence = BeforeValidator(_members)
"""Makes a field of a tuple take a sequence of any kind."""
Count = Annotated[int, Plain, Field(ge=1)]
WholeFrom0 = Annotated[int, Plain, Field(ge=0)]
Number = Annotated[float, Plain, Field(allow_inf_nan=False)]
NumberFrom0 = Annotated[float, Plain, Field(ge=0)]
Positive = Annotated[float, Plain, Field(gt=0, allow_inf_nan=False)]


@dataclass_transform(frozen_default=True, field_specifiers=(field,))
def checked(kind: type[Made]) -> type[Made]:
    """Make a class a frozen dataclass whose fields are checked, by pydantic, and not converted.

    It raises an `InterfaceError` for the first field that is unknown, missing, or of a wrong type or range;
    errors name the class as its `PLACE` says, by default by its own name.
    """
    made: Any = dataclass(frozen=True, config=ConfigDict(strict=True, extra="forbid"))(kind)
    construct = made.__init__

    @functools.wraps(construct)
    def initialise(self: Any, *values: Any, **named: Any) -> None:
        try:
            construct(self, *values, **named)
        except ValidationError as error:
            raise _first_of(error, made) from None

    made.__init__ = initialise
    return made


def _first_of(error: ValidationError, kind: type) -> InterfaceError:
    """Return the error of the first field; pydantic reports one for each type that a value does not fit."""
    names = [each.name for each in fields(kind)]  # type: ignore[arg-type]
    errors: list[Any] = sorted(error.errors(include_url=False), key=lambda each: each["type"] == "missing")
    first, place = errors[0], errors[0]["loc"][0]
    where = getattr(kind, "PLACE", kind.__name__)
    name = str(dict(enumerate(names)).get(place, place))  # values without a keyword are numbered
    if first["type"] == "unexpected_keyword_argument":
        remedy = nearest_names(name, names)
        return InterfaceError(f"there is no field {name!r}", place=where, remedy=remedy)
    if first["type"] == "unexpected_positional_argument":
        problem = f"there is no field for {shown(first['input'])}"
        return InterfaceError(problem, place=where, remedy=f"give at most {len(names)} without a name")
    if first["type"] == "missing":
        return InterfaceError(f"{name} is missing", place=where, remedy="give it")
    said = [each["msg"].removeprefix("Input should be ") for each in errors if each["loc"][0] == place]
    remedy = f"it should be {' or '.join(said)}"
    return InterfaceError(f"{name} is {shown(first['input'])}", place=where, remedy=remedy)


def check_instance(
    name: str, value: Any, kind: type | tuple[type, ...], example: str, place: str = ""
) -> None:
    """Raise unless a value is of a type.

    Raises:
        InterfaceError: The value is of another type; the remedy shows an example.
    """
    if not isinstance(value, kind):
        raise _refusal(name, value, place, f"give {example}")


def check_truth(name: str, value: Any, place: str = "") -> None:
    """Raise unless a value is True or False."""
    check_instance(name, value, (bool, np.bool_), "True or False", place)


def _refusal(name: str, value: Any, place: str, remedy: str) -> InterfaceError:
    return InterfaceError(f"{name} is {shown(value)}", place=place or name, remedy=remedy)
