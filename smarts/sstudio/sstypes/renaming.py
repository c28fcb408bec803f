"""Former names of fields, which older scenario files still use."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import TypeVar

Description = TypeVar("Description")


def formerly(**renamed: str) -> Callable[[type[Description]], type[Description]]:
    """Let a class be made and read under its fields' former names as well, given as `old="new"`."""

    def accept(described: type[Description]) -> type[Description]:
        initialise = described.__init__

        @functools.wraps(initialise)
        def renaming(self: Description, *args: object, **kwargs: object) -> None:
            for old, new in renamed.items():
                if old in kwargs:
                    kwargs[new] = kwargs.pop(old)
            initialise(self, *args, **kwargs)

        described.__init__ = renaming
        for old, new in renamed.items():
            setattr(described, old, property(lambda self, new=new: getattr(self, new)))
        return described

    return accept
