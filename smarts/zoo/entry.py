"""An entry of the zoo, and how it becomes an `AgentSpec`."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any

from smarts.agents.hosting.facts import interface_from
from smarts.agents.interface import OLD_NAMES, AgentInterface
from smarts.agents.policy import Agent
from smarts.agents.spec import AgentSpec
from smarts.errors import OwnCodeError, SmartsError, UnknownNameError, nearest_names, shown
from smarts.registry import guarded, load_own

VERSIONED = re.compile(r"[\w.-]+-v\d+")
"""The form of a name in the zoo: "idm-v0"."""

EntryPoint = Callable[..., Any] | str


@dataclass(frozen=True)
class ZooEntry:
    """A policy of the zoo, not yet imported."""

    name: str
    """Name with its version: "idm-v0"."""
    entry_point: EntryPoint
    """A subclass of `Agent` with an attribute `interface`, or a function that returns an `AgentSpec`; or the
    "module:attribute" of one."""
    module: str = ""
    """Module of the code that registered it, "" for the project's own."""
    defaults: Mapping[str, Any] = field(default_factory=dict)
    """Keywords of the entry point, unless the caller gives others."""
    author: str = ""
    m_level: str = ""
    """Multi-agent learning level of the paper, "M0" (fixed rules) to "M5" (social welfare); "" if unknown."""
    provenance: str = ""
    """Origin of the agent: a paper, or the run that it was trained in."""
    licence: str = ""

    @property
    def locator(self) -> str:
        """The name by which `make_spec` finds it."""
        return f"{self.module}:{self.name}" if self.module else self.name

    def load(self) -> Callable[..., Any]:
        """Import and return the entry point.

        Raises:
            OwnCodeError: It cannot be imported.
        """
        found = self.entry_point
        return load_own(found, f"agent {self.name!r}, entry point") if isinstance(found, str) else found

    def description(self) -> str:
        """Return the first sentence of the entry point's docstring."""
        # Not `getdoc`, which takes the docstring of a base class.
        return " ".join(inspect.cleandoc(self.load().__doc__ or "").split("\n\n")[0].split())

    def options(self) -> dict[str, Any]:
        """Return the names and defaults of the entry point's own keywords."""
        parameters = inspect.signature(self.load()).parameters.values()
        named = (each for each in parameters if each.kind not in (each.VAR_POSITIONAL, each.VAR_KEYWORD))
        return {each.name: self.defaults.get(each.name, each.default) for each in named}

    def spec(self, **options: Any) -> AgentSpec:
        """Return the agent's interface and how it is made.

        Args:
            **options: Keywords of the entry point. For a class they may also be fields of the interface:
                `vehicle_model="bullet"`, or `interface=...` for another one.

        Raises:
            SmartsError: There is no such option, or the entry is no agent.
            OwnCodeError: The entry point raises.
        """
        found, options = self.load(), {**self.defaults, **options}
        if isinstance(found, type) and issubclass(found, Agent):
            return self._spec_of_class(found, options)
        self._check_options(found, options, ())
        made = guarded(found, f"the agent {self.locator!r}")(**options)
        if not isinstance(made, AgentSpec) or not isinstance(made.interface, AgentInterface):
            raise _no_agent(self.locator, made)
        return made

    def _spec_of_class(self, kind: type[Agent], options: dict[str, Any]) -> AgentSpec:
        interface = options.pop("interface", getattr(kind, "interface", None))
        if isinstance(interface, Mapping):  # as agents of the kit have it
            interface = interface_from(interface, f"agent {self.locator!r}")
        if not isinstance(interface, AgentInterface):
            raise _no_agent(self.locator, kind)
        own = set(inspect.signature(kind).parameters)
        known = [*(each.name for each in fields(AgentInterface)), *OLD_NAMES]
        self._check_options(kind, options, known)
        changes = {name: value for name, value in options.items() if name in known and name not in own}
        params = {name: value for name, value in options.items() if name not in changes}
        return AgentSpec(interface.replace(**changes), agent_builder=kind, agent_params=params)

    def _check_options(self, called: Callable[..., Any], options: Mapping[str, Any], more: Any) -> None:
        """Raise unless the entry point, or its interface, takes the options, and none is missing."""
        parameters = inspect.signature(called).parameters.values()
        known = [each for each in parameters if each.kind not in (each.VAR_POSITIONAL, each.VAR_KEYWORD)]
        place = f"agent {self.locator!r}"
        for each in known:
            if each.default is each.empty and each.name not in options:
                raise SmartsError(
                    f"the agent needs the option {each.name!r}",
                    place=place,
                    remedy=f"give it: make_spec({self.locator!r}, {each.name}=...), or policy_kwargs",
                )
        names = [*(each.name for each in known), *more]
        takes_all = any(each.kind == each.VAR_KEYWORD for each in parameters)
        for name in () if takes_all else options:
            if name not in names:
                raise SmartsError(
                    f"the agent has no option {name!r}", place=place, remedy=nearest_names(name, names)
                )


def check_name(name: Any) -> None:
    """Raise `UnknownNameError` unless a name has a version."""
    if VERSIONED.fullmatch(str(name)) is None:
        raise UnknownNameError(
            f"{shown(name)} is no name of an agent",
            place="zoo",
            remedy="a name ends in its version: my-agent-v0",
        )


def entry_of(
    name: str,
    entry_point: EntryPoint,
    module: str,
    metadata: Mapping[str, str],
    defaults: Mapping[str, Any],
) -> ZooEntry:
    """Return an entry after a check of its values.

    Raises:
        UnknownNameError: The name has no version.
    """
    check_name(name)
    return replace(ZooEntry(name, entry_point, module, dict(defaults)), **metadata)


def _no_agent(locator: str, found: Any) -> OwnCodeError:
    return OwnCodeError(
        f"the agent {locator!r} is {shown(found)}, no agent with an interface",
        place="zoo",
        remedy="register a subclass of Agent with an attribute `interface = AgentInterface(...)`, or a "
        "function that returns an AgentSpec with one",
    )
