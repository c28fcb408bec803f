"""The settings of all algorithms as data, so that files can be checked and completed without loading torch.

`python -m algorithms.settings` writes the files from the configs; a test keeps them equal.
"""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path
from typing import Any, cast

from algorithms.joint import ranges
from algorithms.joint.ranges import Values
from algorithms.registry import ALGORITHMS

FILE = Path(__file__).with_name("settings.json")
VALUES = Path(__file__).with_name("setting_values.json")
"""The values that settings may take: by algorithm and name, a class of `algorithms.joint.ranges` and
its fields."""
OF_RUNNERS = ("rollout_fragment_length",)
"""Keywords of `env_runners()` that change what is learned: steps of each copy from one update to the next."""


@cache
def settings() -> dict[str, dict[str, Any]]:
    """Return the default of every setting by algorithm and name."""
    return json.loads(FILE.read_text(encoding="utf-8"))


@cache
def values() -> dict[str, dict[str, Values]]:
    """Return the values that settings may take by algorithm and name, without those that have no limits."""
    published = json.loads(VALUES.read_text(encoding="utf-8"))
    return {
        algorithm: {name: getattr(ranges, kind)(*fields) for name, (kind, *fields) in each.items()}
        for algorithm, each in published.items()
    }


def collect_values() -> dict[str, dict[str, list[Any]]]:
    """Return the values that all algorithms' settings may take, from their configs, as they are published."""
    import algorithms  # here, since it loads torch and ray

    configs = {name: algorithms.config(name) for name in ALGORITHMS}
    return {
        algorithm: {
            name: [type(each).__name__, *cast(tuple, each)]
            for name, each in sorted(ranges.declared(type(config)).items())
            if each is not None and name in config.setting_names
        }
        for algorithm, config in configs.items()
    }


def collect() -> dict[str, dict[str, Any]]:
    """Return the settings of all algorithms, from their configs."""
    import algorithms  # here, since it loads torch and ray

    return {name: defaults_of_config(algorithms.config(name)) for name in ALGORITHMS}


def apply(config: Any, chosen: dict[str, Any]) -> Any:
    """Give an algorithm's config the settings of a file, and return it."""
    own = {name: value for name, value in chosen.items() if name not in OF_RUNNERS}
    config.training(**own)
    return config.env_runners(**{name: chosen[name] for name in OF_RUNNERS if name in chosen})


def defaults_of_config(config: Any) -> dict[str, Any]:
    """Return the value of each setting of a fresh config as plain data."""
    names = (*config.setting_names, *OF_RUNNERS)
    return {name: _plain(getattr(config, name)) for name in sorted(names)}


def _plain(value: Any) -> Any:
    if isinstance(value, tuple | list):
        return [_plain(each) for each in value]
    return value if isinstance(value, bool | int | float | str | None) else None


def main() -> None:
    """Write the files."""
    for file, content in ((FILE, collect()), (VALUES, collect_values())):
        file.write_text(json.dumps(content, indent=1, sort_keys=True) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
