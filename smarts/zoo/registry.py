"""Agents by locator: of this project, of installed packages, of users' modules.

A locator is a name with its version, "idm-v0", or "module:name-v0", which imports the module; the module
registers the agent itself.
"""

from __future__ import annotations

import importlib.metadata
import importlib.util
import itertools
import sys
from functools import cache
from pathlib import Path
from typing import Any

from smarts.agents.acting import built_agent
from smarts.agents.hosting.links import AtAddress, is_address
from smarts.agents.hosting.remote import remote_spec
from smarts.agents.interface import AgentInterface
from smarts.agents.policy import Agent
from smarts.agents.social import interface_of
from smarts.agents.spec import AgentSpec
from smarts.errors import SmartsError, UnknownNameError, nearest_names
from smarts.registry import guarded, load_module, own_error
from smarts.zoo.agents import AGENTS
from smarts.zoo.entry import EntryPoint, ZooEntry, check_name, entry_of

ORIGINALS = "zoo.policies"
"""The module of the original's agents, which its scenario files name."""
SERVED = {
    "keep-lane-agent-v0": "keep-lane-v0",
    "non-interactive-agent-v0": "non-interactive-v0",
    "chase-via-points-agent-v0": "chase-via-points-v0",
}
"""Name there -> name here."""
GROUP = "smarts.zoo"
"""The group of a package's entry points that are agents."""

_SEARCHED: dict[Path, None] = {}
"""Folders of scenarios whose modules locators may name; ordered."""
_REGISTERED: dict[tuple[str, str], ZooEntry] = {}
"""(module that registered it, name) -> entry."""


def register(
    locator: str,
    entry_point: EntryPoint,
    *,
    author: str = "",
    m_level: str = "",
    provenance: str = "",
    licence: str = "",
    **kwargs: Any,
) -> None:
    """Register an agent of the calling module's; registering it again replaces it.

    Args:
        locator: Its name with a version: "my-agent-v0".
        entry_point: A subclass of `Agent` with an attribute `interface`, or a function that returns an
            `AgentSpec`; or the "module:attribute" of one, which is imported when it is asked for.
        author: For `smarts-bench zoo`, as are the next three.
        m_level: "M0" to "M5", the paper's levels of multi-agent learning.
        provenance: Where it comes from: a paper, or the run it was trained in.
        licence: Licence of the code and weights.
        **kwargs: Defaults of the entry point's keywords.

    Raises:
        SmartsError: The name has no version, or the entry point cannot be one.
    """
    module = str(sys._getframe(1).f_globals.get("__name__", ""))
    metadata = {"author": author, "m_level": m_level, "provenance": provenance, "licence": licence}
    _REGISTERED[module, locator] = entry_of(locator, entry_point, module, metadata, kwargs)


def make_spec(locator: str, **kwargs: Any) -> AgentSpec:
    """Return the interface of an agent of the zoo and how it is made.

    Args:
        locator: "idm-v0", or "my_module:my-agent-v0".
        **kwargs: Options of the agent, see `smarts-bench zoo describe`; of an agent that is a class also
            fields of its interface, such as `vehicle_model="bullet"`.

    Raises:
        UnknownNameError: There is no such agent; the remedy names the nearest ones.
        OwnCodeError: Its module cannot be imported or raises, or the entry is no agent.
        SmartsError: It has no such option.
    """
    if is_address(locator):
        if kwargs:
            raise SmartsError(
                f"options are given: {', '.join(kwargs)}",
                place=f"agent {locator!r}",
                remedy="give them where the agent is served: smarts-bench serve AGENT --set KEY=VALUE",
            )
        return remote_spec(AtAddress(locator))
    return find_entry(locator).spec(**kwargs)


def make(locator: str, **kwargs: Any) -> AgentSpec:
    """Return the spec of an agent; the original's name of `make_spec`."""
    return make_spec(locator, **kwargs)


def make_agent(locator: str, **kwargs: Any) -> tuple[Agent, AgentInterface]:
    """Return an agent and its interface.

    Raises:
        SmartsError: As `make_spec`; or what its spec builds has no method `act`.
    """
    spec = make_spec(locator, **kwargs)
    agent = guarded(built_agent, f"making the agent {locator!r}")(spec, f"agent {locator!r}")
    return agent, interface_of(spec)


def build_agent(locator: str, **kwargs: Any) -> Agent:
    """Return an agent without its interface; see `make_agent`."""
    return make_agent(locator, **kwargs)[0]


def entries() -> list[ZooEntry]:
    """Return all agents that are known without importing a user's module, by name.

    These are the project's own, those of installed packages, and those that this process has registered.
    """
    found = {**_known(), **{entry.locator: entry for entry in _REGISTERED.values()}}
    return [found[name] for name in sorted(found)]


