"""Models of the algorithms' settings, made from the table that the algorithms publish."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pydantic import create_model

from algorithms.settings import settings
from smarts.config import ConfigError, Section, fitted

KINDS: dict[str, Any] = {
    "sharing": str | dict[str, list[str]],
    **dict.fromkeys(("lr", "entropy_coeff"), float | list[list[float]]),
}
"""Settings that take more than what their default is like."""


def _kind(name: str, default: Any) -> Any:
    if name in KINDS:
        return KINDS[name]
    if isinstance(default, bool):
        return bool
    return {int: int | None, float: float | None, str: str, list: list[Any]}.get(type(default), Any)


def _section(name: str, defaults: Mapping[str, Any]) -> Any:
    fields: dict[str, Any] = {key: (_kind(key, value), value) for key, value in defaults.items()}
    return create_model(name, __base__=Section, **fields)


_BY_ALGORITHM = {name: _section(name, defaults) for name, defaults in settings().items()}

SettingsByAlgorithm: Any = create_model(
    "SettingsByAlgorithm",
    __base__=Section,
    **{name: (section | None, None) for name, section in _BY_ALGORITHM.items()},  # type: ignore[arg-type]
)
"""A section for each algorithm, each with its settings."""

CommonSettings: Any = _section(
    "CommonSettings", {key: value for defaults in settings().values() for key, value in defaults.items()}
)
"""The settings of all algorithms."""


def type_fault(algorithm: str, name: str, value: Any) -> str:
    """Return why a value is none of a setting, whatever its range; nothing if it can be."""
    try:
        fitted({name: value}, _BY_ALGORITHM[algorithm])
    except ConfigError as error:
        return f"{value!r}: {error.problems[0].remedy}"
    return ""
