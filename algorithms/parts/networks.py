"""Networks: multilayer perceptrons, observation encoders, and n equal perceptrons evaluated as one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
import torch
from gymnasium.spaces import Box
from torch import Tensor, nn

from algorithms.parts.sets import SetEncoder


def perceptron(sizes: Sequence[int], activation: type[nn.Module] = nn.Tanh) -> nn.Sequential:
    """Return linear layers of the given widths with the activation between them, none after the last."""
    layers: list[nn.Module] = []
    for before, after in pairwise(sizes):
        layers += [nn.Linear(before, after), activation()]
    return nn.Sequential(*layers[:-1])


def orthogonal(network: nn.Sequential, *, gain: float, last: float) -> nn.Sequential:
    """Initialise weights orthogonally with `gain`, the last layer's with `last`, biases with zero."""
    linear = [layer for layer in network if isinstance(layer, nn.Linear)]
    for layer in linear:
        nn.init.orthogonal_(layer.weight, last if layer is linear[-1] else gain)
        nn.init.zeros_(layer.bias)
    return network


class Encoder(nn.Module):
    """Observation leaves to one vector per agent, shape (..., n, `size`).

    Vectors are concatenated; each image leaf, (H, W, C) or (C, H, W), goes through two convolutions; each
    leaf (K, F) is flattened, or encoded as a set of K rows in any order. Agents that share the network are
    told apart by a one-hot place, unless `identity` is false: symmetric greedy policies may deadlock then.

    Args:
        observation: Space of each leaf; others that are handed over are ignored.
        agents: Number n of agents that the network tells apart (`Group.places`).
        set_width: Units of the networks for leaves (K, F), see `SetEncoder`; 0: such leaves are flattened.
    """

    def __init__(self, observation: Mapping[str, Box], agents: int = 1, set_width: int = 0) -> None:
        super().__init__()
        self._images = {name: space for name, space in observation.items() if len(space.shape) == 3}
        self._depth = {name: len(space.shape) for name, space in observation.items()}
        self.convolutions = nn.ModuleDict(
            {f"image_{k}": _convolution(s) for k, s in enumerate(self._images.values())}
        )
        self._sets = {name: s for name, s in observation.items() if len(s.shape) == 2 and set_width}
        self.sets = nn.ModuleDict(
            {
                f"set_{k}": SetEncoder(s.shape[0], s.shape[1], set_width)
                for k, s in enumerate(self._sets.values())
            }
        )
        encoded = {*self._images, *self._sets}
        vectors = sum(int(np.prod(s.shape)) for name, s in observation.items() if name not in encoded)
        self._identity = agents if agents > 1 else 0
        self.size = vectors + 64 * len(self._images) + 2 * set_width * len(self._sets) + self._identity
        self.is_plain = not encoded and not self._identity
        """Whether the encoder only concatenates, so that it has no weights."""
        self.places = self._identity if not encoded else 0
        """Number of agents, where all the encoder adds to vectors is their one-hot place."""

    @property
    def set_networks(self) -> dict[str, SetEncoder]:
        """Return the network of each leaf that is a set."""
        return dict(zip(self._sets, self.sets.values(), strict=True))  # type: ignore[reportReturnType]

    def forward(self, leaves: Mapping[str, Tensor]) -> Tensor:
        """Return features (..., n, size) of leaves (..., n, *shape)."""
        seen = self.see(leaves)
        if not self._identity:
            return seen
        place = torch.eye(self._identity, device=seen.device)
        return torch.cat([seen, place.expand(*seen.shape[:-1], self._identity)], -1)

    def of_rows(self, leaves: Mapping[str, Tensor], rows: Tensor) -> Tensor:
        """Return features (R, size) of agents of leaves (M, n, *shape); agent i of moment m is m * n + i."""
        seen = self.see({name: leaves[name].flatten(0, 1).index_select(0, rows) for name in self._depth})
        if not self._identity:
            return seen
        place = nn.functional.one_hot(rows % self._identity, self._identity)
        return torch.cat([seen, place.to(seen.dtype)], -1)

    def see(self, leaves: Mapping[str, Tensor]) -> Tensor:
        """Return the features without the agents' places."""
        parts = []
        for name, depth in self._depth.items():
            leaf = leaves[name]
            if name in self._images:
                number = list(self._images).index(name)
                parts.append(self._see(self.convolutions[f"image_{number}"], self._images[name], leaf))
                continue
            if name in self._sets:
                number = list(self._sets).index(name)
                parts.append(self.sets[f"set_{number}"](leaf.float()))
                continue
            leaf = leaf.flatten(-depth) if depth > 1 else leaf.unsqueeze(-1) if depth == 0 else leaf
            parts.append(leaf if leaf.dtype == torch.float32 else leaf.float())
        return parts[0] if len(parts) == 1 else torch.cat(parts, -1)

    @staticmethod
    def _see(convolution: nn.Module, space: Box, leaf: Tensor) -> Tensor:
        leading = leaf.shape[:-3]
        image = leaf.reshape(-1, *leaf.shape[-3:]).float()
        if space.dtype == np.uint8:
            image = image / 255
        if _channels_last(space):
            image = image.permute(0, 3, 1, 2)
        return convolution(image).reshape(*leading, -1)


