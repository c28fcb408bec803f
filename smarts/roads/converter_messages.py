"""Messages of netconvert and netgenerate, sorted into remarks and losses."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass

SHOWN = 3
"""Messages of one kind that are shown in full."""
NAMED = 20
"""Dropped parts that are named."""

_VARYING = re.compile(r"'[^']*'|-?\d+(?:\.\d+)?")
_LOSSES = ("While setting connections: ",)
"""Beginnings of warnings that report a dropped link."""


@dataclass(frozen=True)
class ConverterMessages:
    """The messages of one run, in their order, repeated ones included."""

    errors: tuple[str, ...]
    """Causes of failure or, with `ignore-errors`, dropped parts."""
    warnings: tuple[str, ...]

    @classmethod
    def parse(cls, stderr: str) -> ConverterMessages:
        """Return the messages in the standard error stream of a tool."""
        lines = [" ".join(line.split()) for line in stderr.splitlines()]
        lines = [line for line in lines if not re.match(r"$|Quitting|.*SUMO_HOME", line)]
        # A message may continue on further lines.
        messages = re.split(r"\n(?=Warning: |Error: )", "\n".join(lines)) if lines else []
        errors, warnings = [], []
        for message in messages:
            kind, text = re.fullmatch(r"(Warning: )?(?:Error: )?(.*)", message.replace("\n", " ")).groups()  # type: ignore[union-attr]
            (warnings if kind else errors).append(text)
        return cls(tuple(errors), tuple(warnings))

    def left_out(self) -> tuple[str, ...]:
        """Return one warning that counts and names what a tool that ignores errors left out, or nothing."""
        lost = [*self.errors, *(text for text in self.warnings if text.startswith(_LOSSES))]
        if not lost:
            return ()
        return (f"left out {len(lost)} part{'s' * (len(lost) > 1)} of the map: {listed(lost)}",)

    def remarks(self) -> tuple[str, ...]:
        """Return the other warnings, each once, and of each kind only the first few in full."""
        texts = dict.fromkeys(text for text in self.warnings if not text.startswith(_LOSSES))
        kinds = Counter(_VARYING.sub("%", text) for text in texts)
        seen = Counter[str]()
        shown = []
        for text in texts:
            kind = _VARYING.sub("%", text)
            seen[kind] += 1
            if seen[kind] <= SHOWN:
                shown.append(text)
        shown += [f"{count} messages of the kind: {kind}" for kind, count in kinds.items() if count > SHOWN]
        return tuple(shown)


def listed(parts: Iterable[str]) -> str:
    """Return distinct parts with their counts, the first `NAMED` of them in full."""
    counts = Counter(parts)
    names = [f"{part} ({count} times)" if count > 1 else part for part, count in counts.items()]
    more = f"; and {len(names) - NAMED} more" if len(names) > NAMED else ""
    return "; ".join(names[:NAMED]) + more
