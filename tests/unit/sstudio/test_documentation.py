"""The page on the language of scenarios: all types, and an example that works."""

import re
import shutil
from pathlib import Path

from smarts.sstudio import sstypes
from smarts.sstudio import types as t
from smarts.sstudio.build import build_scenario

ROOT = Path(__file__).parents[3]
PAGE = (ROOT / "docs" / "guide" / "scenario_language.md").read_text()
BASES = {"Actor", "Condition", "Zone", "TrafficModel", "SmartsLaneChangingModel", "SmartsJunctionModel"}
OTHER = {"StandardMetadata"}
ENUMS = {"ConditionState", "ConditionOperator", "ConditionRequires", "ScenarioMetadataFields"}


def test_the_page_has_all_types():
    names = {name for name, kind in vars(sstypes).items() if isinstance(kind, type)}
    described = re.findall(r"^::: smarts\.sstudio\.types\.(\w+)$", PAGE, re.MULTILINE)
    without_effect = re.findall(
        r"`(\w+)`", PAGE.partition("## Without effect so far")[2].partition("\n## ")[0]
    )
    assert sorted(described + without_effect) == sorted(names - BASES - OTHER - ENUMS)


def test_the_example_works(tmp_path):
    (example,) = re.findall(r"```python title=.*?\n(.*?)```", PAGE, re.DOTALL)
    (tmp_path / "scenario.py").write_text(example)
    for source in (ROOT / "scenarios" / "intersection").glob("map.*.xml"):
        shutil.copy(source, tmp_path)
    built = build_scenario(tmp_path)
    assert [*built.traffic] == ["busy"]
    assert t.StartVariation(offset=5, speed=(0, 8)) == built.scenario.start_variation
