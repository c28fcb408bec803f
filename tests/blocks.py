"""Finds the code blocks of pages and docstrings with markdown-it, and runs them in the order of the page.

| block | treatment |
|---|---|
| `python`, `console` | run in the page's folder and namespace |
| `python`, `yaml`, `xml` with `title="file"` | written to that file |
| `yaml` without a title | read as an experiment file |
| `diff` with `title="file"` | its context lines are in that file of the repository |
| `text` with `title="Output"` | compared with the output of the block before it; `...` matches anything |
| `python` with `title="examples/..."` | that example, written to the folder; `test_examples.py` runs it |

An HTML comment before a block changes when it runs: `<!-- nightly: why -->` defers it to `make nightly`,
`<!-- not run: why -->` excludes it.
"""

import ast
import contextlib
import doctest
import io
import itertools
import os
import re
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from time import process_time

from markdown_it import MarkdownIt

ROOT = Path(__file__).parents[1]
LANGUAGES = {"python", "yaml", "xml", "diff", "console", "text"}
NOTE = re.compile(r"<!-- (nightly|not run): (.+?) -->\s*$")
TITLE = re.compile(r'title="(.+?)"')
TOLERANT = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE


@dataclass
class Block:
    """A code block: its page and line, the language and title of its fence, the comment before it."""

    page: Path
    line: int
    language: str
    title: str
    text: str
    note: str = ""
    expected: str | None = None

    @property
    def place(self) -> str:
        """Return "page:line"."""
        return f"{self.page.relative_to(ROOT)}:{self.line}"

    @property
    def is_code(self) -> bool:
        """Return whether the block is code, not output or a drawing."""
        return self.language in LANGUAGES - {"text"}

    @property
    def is_example(self) -> bool:
        """Return whether the block is a file of `examples/`."""
        return self.title.startswith("examples/")


def blocks_of(page: Path) -> list[Block]:
    """Return the blocks of a page, or of the docstrings of a module, in order."""
    if page.suffix == ".py":
        return [block for text, line in _docstrings(page) for block in _blocks(page, text, line)]
    return _blocks(page, page.read_text(), 0)


def _docstrings(module: Path):
    for node in ast.walk(ast.parse(module.read_text())):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef):
            text = ast.get_docstring(node)
            if text and "```" in text:
                yield text, node.body[0].lineno - 1


def _blocks(page: Path, text: str, offset: int) -> list[Block]:
    found: list[Block] = []
    note = ""
    for token in MarkdownIt("commonmark").parse(text):
        if token.type == "html_block":
            match = NOTE.search(token.content)
            note = f"{match[1]}: {match[2]}" if match else ""
        elif token.type in ("fence", "code_block"):  # indented blocks have no language
            language, _, rest = token.info.partition(" ")
            title = TITLE.search(rest)
            block = Block(
                page, offset + token.map[0] + 1, language, title[1] if title else "", token.content, note
            )
            if block.title == "Output" and language == "text":
                found[-1].expected = block.text
            found.append(block)
            note = ""
        elif token.block and token.type not in ("paragraph_close",):
            note = ""
    return found


class Page:
    """A page whose blocks run in order in one folder and one namespace."""

    def __init__(self, page: Path, folder: Path) -> None:
        self._blocks = blocks_of(page)
        self._folder = folder
        self._names: dict = {"__name__": "__page__"}

    def run(self, nightly: bool = False):
        """Run all blocks, with `nightly` also the deferred ones; yield each with its output and CPU time [s].

        Raises:
            AssertionError: A block fails, or its output differs from the page.
        """
        for block in self._blocks:
            if not block.is_code or block.note.startswith("not run"):
                continue
            if block.note.startswith("nightly") and not nightly:
                continue
            began = process_time() + _of_children()
            output = self._run(block)
            yield block, output, process_time() + _of_children() - began
            if block.expected is not None and not block.is_example:
                same = doctest.OutputChecker().check_output(block.expected, output, TOLERANT)
                assert same, f"{block.place} prints\n{output}\nand the page says\n{block.expected}"

    def _run(self, block: Block) -> str:
        if block.language == "diff":
            lines = (ROOT / block.title).read_text().splitlines()
            for is_kept, group in itertools.groupby(block.text.splitlines(), lambda line: line[0] == " "):
                around = [line[1:] for line in group]
                starts = range(len(lines) - len(around) + 1)
                found = any(lines[i : i + len(around)] == around for i in starts)
                assert found or not is_kept, f"{block.place}: {around}"
            return ""
        if block.title:
            file = self._folder / (Path(block.title).name if block.is_example else block.title)
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_text(block.text)
            return ""
        return {"python": self._python, "console": self._console, "yaml": self._yaml}[block.language](block)

    def _python(self, block: Block) -> str:
        padded = "\n" * block.line + block.text  # so that tracebacks name the page's lines
        with contextlib.redirect_stdout(io.StringIO()) as printed:
            exec(compile(padded, str(block.page), "exec"), self._names)
        return printed.getvalue()

    def _console(self, block: Block) -> str:
        commands = "\n".join(line.removeprefix("$ ") for line in block.text.splitlines())
        path = f"{Path(sys.executable).parent}:{os.environ['PATH']}"
        ended = subprocess.run(
            ["bash", "-euo", "pipefail", "-c", commands],
            cwd=self._folder,
            env={**os.environ, "PATH": path, "COLUMNS": "100"},
            capture_output=True,
            text=True,
            check=False,
        )
        assert ended.returncode == 0, f"{block.place}: {ended.stdout[-1500:]}{ended.stderr[-1500:]}"
        return ended.stdout

    def _yaml(self, block: Block) -> str:
        from benchmark.experiment.config import read_experiment

        file = self._folder / f"line_{block.line}.yaml"
        file.write_text(block.text)
        read_experiment(file)
        return ""


def _of_children() -> float:
    times = os.times()
    return times.children_user + times.children_system
