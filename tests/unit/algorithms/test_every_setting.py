"""Every setting of every algorithm: another value gives other weights, or is refused."""

from functools import cache

import numpy as np
import pytest
import torch
from gymnasium.spaces import Box
from rigs import PLAYING, Rig, known

import algorithms
from algorithms.errors import SpaceError
from tests.games.games import Game

SMALL = {
    "hidden": (8,),
    "lr": 3e-3,
    "rollout_fragment_length": 16,
    "learning_starts": 20,
    "batch_size": 8,
    "capacity": 48,
    "updates_per_step": 0.25,
    "minibatch_size": 10,
    "epsilon_steps": 24,
    "temperature_steps": 24,
    "fit_steps": 3,
    "epochs": 2,
}
OTHER = {
    "sharing": {"none": "all", "all": "none"},
    "graph": {"auto": "ring"},
    "clip": {0.2: 1e-3},
    "team_reward": {"sum": "mean"},
    "variant": {"base": "alt"},
    "update_at": {"acted_on": "same_step"},
}
OF_RUNS = {
    "max_env_failures",
    "max_silent_iterations",
    "torch_threads",
    "evaluate_sampled",
    "checkpoint_replay",
    "longest_trajectory",
    "max_joint_actions",
    "kl_to",
    "kl_coeff",
}
"""Settings that say where or when a run stops, what it reports or stores: they have tests of their own."""
BESIDE = {"agreement_rounds": {"graph": "ring"}, "identity": {"sharing": "all"}}
"""Settings that change something only beside another: on a complete graph one round of averaging is all, and
one agent alone has no place."""
NEEDS = {"priority_alpha": {"prioritised": True}, "priority_beta": {"prioritised": True}}
"""Settings that change nothing without another, which a default leaves out."""


class Chances(Game):
    """Four agents see two rows of chance, and are rewarded by chance and by what they do."""

    length = 5

    def __init__(self, config=None):
        super().__init__(agents=4, actions=3)
        self.observation_spaces = {a: Box(-np.inf, np.inf, (2, 2), np.float32) for a in self.agents}
        if (config or {}).get("continuous"):
            self.action_spaces = {a: Box(-1.0, 1.0, (1,), np.float32) for a in self.agents}

    def step(self, action_dict):
        return super().step({a: np.asarray(action).item() for a, action in action_dict.items()})

    def observe(self):
        return {a: self.rng.standard_normal((2, 2)).astype(np.float32) for a in self.agents}

    def reward(self, actions):
        return [float(self.rng.standard_normal() + action) for action in actions]


def learned(name, env_config=None, **settings):
    """Return the weights after two rollouts with the algorithm's own exploration."""
    settings = known(name, SMALL | settings)
    entry = algorithms.entry(name)
    fixed = {n for n, field in entry.settings.model_fields.items() if "const" in kind_of(name, n)}
    settings = {n: value for n, value in settings.items() if n not in fixed and kind_of(name, n) != NOTHING}
    algorithms.config(name).training(**settings).validate()
    rig = Rig(name, Chances, env_config, seed=1, **settings)
    for done in range(0, 32, rig.config.rollout_fragment_length):
        rig.policies.refresh()
        rollout = rig.sampler.fragment(rig.config.rollout_fragment_length, rig.config.exploration(2 * done))
        rig.learner.env_steps = 2 * (done + rig.config.rollout_fragment_length)
        rig.learner.update_joint(rollout)
    return rig.weights()


NOTHING = {"type": "null"}


@cache
def schemas(name):
    return algorithms.entry(name).settings.model_json_schema()["properties"]


def kind_of(name, setting):
    schema = schemas(name)[setting]
    return {key: schema[key] for key in ("const", "type") if key in schema}


def another(setting, value):
    """Return another value of a setting."""
    if setting in OTHER:
        return OTHER[setting][value]
    if isinstance(value, bool):
        return not value
    if setting == "grad_clip":
        return 1e-3
    if setting in ("gru", "set_width") and not value:
        return 4
    if isinstance(value, tuple):
        return tuple(each + 4 if isinstance(each, int) else each / 2 for each in value)
    if isinstance(value, int):
        return value * 2 if setting != "attention_heads" else 3 - min(value, 2)
    return value / 2


def same(one, other):
    return one.keys() == other.keys() and all(
        own.keys() == other[module].keys()
        and all(
            w.shape == other[module][k].shape and torch.equal(w, other[module][k]) for k, w in own.items()
        )
        for module, own in one.items()
    )


def settings_of(name):
    """Return the settings with two values at least, and their values here."""
    defaults = dict(algorithms.entry(name).settings())
    several = (n for n in defaults if "const" not in kind_of(name, n) and kind_of(name, n) != NOTHING)
    return {setting: SMALL.get(setting, defaults[setting]) for setting in several if setting not in OF_RUNS}


@pytest.mark.nightly
@pytest.mark.parametrize("name", PLAYING)
def test_every_setting_changes_what_is_learned_or_is_refused(name):
    entry, base = algorithms.entry(name), learned(name)
    assert same(base, learned(name))
    ignored, refused = [], {}
    for setting, value in settings_of(name).items():
        beside = BESIDE.get(setting, {})
        try:
            weights = learned(name, **beside, **{setting: another(setting, value)})
        except (ValueError, SpaceError) as error:
            refused[setting] = str(error)
            continue
        if same(learned(name, **beside) if beside else base, weights):
            ignored.append(setting)
    assert not ignored
    assert all(setting in error for setting, error in refused.items())
    expected = {*known(name, {"noise": 0}), *known(name, NEEDS)}
    if not settings_of(name)["gru"]:
        expected |= {"sequence_length"} if entry.recurrent else {"sequence_length", "gru"}
    if name == "networked_q":  # a single node exchanges nothing
        expected.add("sharing")
    assert refused.keys() == expected
