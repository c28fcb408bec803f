"""Controllers: actions of one type -> commands to vehicles, for all seats that act so in one call."""

from smarts.registry import Registry

CONTROLLERS = Registry("controller", {})
"""`ActionSpaceType` name -> "module:Class" of a `smarts.controllers.protocol.Controller`."""
