import re
import subprocess
import sys
from pathlib import Path

import pytest

import algorithms
from algorithms.errors import UnknownAlgorithmError
from algorithms.registry import ActionKind

PAGE = Path("docs/guide/algorithms.md")


def test_listing_names_imports_neither_torch_nor_ray():
    code = (
        "import sys, algorithms; algorithms.names(); print(*{'torch', 'ray', 'gymnasium'} & set(sys.modules))"
    )
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert result.stdout.strip() == ""


def test_an_unknown_name_is_answered_with_the_nearest():
    with pytest.raises(UnknownAlgorithmError, match="'ppo'"):
        algorithms.config("popo")


def test_every_entry_leads_to_a_config_that_knows_its_name():
    for name in algorithms.names():
        config = algorithms.config(name)
        assert config.algorithm == config.algo_class.get_default_config().algorithm == name
        assert config.entry is algorithms.entry(name)


def test_tags_can_be_queried():
    fitting = [name for name in algorithms.names() if algorithms.entry(name).acts_in(ActionKind.CONTINUOUS)]
    assert "ppo" in fitting
    assert "dqn" not in fitting


def test_the_page_describes_each_algorithm():
    for name in algorithms.names():
        (block,) = re.findall(rf"^### `{name}`\n(.*?)(?=^##|\Z)", PAGE.read_text(), re.MULTILINE | re.DOTALL)
        told = re.findall(r"^- \*\*(\w+)\*\*: ", block, re.MULTILINE)
        assert told == ["Paper", "Equations", "Deviations", "Notes"], name
