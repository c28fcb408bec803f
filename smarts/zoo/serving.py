"""Makes agents of the zoo in other processes, for `smarts.agents.hosting`."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Mapping
from typing import Any

from smarts.agents.hosting.facts import facts_of
from smarts.agents.hosting.links import InChildProcess
from smarts.agents.hosting.options import RAY, HostError, HostOptions, Starter
from smarts.agents.policy import BatchAgent
from smarts.registry import import_own, own_paths
from smarts.shipped import local, original
from smarts.zoo.registry import make_agent, search, searched
from smarts_agent_kit.server import AddressError, serve_address


def load(values: Mapping[str, Any]) -> tuple[Any, Mapping[str, Any]]:
    """Return an agent of the zoo, and what its simulator has to know of it.

    Args:
        values: Its locator as `agent`, its `options`, and where own code is: `imports` and `searched`.

    Raises:
        SmartsError: There is no such agent, or it has no such option.
        HostError: It does not act on arrays.
    """
    import_own(values.get("imports", ()))
    for folder in values.get("searched", ()):
        search(local(folder))
    locator = values["agent"]
    agent, interface = make_agent(locator, **values.get("options", {}))
    if not isinstance(agent, BatchAgent):
        raise HostError(
            f"{locator!r} acts on Observation objects",
            place=f"agent {locator!r}",
            remedy="only a BatchAgent, which acts on arrays, acts in another process",
        )
    return agent, {"observation": agent.observation, "period": agent.period, "interface": facts_of(interface)}


def start_values(locator: str, options: Mapping[str, Any]) -> dict[str, Any]:
    """Return what `load` needs to make an agent in another process as it would be made here.

    Own code that has been removed since it was imported is left out: another agent may not need it.
    """
    found = (filter(os.path.exists, paths) for paths in (own_paths(), searched()))
    imports, folders = ([str(original(path)) for path in paths] for paths in found)
    return {"agent": locator, "options": dict(options), "imports": imports, "searched": folders}


def serve(
    locator: str, options: Mapping[str, Any], address: str, ready: Callable[[str], object] = print
) -> None:
    """Serve an agent of this environment at an address, until the process is interrupted.

    Args:
        locator: Locator of the agent.
        options: Its options.
        address: HOST:PORT; port 0: any free one.
        ready: Is called with the address that is served.

    Raises:
        SmartsError: There is no such agent, or it cannot be served there.
    """
    values = start_values(locator, options)
    load(values)  # what cannot be made is said now, not to the first simulator
    paths = [os.path.abspath(path) for path in sys.path]
    try:
        serve_address(address, __name__, values, paths=paths, ready=ready)
    except AddressError as error:
        raise HostError(str(error), place="--address") from error


def starter(locator: str, options: Mapping[str, Any], host: HostOptions) -> Starter:
    """Return what starts an agent of this environment where `host` says.

    Raises:
        HostError: Ray is not running.
    """
    values, place = start_values(locator, options), f"agent {locator!r}"
    if host.where == RAY:
        # Only runs with such hosts wait for Ray.
        from smarts.agents.hosting.ray_actor import AsRayActor

        return AsRayActor(__name__, values, place)
    return InChildProcess(__name__, values, place, host.memory)
