"""YAML files to typed models: every mistake at once, each with its file, line and remedy."""

from smarts.config.problems import ConfigError, Problem, UnfitError, shown
from smarts.config.reading import Fault, Section, fitted, read_config
from smarts.config.sources import EXTENDS

__all__ = [
    "EXTENDS",
    "ConfigError",
    "Fault",
    "Problem",
    "Section",
    "UnfitError",
    "fitted",
    "read_config",
    "shown",
]
