"""The folder of `smarts-bench evaluate --out`: one evaluation, which nothing else is lost for."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from benchmark.results.files import (
    FORMAT,
    PARTIAL,
    ResultsError,
    locked,
    named_failures,
    read_json,
    write_json,
)
from benchmark.results.run_folder import RunFolder

MARK = "evaluation.json"
"""File of what was evaluated."""


@contextmanager
def evaluation_folder(out: Path | None, evaluated: Mapping[str, Any]) -> Iterator[RunFolder]:
    """Yield the folder in which a test writes its table and episodes.

    They are moved into `out`, which is locked, when all is written: an earlier evaluation of the same stays
    until then.

    Args:
        out: A folder that is new, empty, or of an evaluation of the same; None for none that is kept.
        evaluated: What is evaluated and in what, as plain values.

    Raises:
        ResultsError: The folder holds something else, or another process writes to it.
    """
    if out is None:
        with tempfile.TemporaryDirectory(prefix="smarts-bench-") as temporary:
            yield RunFolder(Path(temporary))
        return
    content = {"format": FORMAT, **evaluated}
    check_free(out)
    with locked(out):
        _check_same(out, content)
        old, new = RunFolder(out), RunFolder(out / f"{PARTIAL}-evaluation")
        shutil.rmtree(new.path, ignore_errors=True)
        try:
            yield new
            write_json(out / MARK, content)
            with named_failures(out):
                if old.episodes.exists():
                    old.episodes.rename(new.path / "earlier")
                if new.episodes.exists():
                    new.episodes.rename(old.episodes)
                new.table.replace(old.table)
        finally:
            shutil.rmtree(new.path, ignore_errors=True)


def check_free(out: Path | None) -> None:
    """Raise if a folder holds something else than an evaluation.

    Raises:
        ResultsError: It does, or is a file.
    """
    if out is None or not out.exists() or (out / MARK).exists():
        return
    there = [out.name] if out.is_file() else sorted(each.name for each in out.glob("[!.]*"))
    if there:
        raise ResultsError(
            f"holds '{there[0]}', which is of no evaluation", place=str(out), remedy="choose another --out"
        )


def _check_same(out: Path, content: Mapping[str, Any]) -> None:
    """Raise if a folder holds the evaluation of something else."""
    before = read_json(out / MARK) if (out / MARK).exists() else content
    if before != content:
        differing = sorted(name for name in {*before, *content} if before.get(name) != content.get(name))
        named = ", ".join(f"{name} {before.get(name)!r}" for name in differing)
        raise ResultsError(
            f"holds another evaluation: of {named}", place=str(out), remedy="choose another --out"
        )
