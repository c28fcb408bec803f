"""Tests errors by type, place and value, not by wording."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest


@contextmanager
def raises(kind: type[Exception], place: str | Path = "", *, values: Sequence[Any] = ()) -> Iterator[Any]:
    """Expect an error.

    Args:
        kind: Type of the error.
        place: End of the error's place.
        values: Values that the error names in problem, place or remedy.

    Raises:
        ValueError: Neither a place nor a value is asked for.
    """
    if not (str(place) or any(map(str, values))):
        raise ValueError("ask for the error's place, or for values that it names")
    with pytest.raises(kind) as caught:
        yield caught
    error = caught.value
    assert getattr(error, "place", "").endswith(str(place))
    assert [value for value in values if str(value) not in str(error)] == []
