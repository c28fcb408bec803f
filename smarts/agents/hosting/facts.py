"""Agents' interfaces as plain values, which messages carry."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import fields
from typing import Any, NamedTuple

from pydantic import TypeAdapter, ValidationError

from smarts.agents.checks import InterfaceError
from smarts.agents.hosting.options import HostError
from smarts.agents.interface import OLD_NAMES, AgentInterface
from smarts.errors import SmartsError, nearest_names, shown
from smarts.types.actions import ActionSpaceType
from smarts_agent_kit.agents import LONGEST_DECISION

_INTERFACE = TypeAdapter(AgentInterface)
_SENT = {each.name for each in fields(AgentInterface)} - {"further_sensors", "custom_renders"}
"""Fields that name no code of the user's."""


def facts_of(interface: AgentInterface) -> dict[str, Any]:
    """Return an interface as plain values: the fields that differ from their defaults.

    Raises:
        HostError: It has sensors of the user's own, which cannot be sent.
    """
    if interface.further_sensors:
        raise HostError(
            f"the sensors {shown(interface.further_sensors)} cannot be sent",
            place="AgentInterface",
            remedy="let the agent act in process, or leave them out",
        )
    facts = _INTERFACE.dump_python(interface, mode="json", exclude_defaults=True)
    return facts if interface.action is None else facts | {"action": interface.action.name}


def interface_from(facts: Any, place: str) -> AgentInterface:
    """Return the interface that plain values stand for.

    Raises:
        HostError: They stand for none; names the field.
    """
    if isinstance(facts, AgentInterface):
        return facts
    remedy = 'give its class fields of AgentInterface: interface = {"action": "Lane"}'
    try:
        values = {OLD_NAMES.get(name, name): value for name, value in facts.items()}
        for name in map(str, values.keys() - _SENT):
            problem = f"there is no field {name!r} that can be sent"
            raise InterfaceError(problem, remedy=nearest_names(name, _SENT))
        action = values.get("action")
        if isinstance(action, str):
            if action not in ActionSpaceType.__members__:
                remedy = nearest_names(action, ActionSpaceType.__members__)
                raise InterfaceError(f"there is no action {action!r}", remedy=remedy)
            values["action"] = ActionSpaceType[action].value
        # As JSON, in which dicts stand for options and lists for tuples.
        return _INTERFACE.validate_json(json.dumps(values))
    except SmartsError as error:
        problem, remedy = error.problem, error.remedy or remedy
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        problem = f"{'.'.join(map(str, first['loc']))}: {first['msg']}"
    except (AttributeError, TypeError) as error:
        problem = f"it is {shown(facts)}: {error}"
    raise HostError(f"the agent's interface is wrong: {problem}", place=place, remedy=remedy)


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
        HostError: It does.
    """
    if isinstance(observation, str) and ":" in observation:
        raise HostError(
            f"the agent observes {shown(observation)}, which is not a part of this project",
            place=place,
            remedy="an agent elsewhere observes features of docs/develop/extending.md",
        )
    if isinstance(observation, Mapping | list | tuple):
        parts = observation.items() if isinstance(observation, Mapping) else observation
        for each in parts:
            check_observation(each, place)
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
