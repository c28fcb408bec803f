"""What is wrong with values of settings."""

from __future__ import annotations

from typing import Any, NamedTuple

from pydantic import BaseModel, ValidationError

from algorithms.settings.kinds import TAGS


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
