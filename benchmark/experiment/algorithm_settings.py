"""The algorithms' settings: from the table that the registry's publish, of others from their config class."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from typing import Any

from pydantic import ConfigDict, create_model

from algorithms.joint.ranges import COUNT, Values, declared
from algorithms.registry import ALGORITHMS, Entry
from algorithms.settings import OF_RUNNERS, defaults_of_config, settings, values
from smarts.config import ConfigError, Section, fitted
from smarts.registry import Registry, is_own_name

KINDS: dict[str, Any] = {
    "sharing": str | dict[str, list[str]],
    **dict.fromkeys(("lr", "entropy_coeff"), float | list[list[float]]),
}
"""Settings that take more than what their default is like."""


def _adopt(name: str, found: Any) -> Any:
    """Return the config class of a user's algorithm, of which one can be made."""
    from algorithms.joint.config import JointConfig  # here: loads torch and Ray

    if not isinstance(found, type) or not issubclass(found, JointConfig):
        raise ValueError("is no subclass of algorithms.joint.config.JointConfig")
    config = found()
    if not isinstance(found.entry, Entry) and getattr(config, "algorithm", None) not in ALGORITHMS:
        raise ValueError("has no `entry` that says what it is, as in examples/own_algorithm.py")
    return found


CONFIGS = Registry("algorithm", {name: entry.target for name, entry in ALGORITHMS.items()}, _adopt)
"""Name -> the algorithm's RLlib config class, a `JointConfig`; a user's own is "module:Class"."""


def entry_of(algorithm: str) -> Entry:
    """Return what an algorithm is: a line of the registry, or the `entry` of its own config.

    Raises:
        OwnCodeError: A `module:Class` cannot be imported, or is no algorithm.
    """
    return ALGORITHMS[algorithm] if algorithm in ALGORITHMS else CONFIGS[algorithm]().entry


@cache
def defaults_of(algorithm: str) -> Mapping[str, Any]:
    """Return the default of each of an algorithm's settings.

    Raises:
        OwnCodeError: A `module:Class` cannot be imported, or is no algorithm.
    """
    if algorithm in ALGORITHMS:
        return settings()[algorithm]
    return defaults_of_config(CONFIGS[algorithm]())


def limits_of(algorithm: str, name: str) -> Values | None:
    """Return the values that a setting may take; None: any."""
    if name in OF_RUNNERS:
        return COUNT
    if algorithm in ALGORITHMS:
        return values()[algorithm].get(name)
    return declared(CONFIGS[algorithm]).get(name)


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


class OwnSections(Section):
    """Has sections of algorithms that are "module:Class", too, which are checked against their configs."""

    model_config = ConfigDict(extra="allow")
    __pydantic_extra__: dict[str, dict[str, Any]]  # type: ignore[reportIncompatibleVariableOverride]


SettingsByAlgorithm: Any = create_model(
    "SettingsByAlgorithm",
    __base__=OwnSections,
    **{name: (section | None, None) for name, section in _BY_ALGORITHM.items()},  # type: ignore[arg-type]
)
"""A section for each algorithm, each with its settings."""

CommonSettings: Any = _section(
    "CommonSettings", {key: value for defaults in settings().values() for key, value in defaults.items()}
)
"""The settings of all algorithms."""


@cache
def _model_of(algorithm: str) -> Any:
    if not is_own_name(algorithm):
        return _BY_ALGORITHM[algorithm]
    return _section("OwnSettings", defaults_of(algorithm))


def type_fault(algorithm: str, name: str, value: Any) -> str:
    """Return why a value is none of a setting, whatever its range; nothing if it can be."""
    try:
        fitted({name: value}, _model_of(algorithm))
    except ConfigError as error:
        return f"{value!r}: {error.problems[0].remedy}"
    return ""
