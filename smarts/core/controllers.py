"""Alias of `smarts.types.actions`."""

from smarts.types.actions import ActionSpaceType

__all__ = ["ActionSpaceType"]
