"""Named tuples of arrays: their dtypes are those of the fields' annotations, so that each is written once."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any, TypeVar, get_args, get_type_hints

import numpy as np

Table = TypeVar("Table", bound=tuple)


def allocate(
    table: type[Table],
    shape: tuple[int, ...],
    unset: Collection[str] = (),
    more: Mapping[str, tuple[int, ...]] | None = None,
) -> Table:
    """Return arrays for the fields of a named tuple.

    Args:
        table: The named tuple; its fields are annotated with the types of `smarts.arrays`.
        shape: The leading axes of every array.
        unset: Names of the arrays that are -1 where there is nothing, not 0.
        more: Further axes of some arrays, by name.
    """
    arrays = {}
    for name, hint in get_type_hints(table).items():
        (dtype,) = get_args(get_args(hint)[1])
        arrays[name] = np.zeros((*shape, *(more or {}).get(name, ())), dtype)
        if name in unset:
            arrays[name][...] = -1
    return table(**arrays)


def clear(table: Any, index: Any, unset: Collection[str] = ()) -> None:
    """Empty the entries at an index of the arrays of a named tuple; see `allocate`."""
    for name, column in table._asdict().items():
        column[index] = -1 if name in unset else 0
