"""Checks of what callers give: kernels read and write memory by it, and check nothing themselves."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NoReturn

import numpy as np
from numpy.typing import ArrayLike, NDArray

from smarts.arrays import Floats, Ints
from smarts.geometry.compiling import kernel
from smarts.roads.arrays import RouteTable

NOT_GIVEN: Ints = np.empty(0, np.int32)
"""Stands for lanes or routes that a question has not."""

INT, FLOAT = np.dtype(np.int32), np.dtype(np.float64)


def ints(name: str, values: ArrayLike, *shape: int) -> Ints:
    """Return numbers as the kernels take them; `ValueError` if they are not of the shape."""
    return _plain(name, values, INT, shape)


def floats(name: str, values: ArrayLike, *shape: int) -> Floats:
    """Return numbers as the kernels take them; `ValueError` if they are not of the shape."""
    return _plain(name, values, FLOAT, shape)


def _plain(name: str, values: ArrayLike, dtype: np.dtype, shape: tuple[int, ...]) -> NDArray:
    """Return contiguous, writable numbers: to numba any other kind of array is another kernel to compile."""
    array = np.ascontiguousarray(values, dtype)
    if array.shape != shape:
        raise ValueError(f"{name} has shape {array.shape}, but {shape} is needed: as many rows as maps")
    return array if array.flags.writeable else array.copy()


def require_buffers(
    names: Sequence[str],
    buffers: Sequence[NDArray],
    dtypes: Sequence[np.dtype],
    shapes: Sequence[tuple[int, ...]],
) -> None:
    """Raise `ValueError` if results of these types and shapes cannot be written into the buffers of `out`."""
    if [buffer.shape for buffer in buffers] == shapes and [buffer.dtype for buffer in buffers] == dtypes:
        return
    for name, buffer, dtype, shape in zip(names, buffers, dtypes, shapes, strict=True):
        if buffer.shape != shape or buffer.dtype != dtype:
            raise ValueError(
                f"out.{name} is {buffer.dtype} of shape {buffer.shape}, not {dtype} of shape {shape}"
            )


def require_numbers(maps: Ints, lane: Ints, routes: Ints, lane_base: Ints, table: RouteTable) -> None:
    """Raise `ValueError` if a map, lane or route has no such number.

    Args:
        maps: Shape (E,).
        lane: Within the maps or -1, shape (E,), or `NOT_GIVEN`.
        routes: Numbers in the table or -1, shape (E,), or `NOT_GIVEN`.
        lane_base: First lane of each map, shape (M + 1,).
        table: The routes.
    """
    wrong = _first_wrong(maps, lane, routes, lane_base, len(table.start) - 1 - table.free)
    if wrong >= 0:
        _refuse(wrong // 3, wrong % 3, maps, lane, routes, lane_base, table)


def _refuse(
    row: int, kind: int, maps: Ints, lane: Ints, routes: Ints, lane_base: Ints, table: RouteTable
) -> NoReturn:
    if kind == 0:
        raise ValueError(f"maps[{row}] is {maps[row]}, but maps go from 0 to {len(lane_base) - 2}")
    if kind == 1:
        last = lane_base[maps[row] + 1] - lane_base[maps[row]] - 1
        raise ValueError(
            f"lane[{row}] is {lane[row]}, but lanes of map {maps[row]} go from 0 to {last}, and -1 is none"
        )
    last = len(table.start) - 2 - table.free
    known = f"go from 0 to {last}" if last >= 0 else "are none in this table"
    raise ValueError(f"routes[{row}] is {routes[row]}, but routes {known}, and -1 is none")


@kernel
def _first_wrong(maps: Ints, lane: Ints, routes: Ints, lane_base: Ints, route_count: int) -> int:
    """Return three times the first row with a wrong number, plus 0 for its map, 1 lane, 2 route; else -1."""
    for i in range(len(maps)):
        world = maps[i]
        if world < 0 or world >= len(lane_base) - 1:
            return 3 * i
        if len(lane) and (lane[i] < -1 or lane[i] >= lane_base[world + 1] - lane_base[world]):
            return 3 * i + 1
        if len(routes) and (routes[i] < -1 or routes[i] >= route_count):
            return 3 * i + 2
    return -1
