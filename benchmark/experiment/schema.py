"""The JSON schema of experiment files, for editors: `python -m benchmark.experiment.schema` writes it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from algorithms.registry import ALGORITHMS
from benchmark.experiment.config import Experiment
from benchmark.floors import FLOORS
from smarts.config import EXTENDS

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
    properties["algorithms"]["items"] = {"enum": sorted(ALGORITHMS)}
    properties["reference"]["items"] = {"enum": sorted(FLOORS)}
    found.pop("required", None)
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **found}


def text() -> str:
    """Return the file's content."""
    return json.dumps(schema(), indent=1) + "\n"


if __name__ == "__main__":
    FILE.write_text(text(), encoding="utf-8")
