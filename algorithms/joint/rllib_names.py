"""RLlib's settings that mean one of ours: policies and their mapping, widths of networks, other names."""

from __future__ import annotations

import difflib
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass, is_dataclass
from typing import Any, ClassVar

import numpy as np
from ray.rllib.core.rl_module.default_model_config import DefaultModelConfig
from ray.rllib.policy.policy import PolicySpec

from algorithms.errors import SpaceError, UnknownSettingError, nearest_names

DEFAULT_POLICIES = {"shared"}
"""Names of policies where the user gives none; they are never asked for."""
OTHER_NAMES = {"num_epochs": "epochs", "num_sgd_iter": "epochs", "train_batch_size_per_learner": "batch_size"}
"""Our names of RLlib's settings that mean the same."""
USUAL_NAMES = {
    "learning_rate": "lr",
    "vf_loss_coeff": "value_coeff",
    "clip_param": "clip",
    "lambda": "lambda_",
    "gae_lambda": "lambda_",
    "discount": "gamma",
    "ent_coef": "entropy_coeff",
    "buffer_size": "capacity",
}
"""Our names of settings by what they are called elsewhere."""
_NETWORK = {"fcnet_hiddens": "hidden"}
"""Our names of RLlib's settings of networks."""
_NO_ATTRIBUTES = {"multiagent", "class", "_enable_new_api_stack"}
"""What RLlib's dicts hold besides attributes."""


class OtherName:
    """An RLlib setting that is another name of one of ours, for algorithms that have ours.

    Args:
        own: Our name.
    """

    def __init__(self, own: str) -> None:
        self._own = own

    def __set_name__(self, owner: type, name: str) -> None:
        """Take note of RLlib's name."""
        self._name = name

    def __get__(self, config: Any, owner: type | None = None) -> Any:
        """Return the value."""
        if config is None:
            return self
        try:
            return vars(config)[self._place(config)]
        except KeyError:
            raise AttributeError(self._name) from None

    def __set__(self, config: Any, value: Any) -> None:
        """Set the value."""
        vars(config)[self._place(config)] = value

    def _place(self, config: Any) -> str:
        return self._own if self._own in config.setting_names else self._name


@dataclass(frozen=True)
class MappedPolicies:
    """`sharing` as RLlib's `policy_mapping_fn` says: a function from agent to group.

    Args:
        mapping: RLlib's function of agent and episode.
    """

    mapping: Callable[..., str]
    place: ClassVar[str] = "multi_agent(policy_mapping_fn=...)"
    """Where the mapping was given."""

    def __call__(self, agent: str) -> str:
        """Return the agent's policy.

        Raises:
            SpaceError: The mapping asks for the episode.
        """
        try:
            return self.mapping(agent, None)
        except (AttributeError, TypeError) as error:
            raise SpaceError(
                f"the mapping of agent {agent!r} without an episode fails: {error}",
                place=self.place,
                remedy="map agents by their names: a policy's agents are the same in all episodes",
            ) from error


def check_known(config: Any, names: Iterable[str], known: Collection[str], place: str) -> None:
    """Raise if there is no setting of a name.

    Args:
        config: The config whose settings they are.
        names: The names.
        known: All names that there are.
        place: Where they were given.

    Raises:
        UnknownSettingError: It offers the name of ours, or the nearest ones.
    """
    for name in sorted({*names} - {*known}):
        close = difflib.get_close_matches(name, known, n=1, cutoff=0.5)
        raise UnknownSettingError(
            f"{config.algorithm!r} has no setting {name!r}",
            place=place,
            remedy=f"use {USUAL_NAMES[name]!r}"
            if USUAL_NAMES.get(name) in known
            else nearest_names(name, known if close else config.setting_names),
        )


def check_attributes(config: Any, names: Iterable[str], place: str) -> None:
    """Raise if a dict of RLlib's that changes a config has a name that the config has not.

    Raises:
        UnknownSettingError: It has.
    """
    settable = {
        name
        for kind in type(config).__mro__
        for name, member in vars(kind).items()
        if hasattr(member, "__set__")
    }
    given = {config._translate_special_keys(name, warn_deprecated=False) for name in names}
    unknown = given - {*vars(config), *settable, *_NO_ATTRIBUTES}
    public = [name for name in {*vars(config), *settable} if not name.startswith("_")]
    # Ray's own notes, such as the number of a trial, have names with underscores around.
    check_known(config, {name for name in unknown if not name.startswith("__")}, public, place)


