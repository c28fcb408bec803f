"""What users give to the environments, checked before anything is built from it."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from smarts.agents.checks import InterfaceError, check_instance, check_whole
from smarts.errors import ScenarioError, nearest_names

LONGEST_DECISION = 100
"""The most steps of a decision."""
MOST_AGENTS = 1000
MOST_WORLDS = 65_536
ALL = "__all__"
"""What the done flags of the episode are called, so no agent."""


def check_scenarios(scenarios: Any) -> None:
    """Refuse what is not a list of names and folders.

    Raises:
        ScenarioError: It is a single one, nothing, or has something else in it.
    """
    if isinstance(scenarios, str | Path):
        remedy = f"give a list: scenarios=[{str(scenarios)!r}]"
        raise ScenarioError(f"scenarios is {scenarios!r}, not a list", place="scenarios", remedy=remedy)
    remedy = "give a list of folders and names, such as ['loop']"
    if not isinstance(scenarios, Sequence):
        raise ScenarioError(f"scenarios is {scenarios!r}, not a list", place="scenarios", remedy=remedy)
    for scenario in scenarios:
        if not isinstance(scenario, str | Path):
            raise ScenarioError(f"{scenario!r} is not a scenario", place="scenarios", remedy=remedy)


def check_traffic(traffic: Any) -> None:
    """Refuse what is neither None nor a list of names.

    Raises:
        ScenarioError: It is a single name, an empty list, or has something else in it.
    """
    if traffic is None:
        return
    if isinstance(traffic, str):
        remedy = f"give a list: traffic=[{traffic!r}]"
    elif isinstance(traffic, Sequence) and traffic and all(isinstance(name, str) for name in traffic):
        return
    else:
        remedy = "give a list of the names of variations, or None for all"
    raise ScenarioError(f"traffic is {traffic!r}", place="traffic", remedy=remedy)


def check_agents(agents: Any) -> None:
    """Refuse what is neither a number of agents nor a mapping with names that agents may have.

    Raises:
        InterfaceError: It is not; whether the values are interfaces is not looked at.
    """
    if not isinstance(agents, Mapping):
        if isinstance(agents, bool) or not isinstance(agents, int | np.integer):
            remedy = "give how many, or a dict with the spec or interface of each by its name"
            raise InterfaceError(f"the agents are {agents!r}", place="agents", remedy=remedy)
        check_whole("agents", agents, 1, MOST_AGENTS)
        return
    for name in agents:
        if not isinstance(name, str) or not name or name == ALL:
            raise InterfaceError(
                f"an agent is called {name!r}",
                place="agents",
                remedy=f"give texts as names, not empty ones and not {ALL!r}, which is what all are called",
            )


def check_options(make: Callable[..., Any], options: Any, place: str = "adapter_options") -> None:
    """Refuse options that a class or function does not take by name.

    Raises:
        InterfaceError: There is no such option; the remedy names the nearest.
    """
    check_instance(place, options, Mapping, "a dict of options by their names, such as {'reward': 'paper'}")
    try:
        parameters = inspect.signature(make).parameters.values()
    except (TypeError, ValueError):
        raise InterfaceError(
            f"the adapter is {make!r}",
            place="adapter",
            remedy="give a name, or a class that is called with the agents, their interface and the options",
        ) from None
    if any(each.kind == each.VAR_KEYWORD for each in parameters):
        return
    by_name = (inspect.Parameter.KEYWORD_ONLY, inspect.Parameter.POSITIONAL_OR_KEYWORD)
    # The first two are the agents and their interface.
    known = [each.name for each in [*parameters][2:] if each.kind in by_name]
    for name in options:
        if name not in known:
            raise InterfaceError(
                f"the adapter has no option {name!r}", place=place, remedy=nearest_names(str(name), known)
            )
