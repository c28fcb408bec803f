"""Planned routes by number, so that a vehicle's row can name the way that it is going to take."""

from __future__ import annotations

from collections.abc import Iterator, Sequence


class RouteBook:
    """The routes that vehicles of one simulation have planned; numbers hold for the episode."""

    def __init__(self) -> None:
        self._numbers: dict[tuple[str, ...], int] = {}
        self._routes: list[tuple[str, ...]] = []

    def number(self, edges: Sequence[str]) -> int:
        """Return the number of a route, a new one if nobody has planned it so far.

        Args:
            edges: Ids of road edges, the vehicle's own first; an empty route has number -1.
        """
        route = tuple(edges)
        if not route:
            return -1
        if route not in self._numbers:
            self._numbers[route] = len(self._routes)
            self._routes.append(route)
        return self._numbers[route]

    def __getitem__(self, number: int) -> tuple[str, ...]:
        return self._routes[number]

    def __len__(self) -> int:
        return len(self._routes)

    def __iter__(self) -> Iterator[tuple[str, ...]]:
        return iter(self._routes)

    def reset(self) -> None:
        """Forget all routes."""
        self._numbers.clear()
        self._routes.clear()
