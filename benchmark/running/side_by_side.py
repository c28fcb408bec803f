"""Calls of a function side by side on this machine, in processes that end with this one."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from typing import Any, TypeVar

from benchmark.results.files import ResultsError, first_line
from benchmark.running.machine import usable_cores

T = TypeVar("T")


def side_by_side(
    function: Callable[..., T], calls: Sequence[tuple[Any, ...]], parallel: int | None = None
) -> Iterator[tuple[int, T]]:
    """Call a function with each tuple of arguments.

    Args:
        function: A function of a module, or a method of what can be pickled.
        calls: Arguments of each call.
        parallel: Calls at a time; one: in this process. None: one for each core.

    Yields:
        The number of a call and what it has returned, as soon as it has.

    Raises:
        ResultsError: The process of a call was lost, or one of Ray's own.
        Exception: What a call raises. The others under way are ended.
    """
    most = min(parallel or max(1, int(usable_cores())), len(calls))
    if most < 2:
        for number, call in enumerate(calls):
            yield number, function(*call)
        return
    # Imported here: one call at a time needs no Ray.
    import ray
    from ray.exceptions import RayError, RayTaskError

    from benchmark.experiment.models import Resources
    from benchmark.running.cluster import check_ray, start_ray

    is_callers = ray.is_initialized()
    start_ray(Resources())
    waiting, under_way = deque(enumerate(calls)), {}
    try:
        task = ray.remote(num_cpus=1, max_retries=0)(_call)
        while waiting or under_way:
            check_ray()
            while waiting and len(under_way) < most:
                number, call = waiting.popleft()
                under_way[task.remote(function, *call)] = number
            for ended in ray.wait([*under_way], num_returns=1, timeout=1.0)[0]:
                yield under_way.pop(ended), ray.get(ended)
    except RayTaskError as error:
        raise error.cause or error from None
    except RayError as error:
        raise ResultsError(
            f"a process is lost, killed by a user or for want of memory: {first_line(error)}",
            remedy="give the same command again, with --parallel 1 if memory is short",
        ) from error
    finally:
        if is_callers:
            for each in under_way:
                ray.cancel(each, force=True)
        else:
            ray.shutdown()


def _call(function: Callable[..., T], *arguments: Any) -> T:
    return function(*arguments)
