"""Errors tested by type, place and value, never by their wording."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest


@contextmanager
def raises(kind: type[Exception], place: str | Path = "", *, values: Sequence[Any] = ()) -> Iterator[Any]:
    """Expect an error.

    Args:
        kind: Its type.
        place: What its place ends in.
        values: Values that it names in problem, place or remedy.
    """
    with pytest.raises(kind) as caught:
        yield caught
    error = caught.value
    assert getattr(error, "place", "").endswith(str(place))
    assert [value for value in values if str(value) not in str(error)] == []
