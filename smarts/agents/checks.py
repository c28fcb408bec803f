"""Checks of users' values; each raises an error that names value, place and remedy."""

from __future__ import annotations

import functools
from dataclasses import field, fields
from typing import Annotated, Any, TypeVar, dataclass_transform

import numpy as np
from pydantic import BeforeValidator, ConfigDict, Field, ValidationError
from pydantic.dataclasses import dataclass
from pydantic_core import PydanticCustomError

from smarts.errors import SmartsError, nearest_names, shown

Made = TypeVar("Made")


class InterfaceError(SmartsError):
    """An agent's interface, or another setting of an environment, has a value that is not allowed."""


def _plain(value: Any) -> Any:
    """Return a number of NumPy as one of Python: kernels do not take all types."""
    return value.item() if isinstance(value, np.generic) else value


def _members(value: Any) -> Any:
    """Return the members of a sequence of any kind as a tuple; a text is not a list of letters."""
    if isinstance(value, str):
        raise PydanticCustomError("text", "Input should be a list, such as ['{value}']", {"value": value})
    return tuple(value) if np.iterable(value) else value


Plain = BeforeValidator(_plain)
Listed = BeforeValidator(_members)
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
    if first["type"] == "multiple_argument_values":
        return InterfaceError(f"{name} has its value already", place=where, remedy="leave it out")
    if first["type"] == "missing":
        return InterfaceError(f"{name} is missing", place=where, remedy="give it")
    said = [each["msg"].partition(" should ")[2] for each in errors if each["loc"][0] == place]
    remedy = f"it should {' or '.join(said)}"
    return InterfaceError(f"{name} is {shown(first['input'])}", place=where, remedy=remedy)
