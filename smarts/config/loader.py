"""How the plain values of YAML texts are read."""

from __future__ import annotations

import re

import yaml


class Loader(yaml.SafeLoader):
    """Reads numbers as everybody writes them: YAML 1.1 wants 1.0e-3, takes 12:30 for 750 and 010 for 8."""


def _number(loader: yaml.SafeLoader, node: yaml.ScalarNode) -> int | float:
    number = float(node.value.replace("_", ""))
    return int(number) if number.is_integer() else number


_INT, _FLOAT, _POWER = (f"tag:yaml.org,2002:{name}" for name in ("int", "float", "float#exponent"))
_PATTERNS = {
    _INT: r"[-+]?(0|[1-9][\d_]*|0x[\da-fA-F_]+|0b[01_]+)$",
    _FLOAT: r"[-+]?(\d[\d_]*\.[\d_]*|\.\d[\d_]*|\.(inf|Inf|INF))$|\.(nan|NaN|NAN)$",
    _POWER: r"[-+]?(\d[\d_]*(\.\d*)?|\.\d+)[eE][-+]?\d{1,3}$",
}
Loader.yaml_implicit_resolvers = {
    first: [(tag, pattern) for tag, pattern in resolvers if tag not in _PATTERNS]
    for first, resolvers in yaml.SafeLoader.yaml_implicit_resolvers.items()
}
for _tag, _pattern in _PATTERNS.items():
    Loader.add_implicit_resolver(_tag, re.compile(_pattern), [*"-+.0123456789"])
Loader.add_constructor(_POWER, _number)
