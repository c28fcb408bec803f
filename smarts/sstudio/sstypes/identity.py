"""Equality of scenario objects by content."""

from __future__ import annotations

from smarts.sstudio.encoding import canonical, digest


class Described:
    """A description that is identified by its content.

    Two descriptions are equal if their types and contents are equal, whatever kind of sequence holds their
    parts; fingerprints and hashes are the same in every process and on every machine.
    """

    def fingerprint(self, digits: int = 6) -> str:
        """Return the first hexadecimal digits of the content's digest."""
        return digest(self)[:digits]

    def __eq__(self, other: object) -> bool:
        if type(self) is not type(other):
            return NotImplemented
        return self is other or canonical(self) == canonical(other)

    def __hash__(self) -> int:
        return int(digest(self, size=7), 16)  # 56 bits, so that Python does not reduce it further
