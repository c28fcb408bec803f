"""Columns of a table of arrays, gathered for a kernel."""

from __future__ import annotations

from typing import Any, TypeVar

Columns = TypeVar("Columns", bound=tuple)


def columns_of(table: Any, kind: type[Columns]) -> Columns:
    """Return the columns of a table that a named tuple has fields for.

    Tables are written in place and never replaced, so what is gathered once holds for good; and a kernel
    that takes a tuple has a signature that can be read.
    """
    make: Any = kind
    return make(*(getattr(table, name) for name in make._fields))
