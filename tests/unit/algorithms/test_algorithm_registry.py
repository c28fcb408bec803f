import re
from pathlib import Path

import algorithms
from algorithms.registry import ActionKind

PAGE = Path("docs/guide/algorithms.md")


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
