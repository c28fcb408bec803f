"""The page on the language of scenarios: all types, and an example that works."""

import re
import shutil
from pathlib import Path

from docs.write_pages import TYPES
from smarts.sstudio import sstypes
from smarts.sstudio import types as t
from smarts.sstudio.build import build_scenario

ROOT = Path(__file__).parents[3]
PAGE = (ROOT / "docs" / "guide" / "scenario_language.md").read_text()
BASES = {"Actor", "Condition", "Zone", "TrafficModel", "SmartsLaneChangingModel", "SmartsJunctionModel"}
OTHER = {"StandardMetadata", "TrafficHistoryDataset"}
ENUMS = {"ConditionState", "ConditionOperator", "ConditionRequires", "ScenarioMetadataFields"}


def test_the_reference_has_all_types():
    names = {name for name, kind in vars(sstypes).items() if isinstance(kind, type)}
    described = " ".join(TYPES.values()).split()
    assert sorted(described) == sorted(names - BASES - OTHER - ENUMS)


def test_the_example_works(tmp_path):
    (example,) = re.findall(r"```python title=.*?\n(.*?)```", PAGE, re.DOTALL)
    (tmp_path / "scenario.py").write_text(example)
    for source in (ROOT / "scenarios" / "intersection").glob("map.*.xml"):
        shutil.copy(source, tmp_path)
    built = build_scenario(tmp_path)
    assert [*built.traffic] == ["busy"]
    assert t.StartVariation(offset=5, speed=(0, 8)) == built.scenario.start_variation
