"""Oriented boxes: the footprints of vehicles."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]


def boxes_overlap(
    centre: ArrayLike,
    heading: ArrayLike,
    size: ArrayLike,
    centre2: ArrayLike,
    heading2: ArrayLike,
    size2: ArrayLike,
) -> NDArray[np.bool_]:
    """Return whether two oriented boxes share area, by the separating-axis theorem; touching ones do not.

    Args:
        centre: [m], shape (..., 2); the two boxes' shapes broadcast.
        heading: Direction of the length [rad], shape (...).
        size: Length and width [m], shape (..., 2).
        centre2: Of the other box.
        heading2: Of the other box.
        size2: Of the other box.
    """
    axes, axes2 = _axes(heading), _axes(heading2)
    half, half2 = np.asarray(size, float) / 2, np.asarray(size2, float) / 2
    apart = np.asarray(centre2, float) - np.asarray(centre, float)
    # cosines[..., i, j] between axis i of the first box and axis j of the second.
    cosines = np.abs(np.einsum("...ik,...jk->...ij", axes, axes2))
    reach = half + np.einsum("...ij,...j->...i", cosines, half2)
    reach2 = half2 + np.einsum("...ij,...i->...j", cosines, half)
    gap = np.abs(np.einsum("...ik,...k->...i", axes, apart)) - reach
    gap2 = np.abs(np.einsum("...jk,...k->...j", axes2, apart)) - reach2
    return (gap < 0).all(axis=-1) & (gap2 < 0).all(axis=-1)


def _axes(heading: ArrayLike) -> Floats:
    """Return the directions of length and width, shape (..., 2, 2)."""
    cosine, sine = np.cos(heading), np.sin(heading)
    return np.stack([np.stack([cosine, sine], -1), np.stack([-sine, cosine], -1)], -2)