def _channels_last(space: Box) -> bool:
    return space.shape[-1] <= space.shape[0]


def _convolution(space: Box) -> nn.Sequential:
    channels, height, width = space.shape
    if _channels_last(space):
        height, width, channels = space.shape
    # Small images get smaller steps, so that something is left after two layers.
    stride = 2 if min(height, width) >= 24 else 1
    layers = [
        nn.Conv2d(channels, 16, 4, stride),
        nn.ReLU(),
        nn.Conv2d(16, 32, 3, stride),
        nn.ReLU(),
        nn.Flatten(),
    ]
    with torch.no_grad():
        width_out = nn.Sequential(*layers)(torch.zeros(1, channels, height, width)).shape[-1]
    return nn.Sequential(*layers, nn.Linear(width_out, 64), nn.ReLU())


def outputs_where(chosen: Tensor, encoder: Encoder, body: nn.Module, leaves: Mapping[str, Tensor]) -> Tensor:
    """Return body(encoder(leaves)) (M, n, P) of chosen agents (M, n), and zeros for others, uncomputed."""
    rows = chosen.flatten().nonzero().squeeze(-1)
    if len(rows) == chosen.numel():
        return body(encoder(leaves))
    outputs = body(encoder.of_rows(leaves, rows))
    spread = outputs.new_zeros(chosen.numel(), outputs.shape[-1]).index_copy(0, rows, outputs)
    return spread.unflatten(0, chosen.shape)


class PlacedPerceptron:
    """A perceptron behind an encoder that only adds places, for acting: each place is a bias of its agent.

    Args:
        encoder: Encoder with `places`.
        network: Linear layers and activations; the first reads the encoder's features.
    """

    def __init__(self, encoder: Encoder, network: nn.Sequential) -> None:
        self._see = encoder.see
        first: Any = network[0]
        self._weight = first.weight[:, : -encoder.places].T.contiguous()
        self._bias = first.bias + first.weight[:, -encoder.places :].T
        self._rest = list(network)[1:]

    def __call__(self, leaves: Mapping[str, Tensor]) -> Tensor:
        """Return outputs (B, n, P) of leaves (B, n, *shape)."""
        x = torch.matmul(self._see(leaves), self._weight).add_(self._bias)
        for layer in self._rest:
            x = layer(x)
        return x


class StackedPerceptrons:
    """n perceptrons of equal shape as one chain of batched products.

    A step of four separate networks costs three times as much as this. Gradients reach the networks' own
    parameters, unless it is built under `torch.no_grad`; changes of these need a new stack.
    """

    def __init__(self, networks: Sequence[nn.Sequential]) -> None:
        self._layers: list[tuple[Tensor, Tensor] | nn.Module] = []
        for column in zip(*networks, strict=True):
            if isinstance(column[0], nn.Linear):
                weight = torch.stack([layer.weight for layer in column]).transpose(1, 2)
                self._layers.append((weight, torch.stack([layer.bias for layer in column])[:, None]))
            else:
                self._layers.append(column[0])

    def __call__(self, features: Tensor) -> Tensor:
        """Return outputs (M, n, P) of features (M, n, d), network i applied to agent i."""
        x = features.transpose(0, 1)
        for layer in self._layers:
            x = torch.baddbmm(layer[1], x, layer[0]) if isinstance(layer, tuple) else layer(x)
        return x.transpose(0, 1)

    @staticmethod
    def fits(networks: Sequence[nn.Module]) -> bool:
        """Return whether the networks are plain perceptrons of one shape."""
        if not all(isinstance(network, nn.Sequential) for network in networks):
            return False
        shapes = {
            tuple((type(layer), *(p.shape for p in layer.parameters())) for layer in network.children())
            for network in networks
        }
        weightless = all(
            isinstance(layer, nn.Linear) or not list(layer.parameters())
            for n in networks
            for layer in n.children()
        )
        return len(shapes) == 1 and weightless
