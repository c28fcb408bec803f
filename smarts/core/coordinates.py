"""Alias of `smarts.types.coordinates`."""

from smarts.types.coordinates import BoundingBox, Dimensions, Heading, Point, Pose, RefLinePoint

__all__ = ["BoundingBox", "Dimensions", "Heading", "Point", "Pose", "RefLinePoint"]
