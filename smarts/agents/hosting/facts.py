"""Agents' interfaces as plain values, which messages carry."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import MISSING, fields, is_dataclass
from enum import Enum
from typing import Any, NamedTuple

from smarts.agents.checks import InterfaceError
from smarts.agents.criteria import DoneCriteria, EventConfiguration
from smarts.agents.hosting.options import HostError
from smarts.agents.interface import OLD_NAMES, SENSOR_OPTIONS, AgentInterface
from smarts.errors import SmartsError, nearest_names, shown
from smarts.registry import is_own_name
from smarts.types.actions import ActionSpaceType
from smarts_agent_kit.agents import LONGEST_DECISION

_OPTIONS: Mapping[str, type] = {
    **SENSOR_OPTIONS,
    "done_criteria": DoneCriteria,
    "event_configuration": EventConfiguration,
}
_REFUSED = ("further_sensors", "custom_renders")
"""Fields that may name code of the user's."""


def facts_of(interface: AgentInterface) -> dict[str, Any]:
    """Return an interface as plain values: the fields that differ from their defaults.

    Raises:
        HostError: A field cannot be sent.
    """
    return {each.name: _plain(each.name, value) for each, value in _changed(interface)}


def interface_from(facts: Any, place: str) -> AgentInterface:
    """Return the interface that plain values stand for.

    Raises:
        HostError: They stand for none; names the field.
    """
    if isinstance(facts, AgentInterface):
        return facts
    if not isinstance(facts, Mapping):
        raise HostError(
            f"the agent's interface is {shown(facts)}",
            place=place,
            remedy='give its class the attribute interface = {"action": "Lane"}',
        )
    known = [each.name for each in fields(AgentInterface) if each.name not in _REFUSED]
    for name in facts:
        if name not in known and name not in OLD_NAMES:
            raise HostError(
                f"an interface has no field {shown(name)} that an agent elsewhere may have",
                place=place,
                remedy=nearest_names(str(name), known),
            )
    try:
        return AgentInterface(
            **{name: _value(OLD_NAMES.get(str(name)) or str(name), given) for name, given in facts.items()}
        )
    except HostError:
        raise
    except (SmartsError, TypeError, ValueError) as error:
        problem = error.problem if isinstance(error, SmartsError) else str(error)
        raise HostError(
            f"the agent's interface is wrong: {problem}",
            place=place,
            remedy=error.remedy if isinstance(error, SmartsError) else "see AgentInterface for its fields",
        ) from error


class Facts(NamedTuple):
    """What a simulator has to know of an agent."""

    interface: AgentInterface
    observation: Any
    """Names of features."""
    period: int
    """Steps from one decision to the next."""


def facts_from(about: Mapping[str, Any], place: str) -> Facts:
    """Return what an agent elsewhere has said about itself, after a check of all of it.

    Raises:
        SmartsError: Something is not what it has to be.
    """
    return Facts(
        interface_from(about.get("interface"), place),
        check_observation(about.get("observation"), place),
        check_period(about.get("period"), place),
    )


def check_observation(observation: Any, place: str) -> Any:
    """Return what an agent elsewhere observes, after a check that it names no code of this machine's user.

    Raises:
        HostError: It does, or it is neither a name nor a list or dict.
    """
    if isinstance(observation, str):
        if is_own_name(observation) or ":" in observation:
            raise HostError(
                f"the agent observes {shown(observation)}, which is not a part of this project",
                place=place,
                remedy="an agent elsewhere observes features of docs/develop/extending.md",
            )
    elif isinstance(observation, Mapping):
        for name, each in observation.items():
            check_observation(name, place)
            check_observation(each, place)
    elif isinstance(observation, list | tuple):
        for each in observation:
            check_observation(each, place)
    elif not isinstance(observation, int | float | bool | None):
        raise HostError(
            f"the agent observes {shown(observation)}",
            place=place,
            remedy='give its class the names of features: observation = ["speed"]',
        )
    return observation


def check_period(period: Any, place: str) -> int:
    """Return how many steps an agent's decisions last.

    Raises:
        InterfaceError: It is no such number.
    """
    if isinstance(period, bool) or not isinstance(period, int) or not 1 <= period <= LONGEST_DECISION:
        raise InterfaceError(
            f"the agent's period is {shown(period)}",
            place=place,
            remedy=f"give a whole number of steps from 1 to {LONGEST_DECISION}",
        )
    return period


def _changed(owner: Any) -> list[tuple[Any, Any]]:
    """Return the fields of a dataclass that differ from their defaults, and their values."""
    found = []
    for each in fields(owner):
        default = each.default if each.default_factory is MISSING else each.default_factory()
        value = getattr(owner, each.name)
        if each.init and value != default:
            found.append((each, value))
    return found


def _plain(name: str, value: Any) -> Any:
    if isinstance(value, Enum):
        return value.name
    if is_dataclass(value) and name in _OPTIONS and type(value) is _OPTIONS[name]:
        return {each.name: _plain("", inner) for each, inner in _changed(value)}
    if isinstance(value, tuple):
        return [_plain("", each) for each in value]
    if value is None or isinstance(value, bool | int | float | str):
        return value
    raise HostError(
        f"{name or 'a value'} is {shown(value)}, which cannot be sent",
        place="AgentInterface",
        remedy="let the agent act in process, or give plain values",
    )


def _value(name: str, given: Any) -> Any:
    """Return a field's value from a plain one."""
    if name == "action" and isinstance(given, str):
        if given not in ActionSpaceType.__members__:
            raise InterfaceError(
                f"there is no action {given!r}", remedy=nearest_names(given, ActionSpaceType.__members__)
            )
        return ActionSpaceType[given]
    if name in _OPTIONS and isinstance(given, Mapping):
        return _OPTIONS[name](
            **{key: tuple(each) if isinstance(each, list) else each for key, each in given.items()}
        )
    return tuple(given) if isinstance(given, list) else given
