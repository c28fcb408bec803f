"""Checks of RLlib's settings of learners: own classes, how many, what each needs."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import torch


def learner_faults(config: Any) -> Iterator[str]:
    """Yield what is wrong with a config's settings of learners."""
    yield from _class_faults(config)
    yield from _number_faults(config)


def _class_faults(config: Any) -> Iterator[str]:
    """Yield what the class of the learner does not read or cannot do."""
    if config.grad_clip is None and config.grad_clip_by != "global_norm":
        yield f"grad_clip_by={config.grad_clip_by!r} clips nothing: set grad_clip"
    own, default = config._learner_class, config.get_default_learner_class()
    if own is not None and not issubclass(own, default):
        yield f"learner_class={own.__name__} is no {default.__name__}: subclass it"
    if config.learner_config_dict and own is None:
        yield "learner_config_dict is read by own learners only: give learner_class, too"
    for module_id, changes in config.algorithm_config_overrides_per_module.items():
        for name in changes.keys() - {"lr"}:
            yield (
                f"algorithm_config_overrides_per_module of {module_id!r} holds {name!r}: networks have "
                "learning rates of their own only, 'lr'"
            )


def _number_faults(config: Any) -> Iterator[str]:
    """Yield what is wrong with how many learners there are, and with what each needs."""
    for name in ("num_learners", "num_env_runners", "num_cpus_per_learner", "num_gpus_per_learner"):
        value = getattr(config, name)
        whole = name in ("num_learners", "num_env_runners")
        if value == "auto" and name == "num_cpus_per_learner":
            continue
        if isinstance(value, bool) or not isinstance(value, int if whole else int | float) or value < 0:
            yield f"{name}={value!r} is not {'a whole number' if whole else 'a number'} from 0 on"
            return
    name = "batch_size" if "batch_size" in config.setting_names else "minibatch_size"
    size = getattr(config, name, None)
    shares = None if size is None else max(size // (config.sequence_length if config.gru else 1), 1)
    if shares is not None and config.num_learners > shares:
        yield (
            f"num_learners={config.num_learners} is more than the {shares} rows or sequences that they "
            f"share: raise {name}={size}, or use fewer learners"
        )
    if config.num_learners > 1 and 0 < config.num_gpus_per_learner < 1:
        yield (
            f"num_gpus_per_learner={config.num_gpus_per_learner}: {config.num_learners} learners average "
            "gradients by NCCL, which needs one GPU per learner: set it to 1, or num_learners to 1"
        )
    if config.num_gpus_per_learner and not config.num_learners and not torch.cuda.is_available():
        yield (
            f"num_gpus_per_learner={config.num_gpus_per_learner}: torch finds no GPU on this machine, on "
            "which num_learners=0 learns; set it to 0, or num_learners to 1 for another machine's"
        )
