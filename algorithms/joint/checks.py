"""Checks that observations can be concatenated for a centralised critic, and that actions have bounds."""

from __future__ import annotations

from gymnasium.spaces import Box

from algorithms.errors import SpaceError
from algorithms.joint.spaces import is_bounded
from algorithms.joint.spec import JointSpec


def check_vectors(spec: JointSpec, algorithm: str) -> None:
    """Raise if an observation is an image, where an algorithm joins all observations.

    Raises:
        SpaceError: An observation leaf is an image.
    """
    for block in spec.spaces.blocks:
        for name, space in block.observation.items():
            if len(space.shape) == 3:
                raise SpaceError(
                    f"{algorithm!r} joins all observations; {repr(name) if name else 'one'} is an image",
                    place="observation space",
                    remedy="use 'ppo', or give a state to 'centralised_v', or drop the image",
                )


def check_bounds(spec: JointSpec, algorithm: str) -> None:
    """Raise if actions have no bounds, where an algorithm acts in [-1, 1].

    Raises:
        SpaceError: An action space has an infinite bound.
    """
    for block in spec.spaces.blocks:
        if isinstance(block.action, Box) and not is_bounded(block.action):
            raise SpaceError(
                f"{algorithm!r} acts between bounds; {block.action} of {', '.join(block.agents)} has none",
                place="action space",
                remedy="give finite low and high, or use 'ppo'",
            )
