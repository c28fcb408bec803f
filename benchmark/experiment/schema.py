"""The JSON schema of experiment files, for editors: `python -m benchmark.experiment.schema` writes it."""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from algorithms.registry import ALGORITHMS
from benchmark.experiment.config import Experiment
from benchmark.metrics import METRICS
from benchmark.scripted import SCRIPTED_POLICIES
from smarts.config import EXTENDS
from smarts.registry import is_own_name
from smarts.types.traffic import TRAFFIC_ENGINES

OWN = r"^[\w.]+:[\w.]+$"
"""Names of own code, "module:Class"."""
FILE = Path(__file__).parents[2] / "configs" / "schema.json"


def schema() -> dict[str, Any]:
    """Return the schema."""
    found = Experiment.model_json_schema()
    properties = found["properties"]
    properties[EXTENDS] = {
        "type": "string",
        "description": "A file whose values hold where this one has none.",
    }
    # A task may be the name of its scenario, and a file that extends another need not say everything.
    properties["tasks"]["items"] = {"anyOf": [{"type": "string"}, properties["tasks"]["items"]]}
    properties["algorithms"]["items"] = _names(ALGORITHMS)
    properties["scripted"]["items"] = _names(SCRIPTED_POLICIES)
    properties["metrics"]["anyOf"][0]["items"] = _names(METRICS)
    found["$defs"]["Environment"]["properties"]["traffic_engine"]["anyOf"][0]["enum"] = sorted(
        TRAFFIC_ENGINES
    )
    sections = found["$defs"]["SettingsByAlgorithm"]
    sections["patternProperties"] = {OWN: sections.pop("additionalProperties")}
    sections["additionalProperties"] = False
    found.pop("required", None)
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **found}


def _names(known: Iterable[str]) -> dict[str, Any]:
    """Return the schema of a registered name, or of "module:Class"."""
    registered = sorted(name for name in known if not is_own_name(name))
    return {"anyOf": [{"enum": registered}, {"type": "string", "pattern": OWN}]}


def text() -> str:
    """Return the file's content."""
    return json.dumps(schema(), indent=1) + "\n"


if __name__ == "__main__":
    FILE.write_text(text(), encoding="utf-8")
