"""Options that have no effect beside others."""

from __future__ import annotations

from collections.abc import Mapping

from smarts.errors import SmartsError


def check_effect(place: str, options: Mapping[str, object], remedy: str = "leave it out") -> None:
    """Raise if options are given that have no effect.

    Args:
        place: What they have no effect on.
        options: Option -> its value, None, False or empty if it is not given.
        remedy: What to do about it.

    Raises:
        SmartsError: One is given; names all of them.
    """
    given = [name for name, value in options.items() if value not in (None, [], ()) and value is not False]
    if given:
        verb = "have" if len(given) > 1 else "has"
        raise SmartsError(f"{', '.join(given)} {verb} no effect on {place}", remedy=remedy)
