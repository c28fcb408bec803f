"""Frames, polylines, rotated boxes: arrays in, arrays out."""