def find_entry(locator: str) -> ZooEntry:
    """Return the entry of a locator; imports its module if it names one.

    Raises:
        UnknownNameError: There is no such agent.
        OwnCodeError: Its module cannot be imported or raises.
    """
    module, _, name = str(locator).rpartition(":")
    if module == ORIGINALS:
        return AGENTS[_original(name)]
    check_name(name)
    if module in ("", __package__):
        return _named(name)
    _import(module, name)
    return _registered_by(module, name)


def search(folder: str | Path) -> None:
    """Let locators name modules of a scenario's folder by their path from its project's root.

    The original's scenarios do: "scenarios.sumo.loop.agent_prefabs:my-agent-v0". The folder's own name has to
    be that in the path. A module that can be imported by its name comes first.
    """
    _SEARCHED[Path(folder).absolute()] = None


def searched() -> list[str]:
    """Return the folders that `search` was given."""
    return [str(folder) for folder in _SEARCHED]


def _import(module: str, name: str) -> None:
    """Import a module, by its name or from a folder that is searched.

    Raises:
        OwnCodeError: There is no such module, or it raises.
    """
    if module in sys.modules:
        return
    file = _beside_scenario(module)
    if file is None or _is_importable(module):
        load_module(module, f"agent {name!r}")
        return
    spec = importlib.util.spec_from_file_location(module, file)
    assert spec is not None
    assert spec.loader is not None
    sys.modules[module] = importlib.util.module_from_spec(spec)
    try:
        spec.loader.exec_module(sys.modules[module])
    except Exception as error:
        del sys.modules[module]
        raise own_error(error, f"importing the agent {name!r}", str(file)) from error


def _beside_scenario(module: str) -> Path | None:
    """Return the file of a module in the searched folder whose path ends most like the module's name."""
    *packages, last = module.split(".")
    found: dict[int, Path] = {}
    for folder in _SEARCHED:
        file, pairs = folder / f"{last}.py", zip(reversed(folder.parts), reversed(packages), strict=False)
        alike = len([*itertools.takewhile(lambda pair: pair[0] == pair[1], pairs)])
        if alike and file.is_file():
            found.setdefault(alike, file)
    return found[max(found)] if found else None


def _is_importable(module: str) -> bool:
    try:
        return importlib.util.find_spec(module) is not None
    except (ImportError, ValueError):
        return False


def _named(name: str) -> ZooEntry:
    """Return the entry of a name without a module."""
    known = _known()
    if name in known:
        return known[name]
    of_process = [entry for (_, each), entry in _REGISTERED.items() if each == name]
    if len(of_process) == 1:
        return of_process[0]
    if of_process:
        raise UnknownNameError(
            f"{len(of_process)} modules have registered an agent {name!r}",
            place="zoo",
            remedy="name its module: " + " or ".join(repr(entry.locator) for entry in of_process),
        )
    raise UnknownNameError(
        f"there is no agent {name!r}",
        place="zoo",
        remedy=nearest_names(name, [entry.locator for entry in entries()])
        + "; `smarts-bench zoo list` lists them; an agent of your own is 'module:name-v0'",
    )


def _registered_by(module: str, name: str) -> ZooEntry:
    """Return what an imported module, or a module inside it, has registered under a name."""
    inside = {
        each: entry
        for (owner, each), entry in _REGISTERED.items()
        if owner == module or owner.startswith(f"{module}.")
    }
    if (module, name) in _REGISTERED:
        return _REGISTERED[module, name]
    if name in inside:
        return inside[name]
    raise UnknownNameError(
        f"the module {module!r} registers no agent {name!r}",
        place=str(getattr(sys.modules.get(module), "__file__", module)),
        remedy=nearest_names(name, inside)
        if inside
        else f"call smarts.zoo.register({name!r}, MyAgent) at the end of the module",
    )


def _original(name: str) -> str:
    """Return the name that stands for an agent of the original."""
    if name in SERVED:
        return SERVED[name]
    is_replay = name == "replay-agent-v0"
    raise UnknownNameError(
        f"the original's agent {name!r} is not part of this project",
        place=f"agent '{ORIGINALS}:{name}'",
        remedy="record an episode, then drive by its poses with 'trajectory-v0'"
        if is_replay
        else nearest_names(name, SERVED),
    )


def _known() -> dict[str, ZooEntry]:
    """Return the agents that can be named without a module: own ones win over packages'."""
    return {**_of_packages(), **AGENTS}


@cache
def _of_packages() -> dict[str, ZooEntry]:
    """Return the agents that installed packages declare as entry points."""
    found: dict[str, ZooEntry] = {}
    for point in importlib.metadata.entry_points(group=GROUP):
        about: dict[str, Any] = dict(point.dist.metadata.json) if point.dist else {}
        metadata = {
            "author": str(about.get("author") or about.get("author_email") or ""),
            "licence": str(about.get("license_expression") or about.get("license") or ""),
            "provenance": f"package {point.dist.name} {point.dist.version}" if point.dist else "",
        }
        found[point.name] = entry_of(point.name, point.value, "", metadata, {})
    return found
