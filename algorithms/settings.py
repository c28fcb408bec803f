"""The settings of all algorithms as data, so that files can be checked and completed without loading torch.

`python -m algorithms.settings` writes `settings.json` from the configs; a test keeps the two equal.
"""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path
from typing import Any

from algorithms.registry import ALGORITHMS

FILE = Path(__file__).with_name("settings.json")
OF_RUNNERS = ("rollout_fragment_length",)
"""Keywords of `env_runners()` that change what is learned: steps of each copy from one update to the next."""


@cache
def settings() -> dict[str, dict[str, Any]]:
    """Return the default of every setting by algorithm and name."""
    return json.loads(FILE.read_text(encoding="utf-8"))


def collect() -> dict[str, dict[str, Any]]:
    """Return the settings of all algorithms, from their configs."""
    import algorithms  # here, since it loads torch and ray

    return {name: _of(algorithms.config(name)) for name in ALGORITHMS}


def apply(config: Any, chosen: dict[str, Any]) -> Any:
    """Give an algorithm's config the settings of a file, and return it."""
    own = {name: value for name, value in chosen.items() if name not in OF_RUNNERS}
    config.training(**own)
    return config.env_runners(**{name: chosen[name] for name in OF_RUNNERS if name in chosen})


def _of(config: Any) -> dict[str, Any]:
    names = (*config.setting_names, *OF_RUNNERS)
    return {name: _plain(getattr(config, name)) for name in sorted(names)}


def _plain(value: Any) -> Any:
    if isinstance(value, tuple | list):
        return [_plain(each) for each in value]
    return value if isinstance(value, bool | int | float | str | None) else None


def main() -> None:
    """Write the file."""
    FILE.write_text(json.dumps(collect(), indent=1, sort_keys=True) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
