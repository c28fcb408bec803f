import subprocess
import sys

import pytest

import algorithms
from algorithms.errors import UnknownAlgorithmError
from algorithms.registry import Actions


def test_listing_names_imports_neither_torch_nor_ray():
    code = (
        "import sys, algorithms; algorithms.names(); print(*{'torch', 'ray', 'gymnasium'} & set(sys.modules))"
    )
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert result.stdout.strip() == ""


def test_an_unknown_name_is_answered_with_the_nearest():
    with pytest.raises(UnknownAlgorithmError, match="did you mean 'ppo'"):
        algorithms.config("popo")


@pytest.mark.parametrize("name", algorithms.names())
def test_every_entry_leads_to_a_config_that_knows_its_name(name):
    config = algorithms.config(name)
    assert config.algorithm == name
    assert config.algo_class.get_default_config().algorithm == name
    assert config.entry is algorithms.entry(name)


def test_tags_can_be_queried():
    fitting = [name for name in algorithms.names() if algorithms.entry(name).acts_in(Actions.CONTINUOUS)]
    assert "ppo" in fitting
    assert "dqn" not in fitting
