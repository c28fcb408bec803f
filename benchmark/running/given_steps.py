"""Steps of a user's own loop as arrays, from which a policy acts as from an environment's."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray

from algorithms.joint.env import AgentBlock, JointSpaces
from algorithms.joint.spec import action_size
from smarts.env.vector import VectorStep
from smarts.errors import ActionError
from smarts.observations.action_mask import MASK


class GivenSteps:
    """A vector environment whose next step is set from outside: algorithms wrap it like any other."""

    def __init__(self, num_envs: int, spaces: JointSpaces) -> None:
        self.num_envs, self.spaces = num_envs, spaces
        self.now: Any = None
        self.worlds: NDArray | None = None
        """Index of each one's episode, shape (B,); None: not known."""

    @property
    def alive(self) -> NDArray[np.bool_]:
        """Agents that were active in the last step, shape (B, N)."""
        agents = sum(len(block.agents) for block in self.spaces.blocks)
        return np.zeros((self.num_envs, agents), bool) if self.now is None else self.now.alive

    def reset(self, seed: int, worlds: Any, *, stride: int = 0) -> Any:
        """Return the step that was set."""
        return self.now

    def step(self, actions: Any) -> Any:
        """Return the step that was set."""
        return self.now

    def recreate(self, failures: Mapping[int, BaseException]) -> NoReturn:
        """Raise, since an observation is not finite."""
        raise ActionError("an observation is not finite", place="Policy.act") from next(
            iter(failures.values())
        )

    def close(self) -> None:
        """Do nothing."""


def check_step(now: VectorStep, blocks: Sequence[AgentBlock]) -> None:
    """Raise unless a step has what the policy was trained on.

    Raises:
        ActionError: It has other agents, other observations, or no action masks.
    """
    masks = now.masks or (None,) * len(blocks)
    given = [{**leaves, MASK: mask} for leaves, mask in zip(now.observations, masks, strict=False)]
    found = [{name: np.shape(array) for name, array in each.items()} for each in given]
    wanted = [_shapes_of(block, len(now.alive)) for block in blocks]
    fits = (each.items() <= there.items() for each, there in zip(wanted, found, strict=False))
    if len(found) != len(wanted) or not all(fits):
        raise ActionError(
            f"the environment gives arrays of shapes {found}, and the policy was trained with {wanted}",
            place="Policy.act",
            remedy="use the number of agents, the observation and the action mask of the training",
        )


def _shapes_of(block: AgentBlock, count: int) -> dict[str, tuple[int, ...]]:
    """Return the shapes of a block's observations, and of its action mask, in some simulations."""
    before = count, len(block.agents)
    shapes = {leaf: (*before, *box.shape) for leaf, box in block.observation.items()}
    return shapes | ({MASK: (*before, action_size(block.action))} if block.masked else {})


def among(agents: NDArray[np.bool_], now: VectorStep) -> VectorStep:
    """Return a step with these agents alone; policies do not read observations of absent agents."""
    ended = {name: getattr(now, name) & agents for name in ("terminated", "truncated", "alive")}
    return now._replace(**ended)


def mask_in(name: str, *given: Any) -> NDArray[np.bool_]:
    """Return an agent's action mask from the first mapping that has one.

    Raises:
        ActionError: No mapping has a mask, although the policy was trained with one.
    """
    for each in given:
        if isinstance(each, Mapping) and MASK in each:
            return np.asarray(each[MASK], bool)
    raise ActionError(
        f"there is no {MASK!r} for {name!r}, with which the policy was trained",
        place="Policy.act",
        remedy="hand over the infos too, or use an environment with action_mask=True",
    )


def fill(name: str, seen: Any, rows: Mapping[str, NDArray]) -> None:
    """Copy an agent's observation into its rows.

    Raises:
        ActionError: It lacks an array, or has one of another shape.
    """
    for leaf, row in rows.items():
        part: Any = seen
        full = leaf or "observation"
        try:
            if isinstance(seen, Mapping):
                for key in [full] if full in seen else full.split("/"):
                    part = part[key]
            array = np.asarray(part)
        except (KeyError, IndexError, TypeError, ValueError) as error:
            raise ActionError(
                f"the observation of {name!r} has no array {full!r}",
                place="Policy.act",
                remedy="use the observation of the training",
            ) from error
        if array.shape != row.shape:
            raise ActionError(
                f"{full!r} of {name!r} has the shape {array.shape}, not {row.shape}",
                place="Policy.act",
                remedy="use the number of agents and the observation of the training",
            )
        row[...] = array
