"""Equality of scenario objects by content."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import cached_property
from typing import Any

from smarts.sstudio.encoding import canonical, text_digest


class Described:
    """A description that is identified by its content.

    Two descriptions are equal if their types and contents are equal, whatever kind of sequence holds their
    parts; fingerprints and hashes are the same in every process and on every machine.
    """

    @cached_property
    def _content(self) -> str:
        """The content as text; kept, since drivers are keys of every flow."""
        return canonical(self)

    @cached_property
    def _hash(self) -> int:
        # 56 bits, so that Python does not reduce it further.
        return int(text_digest(self._content, size=7), 16)

    def fingerprint(self, digits: int = 6) -> str:
        """Return the first hexadecimal digits of the content's digest."""
        return text_digest(self._content)[:digits]

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Described) or type(self) is not type(other):
            return NotImplemented
        return self is other or self._content == other._content

    def __hash__(self) -> int:
        return self._hash


class DescribedMapping(Described, Mapping[str, Any]):
    """A description that is a mapping."""

    def __init__(self, items: Mapping[str, Any]) -> None:
        self._items = items

    def __getitem__(self, key: str) -> Any:
        return self._items[key]

    def __iter__(self) -> Iterator[str]:
        return iter(self._items)

    def __len__(self) -> int:
        return len(self._items)

    # Mapping brings its own equality, by items and without regard to the type.
    __eq__ = Described.__eq__
    __hash__ = Described.__hash__