def unknown_attributes(config: Any, fresh: Any) -> set[str]:
    """Return the public attributes that were set on a config and that neither its class nor a new one has.

    Args:
        config: Of any algorithm.
        fresh: A new config of the same class.
    """
    known = {*vars(fresh), "class"}  # which `from_state` of RLlib leaves behind
    return {n for n in vars(config) if n[0] != "_" and n not in known and not hasattr(type(config), n)}


def same_value(one: Any, other: Any) -> bool:
    """Return whether two values of a setting are the same; lists and tuples of the same numbers are."""
    if isinstance(one, list | tuple) and isinstance(other, list | tuple):
        return [*one] == [*other]
    try:
        return bool(one == other)
    except (AttributeError, TypeError, ValueError):  # arrays, RLlib's `PolicySpec`
        return False


def is_seed(seed: Any) -> bool:
    """Return whether all that RLlib seeds takes a value: NumPy's global stream takes 32 bits."""
    return isinstance(seed, int | np.integer) and not isinstance(seed, bool) and 0 <= int(seed) < 2**32


def network_settings(model_config: Any) -> dict[str, Any]:
    """Return the settings of ours that a model config, a dict or RLlib's dataclass, asks for.

    Raises:
        UnknownSettingError: It asks for something that networks do not have.
    """
    given = asdict(model_config) if is_dataclass(model_config) else dict(model_config)  # type: ignore[arg-type]
    if isinstance(model_config, DefaultModelConfig):
        unset = asdict(DefaultModelConfig())
        given = {k: v for k, v in given.items() if k in _NETWORK or v != unset[k]}
    for name in given.keys() - {*_NETWORK, "hidden", "gru"}:
        raise UnknownSettingError(
            f"networks have no setting {name!r}",
            place="rl_module(model_config=...)",
            remedy="use 'fcnet_hiddens', 'hidden' or 'gru'; own networks: docs/algorithms_inside.md",
        )
    for other, name in _NETWORK.items():
        if given.keys() >= {other, name} and not same_value(given[other], given[name]):
            raise UnknownSettingError(
                f"{other}={given[other]!r} and {name}={given[name]!r}",
                place="rl_module(model_config=...)",
                remedy="give one of them",
            )
    return {_NETWORK.get(name, name): value for name, value in given.items()}


def policy_faults(config: Any) -> Iterator[str]:
    """Yield what is wrong with settings of policies, as far as it is known without the environment."""
    for name, spec in config.policies.items():
        if isinstance(spec, PolicySpec) and any(vars(spec).values()):
            yield f"policies[{name!r}] has settings of its own: use training(), for all policies"
    groups = config.sharing if isinstance(config.sharing, Mapping) else {}
    for name in _chosen(config):
        if name in groups or not (groups or config.sharing == "all"):
            continue
        if config.sharing == "all" and name.startswith("shared"):
            continue
        sharing = next((group for group, agents in groups.items() if name in agents), None)
        problem = f"an agent that shares the policy {sharing!r}" if sharing else "no policy"
        known = sorted(groups) or ["shared"]
        yield (
            f"policies_to_train holds {name!r}, {problem}: sharing={config.sharing!r} makes {known}, "
            "and a policy learns or is frozen as a whole"
        )


def check_names(config: Any, groups: set[str], modules: set[str]) -> None:
    """Raise if RLlib's settings name policies or networks that do not exist.

    Args:
        config: The config.
        groups: Names of the policies.
        modules: Names of all networks.

    Raises:
        SpaceError: They do.
    """
    named = set(config.policies) if set(config.policies) != DEFAULT_POLICIES else groups
    overridden = set(config.algorithm_config_overrides_per_module)
    for place, names, known in (
        ("multi_agent(policies=...)", named, groups),
        ("multi_agent(policies=...)", groups, named),
        ("multi_agent(policies_to_train=...)", set(_chosen(config)), groups),
        ("rl_module(algorithm_config_overrides_per_module=...)", overridden, modules),
    ):
        if unknown := sorted(names - known):
            raise SpaceError(
                f"{unknown} is none of {sorted(known)}",
                place=place,
                remedy="name the policies that `training(sharing=...)` or the mapping makes",
            )
    if not any(map(config.trains, groups)):
        raise SpaceError(
            f"{config.policies_to_train!r} has none of the policies {sorted(groups)} learn",
            place="multi_agent(policies_to_train=...)",
            remedy="choose by the names of policies: one that agents share learns or is frozen as a whole",
        )


def _chosen(config: Any) -> tuple[str, ...]:
    """Return the names in `policies_to_train`."""
    chosen: Any = config.policies_to_train
    return () if chosen is None or callable(chosen) else tuple(chosen)
