"""The JSON schema of experiment files, for editors: `smarts-bench schema` prints it."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from pydantic.json_schema import models_json_schema

from algorithms.registry import ALGORITHMS
from benchmark.experiment.models import Experiment
from benchmark.experiment.values import ACTION_NAMES
from benchmark.metrics import METRICS
from benchmark.scripted import SCRIPTED_POLICIES
from smarts.config import EXTENDS
from smarts.registry import is_own_name
from smarts.types.traffic import TRAFFIC_ENGINES

OWN = r"^[\w.]+:[\w.]+$"
"""Names of own code, "module:Class"."""


def schema() -> dict[str, Any]:
    """Return the schema of experiment files, with the settings of every registered algorithm."""
    found = Experiment.model_json_schema()
    properties = found["properties"]
    properties[EXTENDS] = {
        "type": "string",
        "description": "A file whose values hold where this one has none.",
    }
    # A task may be the name of its scenario, and a file that extends another need not say everything.
    properties["tasks"]["items"] = {"anyOf": [{"type": "string"}, properties["tasks"]["items"]]}
    task = found["$defs"]["TrainingTask"]["properties"]
    for name in ("train", "validation", "test"):
        task[name]["items"] = {"anyOf": [{"type": "string"}, task[name]["items"]]}
    properties["algorithms"]["items"] = _names(ALGORITHMS)
    properties["scripted"]["items"] = _names(SCRIPTED_POLICIES)
    properties["metrics"]["anyOf"][0]["items"] = _names(METRICS)
    environment = found["$defs"]["Environment"]["properties"]
    environment["traffic_engine"]["anyOf"][0] = _names(TRAFFIC_ENGINES)
    environment["action"]["enum"] = [*ACTION_NAMES]
    _add_settings(found)
    found.pop("required", None)
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **found}


def _add_settings(found: dict[str, Any]) -> None:
    """Add the schema of `training` and `settings`."""
    classes = {name: entry.settings for name, entry in ALGORITHMS.items()}
    _, definitions = models_json_schema([(each, "validation") for each in set(classes.values())])
    found["$defs"] |= definitions["$defs"]
    sections = {name: {"$ref": f"#/$defs/{each.__name__}"} for name, each in classes.items()}
    found["properties"]["settings"] |= {
        "properties": {name: {"anyOf": [section, {"type": "null"}]} for name, section in sections.items()},
        "patternProperties": {OWN: {"type": ["object", "null"]}},
        "additionalProperties": False,
    }
    # Of settings that several algorithms have, the first one's meaning; own algorithms may have others.
    found["properties"]["training"]["properties"] = {
        name: {"$ref": f"{sections[algorithm]['$ref']}/properties/{name}"}
        for algorithm in reversed(classes)
        for name in classes[algorithm].model_fields
    }


def _names(known: Iterable[str]) -> dict[str, Any]:
    """Return the schema of a registered name, or of "module:Class"."""
    registered = sorted(name for name in known if not is_own_name(name))
    return {"anyOf": [{"enum": registered}, {"type": "string", "pattern": OWN}]}
