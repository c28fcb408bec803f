"""A library of multi-agent reinforcement learning algorithms on RLlib.

```python
import algorithms

config = algorithms.config("ppo").training(lr=5e-4)  # an RLlib AlgorithmConfig
```

`config.environment(...).build_algo().train()` trains, as with RLlib's own algorithms.

Every algorithm is a first-class RLlib algorithm and runs on any RLlib `MultiAgentEnv` whose agents step
simultaneously, or on a vector environment with the interface of `algorithms.joint.env`. Importing this
package and listing names imports neither torch nor Ray.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

from algorithms.errors import UnknownAlgorithmError
from algorithms.registry import ALGORITHMS, Entry

if TYPE_CHECKING:
    from algorithms.joint.config import JointConfig

__all__ = ["config", "entry", "names"]


def names() -> tuple[str, ...]:
    """Return the names of all algorithms, in the order of the registry."""
    return tuple(ALGORITHMS)


def entry(name: str) -> Entry:
    """Return the registry line of an algorithm: its class and its tags.

    Raises:
        UnknownAlgorithmError: No algorithm has this name; the message offers the nearest ones.
    """
    try:
        return ALGORITHMS[name]
    except KeyError:
        raise UnknownAlgorithmError.of(name, ALGORITHMS) from None


def config(name: str) -> JointConfig:
    """Return a fresh RLlib `AlgorithmConfig` of an algorithm with its defaults.

    Raises:
        UnknownAlgorithmError: No algorithm has this name; the message offers the nearest ones.
    """
    module, _, attribute = entry(name).target.partition(":")
    return getattr(import_module(module), attribute)()
