"""Kernels that put features together: joined into a vector, and stacked over decisions, oldest first."""

from __future__ import annotations

from numpy.typing import NDArray

from smarts.arrays import Bools, Longs, Singles
from smarts.geometry.compiling import kernel


@kernel
def write_vector(
    numbers: Singles,
    first: Longs,
    stacked: int,
    frames: int,
    is_new: Bools,
    vectors: Singles,
    observe_mask: Bools,
) -> None:
    """Append stacked features to the frames of agents' vectors, and write the other features behind them.

    Args:
        numbers: Of K features one after the other, each of shape (B, G, its size), flat.
        first: For each feature, how many numbers the features before it have; last the sum, shape (K + 1,).
        stacked: How many features, the first ones, are stacked.
        frames: How many decisions a vector holds; the oldest drops out.
        is_new: Agents that hold no frames yet: all become this one, shape (B, G).
        vectors: Written: frames, then the features that are not stacked, shape (B, G, numbers).
        observe_mask: The agents, shape (B, G).
    """
    agents, size = observe_mask.shape[1], first[stacked]
    rows, older = observe_mask.size, (frames - 1) * size
    for b in range(observe_mask.shape[0]):
        for g in range(agents):
            if not observe_mask[b, g]:
                continue
            vector = vectors[b, g]
            for i in range(older):
                vector[i] = vector[i + size]
            for k in range(len(first) - 1):
                count = first[k + 1] - first[k]
                begin = first[k] * rows + (b * agents + g) * count
                for i in range(count):
                    vector[older + first[k] + i] = numbers[begin + i]
            if is_new[b, g]:
                for i in range(older - 1, -1, -1):
                    vector[i] = vector[i + size]


@kernel
def write_stack(now: NDArray, is_new: Bools, stack: NDArray, observe_mask: Bools) -> None:
    """Append agents' arrays to their stacks, along the last axis.

    Args:
        now: Shape (B, G, P, C).
        is_new: Agents that hold none yet: all become this one, shape (B, G).
        stack: Written, the oldest first, shape (B, G, P, frames * C).
        observe_mask: The agents, shape (B, G).
    """
    channels = now.shape[3]
    older = stack.shape[3] - channels
    for b in range(observe_mask.shape[0]):
        for g in range(observe_mask.shape[1]):
            if not observe_mask[b, g]:
                continue
            for p in range(now.shape[2]):
                pixel = stack[b, g, p]
                for i in range(older):
                    pixel[i] = now[b, g, p, i % channels] if is_new[b, g] else pixel[i + channels]
                for c in range(channels):
                    pixel[older + c] = now[b, g, p, c]
