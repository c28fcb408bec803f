"""Remembering what was derived from a map for as long as the map lives."""

from __future__ import annotations

import weakref
from collections.abc import Callable
from functools import lru_cache, wraps
from typing import Concatenate, ParamSpec, TypeVar, cast

Map = TypeVar("Map")
Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")
MapFunction = Callable[Concatenate[Map, Arguments], Result]


def remembered(
    most: int,
) -> Callable[[MapFunction[Map, Arguments, Result]], MapFunction[Map, Arguments, Result]]:
    """Return a decorator for functions of a lane graph or an atlas that keeps `most` results of each.

    Unlike a plain `lru_cache`, it does not keep maps alive.
    """

    def decorate(function: MapFunction[Map, Arguments, Result]) -> MapFunction[Map, Arguments, Result]:
        memories: weakref.WeakKeyDictionary[Map, Callable] = weakref.WeakKeyDictionary()

        def memory_of(source: Map) -> Callable:
            reference = weakref.ref(source)

            @lru_cache(maxsize=most)
            def memory(*args, **kwargs):
                # The caller holds the map, so it exists.
                return function(cast(Map, reference()), *args, **kwargs)

            return memory

        @wraps(function)
        def with_memory(source: Map, /, *args: Arguments.args, **kwargs: Arguments.kwargs) -> Result:
            if source not in memories:
                memories[source] = memory_of(source)
            return memories[source](*args, **kwargs)

        return with_memory

    return decorate
