"""Reads compact episodes, apart from the page that shows them."""

import struct

import numpy as np

from smarts.stream.arrays import unpacked_array, unpacked_runs
from smarts.stream.container import MAGIC, unpack
from smarts.stream.motion import Motion

VEHICLES = ("number", "slot", "generation", "name", "kind", "length", "width")


def messages_in(data):
    """Yield the messages of a compact episode."""
    assert data[: len(MAGIC)] == MAGIC
    at = len(MAGIC)
    while at < len(data):
        (length,) = struct.unpack_from("<I", data, at)
        yield unpack(data[at + 4 : at + 4 + length])
        at += 4 + length


def columns_of(message):
    """Return the columns of a message `table`: arrays, and lists of texts or of arrays."""
    return {name: values_of(message["columns"], name) for name in message["columns"]}


def values_of(columns, name):
    """Return one of the columns of a message."""
    column = columns[name]
    if isinstance(column, list):
        return column
    values = unpacked_array(column)
    if "o" not in column:
        return values
    offsets = unpacked_array(column["o"]).astype(np.int64)
    return np.split(values, offsets[1:-1]) if len(offsets) > 1 else []


def motion_of(message):
    """Return the rows of a message `steps`; headings have no jumps within a run."""
    steps, number = unpacked_array(message["step"]), unpacked_array(message["number"])
    begin, count = np.zeros(len(number), np.int64), np.ones(len(number), np.int64)
    if "count" in message:
        begin, count = (unpacked_array(message[name]).astype(np.int64) for name in ("begin", "count"))
    starts = np.cumsum(count) - count
    columns = [unpacked_runs(message[name], starts) for name in ("x", "y", "heading", "speed", "steer")]
    place = np.arange(count.sum()) - np.repeat(starts - begin, count)
    flags = unpacked_array(message["flags"]).astype(np.uint16)
    return Motion(np.repeat(number, count).astype(np.int32), steps[place], *columns, flags)


class CompactEpisode:
    """The content of a compact episode."""

    def __init__(self, data):
        first, *messages = messages_in(data)
        self.facts, self.origin = first["facts"], np.array(first["origin"])
        of_kind = {
            kind: [each for each in messages if each["type"] == kind] for kind in ("vehicles", "steps")
        }
        self.map = next((each for each in messages if each["type"] == "map"), None)
        self.tables = {}
        for each in messages:
            if each["type"] == "table":
                known = self.tables.setdefault(each["name"], {}) if each.get("append") else {}
                columns = columns_of(each)
                self.tables[each["name"]] = {
                    n: joined([known[n]] if n in known else [], v) for n, v in columns.items()
                }
        found = {name: [values_of(each, name) for each in of_kind["vehicles"]] for name in VEHICLES}
        self.vehicles = {name: joined(parts[:-1], parts[-1]) for name, parts in found.items() if parts}
        motions = [motion_of(each) for each in of_kind["steps"]]
        empty = Motion._make([np.zeros(0, np.int32)] * len(Motion._fields))
        self.motion = Motion._make(np.concatenate(each) for each in zip(*(motions or [empty]), strict=True))
        self.is_whole = any(each["type"] == "end" for each in messages)


def joined(before, more):
    """Return a column of several parts."""
    if isinstance(more, list):
        return [value for part in (*before, more) for value in part]
    return np.concatenate([*before, more])
