"""Alias of `smarts.types.colors`."""

from smarts.types.colors import Colors, SceneColors

__all__ = ["Colors", "SceneColors"]
