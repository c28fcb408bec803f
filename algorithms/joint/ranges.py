"""Which numbers settings may take."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from math import inf
from numbers import Integral, Real
from typing import Any, NamedTuple

from algorithms.parts.schedule import is_schedule


class Range(NamedTuple):
    """An interval of numbers.

    Attributes:
        low: Smallest number.
        high: Largest number.
        whole: Whether only whole numbers are meant.
        above: Whether `low` itself is excluded.
    """

    low: float
    high: float = inf
    whole: bool = False
    above: bool = False

    def holds(self, value: Any) -> bool:
        """Return whether the value is a number of this range."""
        kinds = Integral if self.whole else Real
        if isinstance(value, bool) or not isinstance(value, kinds):
            return False
        number = float(value)
        return self.low <= number <= self.high and not (self.above and number == self.low)

    def __str__(self) -> str:
        kind = "a whole number" if self.whole else "a number"
        least = f"above {self.low:g}" if self.above else f"of at least {self.low:g}"
        return f"{kind} {least}" + ("" if self.high == inf else f" and at most {self.high:g}")


FRACTION, POSITIVE, COUNT = Range(0, 1), Range(0, above=True), Range(1, whole=True)
NOT_NEGATIVE, NUMBER = Range(0), Range(0, whole=True)

RANGES: Mapping[str, Range] = {
    "agreement_rounds": NUMBER,
    "alpha": NOT_NEGATIVE,
    "attention_heads": COUNT,
    "batch_size": COUNT,
    "capacity": COUNT,
    "clip": POSITIVE,
    "communication_steps": NUMBER,
    "entropy_coeff": NOT_NEGATIVE,
    "epochs": COUNT,
    "epsilon_steps": NOT_NEGATIVE,
    "fit_steps": COUNT,
    "gamma": FRACTION,
    "grad_clip": POSITIVE,
    "gru": NUMBER,
    "lambda_": FRACTION,
    "learning_starts": NUMBER,
    "logit_penalty": NOT_NEGATIVE,
    "longest_life": COUNT,
    "max_env_failures": COUNT,
    "max_joint_actions": COUNT,
    "max_silent_iterations": COUNT,
    "minibatch_size": COUNT,
    "mixer_width": COUNT,
    "noise": NOT_NEGATIVE,
    "priority_alpha": NOT_NEGATIVE,
    "priority_beta": NOT_NEGATIVE,
    "reward_scale": POSITIVE,
    "sequence_length": COUNT,
    "tau": Range(0, 1, above=True),
    "temperature": POSITIVE,
    "torch_threads": COUNT,
    "updates_per_step": POSITIVE,
    "value_coeff": NOT_NEGATIVE,
}
OPTIONAL = ("grad_clip", "minibatch_size")
"""Settings that may also be None."""
SCHEDULED = ("entropy_coeff",)
"""Settings that may also be schedules."""


def faults(settings: Mapping[str, Any]) -> Iterator[str]:
    """Yield a sentence on every setting whose value cannot be meant."""
    for name, value in settings.items():
        wanted = RANGES.get(name)
        if name in SCHEDULED and isinstance(value, list | tuple):
            if not is_schedule(value) or not all(RANGES[name].holds(number) for _, number in value):
                yield f"{name}={value!r} is not a schedule, as [[0, 0.01], [10000, 0.001]]"
            continue
        if wanted and not wanted.holds(value) and not (value is None and name in OPTIONAL):
            yield f"{name}={value!r} is not {wanted}"
    hidden = settings.get("hidden", ())
    if not isinstance(hidden, tuple | list) or not all(COUNT.holds(width) for width in hidden):
        yield f"hidden={hidden!r} is not a tuple of widths, as (64, 64)"
    # Without the steps of a schedule it is an algorithm's own affair what its epsilon is.
    epsilon = settings["epsilon"] if "epsilon_steps" in settings else (1.0, 0.0)
    pair = isinstance(epsilon, tuple | list) and len(epsilon) == 2
    if not pair or not all(FRACTION.holds(chance) for chance in epsilon):
        yield f"epsilon={epsilon!r} is not a pair (first, last) of probabilities"
    starts, capacity = settings.get("learning_starts", 0), settings.get("capacity", inf)
    if NUMBER.holds(starts) and starts > capacity:
        yield f"learning_starts={starts} is more than capacity={capacity}: nothing would ever be learnt"
    if settings.get("team_reward", "sum") not in ("sum", "mean"):
        yield f"team_reward={settings['team_reward']!r} is neither 'sum' nor 'mean'"
