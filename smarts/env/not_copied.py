"""Environments live in the process that made them."""

from __future__ import annotations

from typing import NoReturn

from smarts.errors import SmartsError


class NotCopied:
    """Refuses to be pickled and copied, which would begin with megabytes and end at a part without state."""

    def __reduce__(self) -> NoReturn:
        raise SmartsError(
            "an environment can be neither pickled nor copied: the state of SUMO and Bullet is not Python's",
            place=type(self).__name__,
            remedy="hand over what makes it, such as functools.partial(HiWayEnv, ...), and make it there: "
            "with the same seed it plays the same episodes",
        )
