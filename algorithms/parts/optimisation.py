# pyright: reportPrivateImportUsage=false, reportCallIssue=false
"""Gradient clipping, Adam and polyak averaging of several networks in few calls."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import torch
from torch import Tensor, nn
from torch.optim import Adam
from torch.optim.adam import adam

EPSILON = 1e-6
"""What torch adds to a norm before it divides by it."""


def clip_gradients(networks: Sequence[Sequence[nn.Parameter]], limit: float | None, way: str) -> list[Tensor]:
    """Clip the gradients of networks, each on its own; return the norm of each before.

    Args:
        networks: Parameters of each network; those without gradient are left out.
        limit: Largest norm or component; None: any.
        way: "global_norm" of a network, "norm" of each of its arrays, or "value" of each component.
    """
    gradients = [[p.grad for p in own if p.grad is not None] for own in networks]
    flat = [gradient for own in gradients for gradient in own]
    if not flat:
        return [torch.zeros(()) for _ in networks]
    norms = torch._foreach_norm(flat)
    parts, start = [], 0
    for own in gradients:
        parts.append(norms[start : start + len(own)])
        start += len(own)
    none = norms[0].new_zeros(())
    total = [torch.linalg.vector_norm(torch.stack(part)) if part else none for part in parts]
    if limit is not None and way == "value":
        torch._foreach_clamp_min_(flat, -limit)
        torch._foreach_clamp_max_(flat, limit)
    elif limit is not None:
        scales = _scales(total if way == "global_norm" else norms, limit)
        if way == "global_norm":
            scales = [scale for scale, own in zip(scales, gradients, strict=True) for _ in own]
        torch._foreach_mul_(flat, scales)
    return total


def _scales(norms: Sequence[Tensor], limit: float) -> list[Tensor]:
    return list((limit / (torch.stack(list(norms)) + EPSILON)).clamp(max=1).unbind())


@torch.no_grad()
def follow(pairs: Sequence[tuple[Tensor, Tensor]], step: float) -> None:
    """Move the first array of each pair towards the second: own <- (1 - step) * own + step * followed."""
    if pairs:
        torch._foreach_lerp_([own for own, _ in pairs], [followed for _, followed in pairs], step)


@torch.no_grad()
def step_together(optimizers: Iterable[Adam]) -> None:
    """Take one step of each optimiser: fused Adams with equal settings except the learning rate.

    Optimisers of equal rate are stepped in one call, which gives each the step that its own call gives.
    """
    by_rate: dict[float, list[Adam]] = {}
    for optimizer in optimizers:
        (group,) = optimizer.param_groups
        if all(p in optimizer.state for p in group["params"] if p.grad is not None):
            by_rate.setdefault(group["lr"], []).append(optimizer)
        else:
            optimizer.step()  # which creates what the others remember
    for rate, group in by_rate.items():
        _step(rate, group)


def _step(rate: float, optimizers: Sequence[Adam]) -> None:
    (settings,) = optimizers[0].param_groups
    stepped = [(p, o.state[p]) for o in optimizers for p in o.param_groups[0]["params"] if p.grad is not None]
    if not stepped:
        return
    beta1, beta2 = settings["betas"]
    adam(
        [p for p, _ in stepped],
        [p.grad for p, _ in stepped],
        *([state[name] for _, state in stepped] for name in ("exp_avg", "exp_avg_sq")),
        [],
        [state["step"] for _, state in stepped],
        fused=True,
        amsgrad=False,
        beta1=beta1,
        beta2=beta2,
        lr=rate,
        weight_decay=settings["weight_decay"],
        eps=settings["eps"],
        maximize=False,
    )
