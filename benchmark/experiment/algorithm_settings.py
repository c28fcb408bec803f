"""Settings of registered and user-defined algorithms."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping
from functools import cache
from typing import Any

from algorithms.registry import ALGORITHMS, Entry
from algorithms.setting_kinds import SettingFault, faults
from algorithms.settings import JointSettings
from smarts.errors import nearest_names, shown
from smarts.registry import Registry


def _adopt(name: str, found: Any) -> Any:
    """Return the config class of a user's algorithm after checking that it can be instantiated."""
    from algorithms.joint.config import JointConfig  # here: loads torch and Ray

    if not isinstance(found, type) or not issubclass(found, JointConfig):
        raise ValueError("is not a subclass of algorithms.joint.config.JointConfig")
    if not isinstance(found.entry, Entry) and getattr(found, "algorithm", None) not in ALGORITHMS:
        raise ValueError("has no `entry`, as in examples/own_algorithm.py")
    found()
    return found


CONFIGS = Registry("algorithm", {name: entry.target for name, entry in ALGORITHMS.items()}, _adopt)
"""Name -> the algorithm's RLlib config class, a `JointConfig`; a user's own is "module:Class"."""


@cache
def entry_of(algorithm: str) -> Entry:
    """Return what an algorithm is: a line of the registry, or the `entry` of its own config.

    Raises:
        OwnCodeError: A `module:Class` cannot be imported, or is no algorithm.
    """
    return ALGORITHMS[algorithm] if algorithm in ALGORITHMS else CONFIGS[algorithm]().entry


OWN_DEFAULTS = {"checkpoint_replay": False}
"""Defaults in experiments that are not those of the library: buffers are hundreds of megabytes a minute, and
a run that continues fills its own again."""


def own_defaults(names: Iterable[str]) -> dict[str, Any]:
    """Return those of `OWN_DEFAULTS` that are among the names of an algorithm's settings."""
    known = {*names}
    return {name: value for name, value in OWN_DEFAULTS.items() if name in known}


def settings_of(algorithm: str) -> type[JointSettings]:
    """Return the class of an algorithm's settings.

    Raises:
        OwnCodeError: A `module:Class` cannot be imported, or is no algorithm.
    """
    return entry_of(algorithm).settings


def setting_names(algorithm: str) -> list[str]:
    """Return the names of an algorithm's settings; raises as `settings_of`."""
    return [*settings_of(algorithm).model_fields]


def setting_faults(algorithm: str, values: Mapping[str, Any]) -> Iterator[tuple[SettingFault, str, str]]:
    """Yield each fault of an algorithm's settings, with a text that names the value and a remedy."""
    for fault in faults(settings_of(algorithm), dict(values)):
        if fault.is_unknown:
            remedy = nearest_names(str(fault.key[0]), setting_names(algorithm))
            yield fault, f"{algorithm!r} has no such setting", remedy
        elif fault.key:
            yield fault, shown(fault.value), fault.problem[:1].lower() + fault.problem[1:]
        else:
            yield fault, f"{algorithm}: {fault.problem}", ""


def remedy_for_one(algorithm: str, fault: SettingFault) -> str:
    """Return how to set for one algorithm what all were given, if it alone cannot have the value; else ""."""
    name, own = str(fault.key[0]) if len(fault.key) == 1 else "", settings_of(algorithm)
    having = [kind for kind in own.__mro__ if issubclass(kind, JointSettings) and name in kind.model_fields]
    if all(faults(kind, {name: fault.value}) for kind in having):
        return ""
    default = own.model_fields[name].default
    value = default if isinstance(default, str) else json.dumps(default)
    return f"give it a value of its own, settings: {{{algorithm}: {{{name}: {value}}}}}"


def settings_table(algorithm: str) -> list[tuple[str, str, str, str]]:
    """Return a header, and name, default in experiments, allowed values and meaning of each setting.

    Raises:
        UnknownNameError: There is no such algorithm.
        OwnCodeError: A `module:Class` cannot be imported, or is no algorithm.
    """
    described = settings_of(algorithm).model_json_schema()["properties"]
    defaults = {name: part.get("default") for name, part in described.items()} | own_defaults(described)
    rows = [
        (name, json.dumps(defaults[name]), allowed(part), " ".join(part["description"].split()))
        for name, part in described.items()
    ]
    return [("setting", "default", "allowed", "meaning"), *rows]


LIMITS = {"minimum": ">=", "exclusiveMinimum": ">", "maximum": "<="}


def allowed(schema: Mapping[str, Any]) -> str:
    """Return which values a JSON schema allows, in words: "number > 0", "list of integer >= 1"."""
    choices = schema.get("enum") or ([schema["const"]] if "const" in schema else [])
    kinds = schema.get("anyOf") or schema.get("oneOf") or []
    if choices or kinds:
        return " or ".join([*map(json.dumps, choices), *map(allowed, kinds)])
    return _allowed_of_type(schema["type"], schema)


def _allowed_of_type(kind: str, schema: Mapping[str, Any]) -> str:
    if kind == "object":
        return f"name: {allowed(schema['additionalProperties'])}"
    if kind == "array":
        parts = schema.get("prefixItems")
        return f"[{', '.join(map(allowed, parts))}]" if parts else f"list of {allowed(schema['items'])}"
    return " ".join([kind, *(f"{sign} {schema[key]:g}" for key, sign in LIMITS.items() if key in schema)])
