"""The page on the language of scenarios: all types, these docstrings, and an example that works."""

import re
import shutil
from pathlib import Path

from smarts.sstudio import types as t
from smarts.sstudio.build import build_scenario
from smarts.sstudio.documentation import NOT_IN_USE, PAGE, SUBJECTS, language_page
from smarts.sstudio.sstypes import __all__ as names

BASES = {"Actor", "Condition", "Zone", "TrafficModel", "SmartsLaneChangingModel", "SmartsJunctionModel"}
OTHER = {"MAX", "MISSING", "AnyMission", "SocialMissions", "MapBuilder", "StandardMetadata"}
ENUMS = {"ConditionState", "ConditionOperator", "ConditionRequires", "ScenarioMetadataFields"}


def test_the_page_is_of_these_docstrings():
    assert PAGE.read_text() == language_page(), "run: python -m smarts.sstudio.documentation"


def test_the_page_tells_all_types():
    told = {kind.__name__ for kinds in (*SUBJECTS.values(), NOT_IN_USE) for kind in kinds}
    assert told == set(names) - BASES - OTHER - ENUMS


def test_the_example_works(tmp_path):
    (example,) = re.findall(r"```python title=.*?\n(.*?)```", PAGE.read_text(), re.DOTALL)
    (tmp_path / "scenario.py").write_text(example)
    for source in (Path(__file__).parents[3] / "scenarios" / "intersection").glob("map.*.xml"):
        shutil.copy(source, tmp_path)
    built = build_scenario(tmp_path)
    assert [*built.traffic] == ["busy"]
    assert t.StartVariation(offset=5, speed=(0, 8)) == built.scenario.start_variation
