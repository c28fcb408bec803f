"""Remembering what was derived from a map for as long as the map lives."""

from __future__ import annotations

import weakref
from collections.abc import Callable
from functools import lru_cache, wraps
from typing import Concatenate, ParamSpec, TypeVar, cast

from smarts.roads.lane_graph import LaneGraph

Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")
GraphFunction = Callable[Concatenate[LaneGraph, Arguments], Result]


def remembered(
    most: int,
) -> Callable[[GraphFunction[Arguments, Result]], GraphFunction[Arguments, Result]]:
    """Return a decorator for functions of a lane graph that keeps, for each graph, the `most` latest results.

    Unlike a plain `lru_cache`, it does not keep graphs alive.
    """

    def decorate(function: GraphFunction[Arguments, Result]) -> GraphFunction[Arguments, Result]:
        memories: weakref.WeakKeyDictionary[LaneGraph, Callable] = weakref.WeakKeyDictionary()

        def memory_of(graph: LaneGraph) -> Callable:
            reference = weakref.ref(graph)

            @lru_cache(maxsize=most)
            def memory(*args, **kwargs):
                # The caller holds the graph, so it exists.
                return function(cast(LaneGraph, reference()), *args, **kwargs)

            return memory

        @wraps(function)
        def with_memory(graph: LaneGraph, /, *args: Arguments.args, **kwargs: Arguments.kwargs) -> Result:
            if graph not in memories:
                memories[graph] = memory_of(graph)
            return memories[graph](*args, **kwargs)

        return with_memory

    return decorate
