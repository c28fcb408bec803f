"""The examples run as scripts, print the output that the pages show, and are short."""

import ast
import doctest
import os
import subprocess
import sys

import pytest

from tests.blocks import ROOT, TOLERANT, blocks_of

EXAMPLES = sorted((ROOT / "examples").glob("*.py"))
SHOWN = {
    ROOT / block.title: block.expected
    for page in (ROOT / "docs").rglob("*.md")
    for block in blocks_of(page)
    if block.expected and block.is_example
}
"""The output of examples that the pages show."""
SHORT = ("single_agent", "own_observation")
"""The examples of `make test`; the others run in `make nightly`."""
LONGEST = 60
"""Maximum number of lines of an example."""


@pytest.mark.parametrize(
    "example",
    [pytest.param(each, marks=[pytest.mark.nightly] * (each.stem not in SHORT)) for each in EXAMPLES],
    ids=lambda path: path.stem,
)
def test_example(example):
    # Threads of torch that wait for each other on busy cores cost a factor of ten.
    one = {**os.environ, "OMP_NUM_THREADS": "1"}
    ended = subprocess.run([sys.executable, example], capture_output=True, text=True, check=False, env=one)
    assert ended.returncode == 0, ended.stderr[-3000:]
    assert ended.stdout.strip()
    shown = SHOWN.get(example, "...")
    assert doctest.OutputChecker().check_output(shown, ended.stdout, TOLERANT), ended.stdout


def test_examples_are_short_and_have_a_docstring():
    assert {*SHORT} < {example.stem for example in EXAMPLES}
    for example in EXAMPLES:
        text = example.read_text()
        assert len(text.splitlines()) < LONGEST, example
        assert ast.get_docstring(ast.parse(text)), example
