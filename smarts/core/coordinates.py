"""Alias of `smarts.types.coordinates`."""

from smarts.types.coordinates import Dimensions, Heading, Point, Pose, RefLinePoint

__all__ = ["Dimensions", "Heading", "Point", "Pose", "RefLinePoint"]
