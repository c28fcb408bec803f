"""What a file of a compact episode says of it, for lists."""

from __future__ import annotations

from itertools import takewhile
from pathlib import Path
from typing import Any

from smarts.errors import RecordError
from smarts.stream.arrays import damaged
from smarts.stream.container import VERSION, messages_in
from smarts.stream.tables import columns_of
from smarts.types.episode_schema import AGENTS


def read_static(path: Path) -> tuple[dict[str, Any], dict[str, list[Any]]]:
    """Return the row of the table `episode` of a compact episode, and its table `agents`, by columns.

    Raises:
        RecordError: The file is no compact episode, or of another version of the format.
    """
    try:
        messages = messages_in(path.read_bytes())
        first = next(messages, {"type": ""})
        facts = first.get("facts")
        if first["type"] != "episode" or not isinstance(facts, dict):
            raise damaged("it does not begin with the message 'episode'")
        if first.get("version") != VERSION:
            raise damaged(f"its format is {first.get('version')!r}, not {VERSION}")
        agents: dict[str, list[Any]] = {}
        for message in takewhile(lambda message: message["type"] != "steps", messages):
            if message["type"] == "table" and message.get("name") == AGENTS.name:
                for name, values in columns_of(message).items():
                    agents.setdefault(name, []).extend(values)
    except RecordError as error:
        raise RecordError(error.problem, place=str(path), remedy=error.remedy) from error
    return facts, agents
