"""Reads TensorBoard's files."""

import struct

from tensorboardX.proto.event_pb2 import Event


def read_scalars(folder):
    """Return the values of TensorBoard's files in a folder, by name and step."""
    found = {}
    for file in folder.iterdir():
        records, at = file.read_bytes(), 0
        while at < len(records):
            (length,) = struct.unpack_from("<Q", records, at)  # then a checksum, and one after the data
            event = Event.FromString(records[at + 12 : at + 12 + length])
            at += 16 + length
            for value in event.summary.value:
                found.setdefault(value.tag, {})[event.step] = value.simple_value
    return found
