"""Settings: values in and out of range, and what configs make of them."""

from typing import Annotated

import numpy as np
import pytest
import ray
from gymnasium.spaces import Box
from pydantic import Field

import algorithms
from algorithms.errors import EnvironmentFailure, SpaceError, UnknownSettingError
from algorithms.joint.making import check_environment
from algorithms.ppo import PPOConfig
from algorithms.registry import ALGORITHMS
from algorithms.setting_kinds import faults
from algorithms.settings import PPOSettings
from tests.games.games import Cues, Target


@pytest.mark.parametrize(
    ("name", "wrong", "key"),
    [
        ("ppo", {"clip": -1}, ("clip",)),
        ("ppo", {"entropy_coeff": [[0, 0.1], [9, 0.2], [9, 0.1]]}, ("entropy_coeff",)),
        ("ppo", {"lr": [[0, 3.0], [10, 0.1]]}, ("lr", 0, 1)),
        ("ppo", {"sharing": {"g": ["a", "b"], "h": ["b"]}}, ("sharing",)),
        ("mf_q", {"graph": "star"}, ("graph",)),
        ("maac", {"hidden": (64, 0)}, ("hidden", 1)),
        ("dqn", {"learning_starts": 5000, "capacity": 1000}, ()),
        ("maac", {"attention_heads": 5}, ()),
        ("ppo", {"rollout_fragment_length": 60, "gru": 8}, ()),
    ],
)
def test_values_out_of_range_or_that_do_not_fit_each_other_are_named_by_their_place(name, wrong, key):
    assert [fault.key for fault in faults(ALGORITHMS[name].settings, wrong)] == [key]
    with pytest.raises(ValueError, match=str(next(iter(wrong)))):
        algorithms.config(name).training(**wrong).validate()


def test_an_own_algorithms_settings_mean_what_it_says():
    """`alpha` of MAAC is no weight here, `clip` has no smallest number, `tau` has another range."""

    class OwnSettings(PPOSettings):
        alpha: str = "first"
        clip: float = -1
        tau: Annotated[float, Field(ge=2)] = 3.0

    class Own(PPOConfig):
        entry = ALGORITHMS["ppo"]._replace(settings=OwnSettings)

    assert (Own().alpha, Own().clip, Own().lr) == ("first", -1, PPOSettings().lr)
    Own().validate()
    for wrong in ({"tau": 1}, {"lambda_": 3}):
        with pytest.raises(ValueError, match=f"^{next(iter(wrong))}="):
            Own().training(**wrong).validate()


def test_every_setting_has_a_meaning_and_a_default_in_range():
    for name, entry in ALGORITHMS.items():
        settings = entry.settings
        assert all(settings.meaning(setting) for setting in settings.model_fields), name
        assert not faults(settings, dict(settings())), name
        described = settings.model_json_schema()["properties"].values()
        numbers = [part for part in described if part.get("type") in ("integer", "number")]
        assert all(part.keys() & {"minimum", "exclusiveMinimum", "const"} for part in numbers), name
        algorithms.config(name).validate()


def handed_over(config):
    """Return a config as an algorithm gets it from its user."""
    return type(config).from_state(config.get_state())


@pytest.mark.parametrize(
    ("other", "own"), [("learning_rate", "lr"), ("clip_param", "clip"), ("gae_lambda", "lambda_")]
)
def test_names_of_other_libraries_lead_to_ours(other, own):
    with pytest.raises(UnknownSettingError, match=f"remedy: use '{own}'"):
        algorithms.config("ppo").training(**{other: 0.1})


@pytest.mark.parametrize(("name", "meant"), [("epoch", "epochs"), ("num_env_runers", "num_env_")])
def test_a_typing_error_is_named_wherever_it_was_made(name, meant):
    attribute = algorithms.config("ppo")
    setattr(attribute, name, 1)
    evaluation = algorithms.config("ppo").evaluation(evaluation_config={name: 1})
    for config in (attribute, algorithms.config("ppo").update_from_dict({name: 1}), evaluation):
        with pytest.raises(UnknownSettingError, match=rf"'{name}'[\s\S]*did you mean '{meant}"):
            config.validate()


def test_dicts_of_settings_that_rllib_makes_are_taken():
    config = handed_over(algorithms.config("dqn").training(lr=0.5, epsilon=[1, 0]).debugging(seed=4))
    other = algorithms.config("dqn").update_from_dict({**config.to_dict(), "__trial_info__": None})
    other.update_from_dict({"num_workers": 3, "multiagent": {"policies": {"a"}}})
    assert (other.lr, other.epsilon, other.seed, other.num_env_runners) == (0.5, [1, 0], 4, 3)
    other.validate()


class Pictures(Cues):
    def __init__(self, config=None):
        super().__init__(config)
        self.observation_spaces = dict.fromkeys(self.agents, Box(0, 255, (8, 8, 3), np.uint8))

    def observe(self):
        return {a: np.zeros((8, 8, 3), np.uint8) for a in self.agents}


class Unstarted(Cues):
    def reset(self, **kwargs):
        raise OSError("no display")


@pytest.mark.parametrize(
    ("name", "env", "change", "error", "named"),
    [
        ("ppo", None, lambda c: c, SpaceError, r"no environment[\s\S]*environment\("),
        ("dqn", Target, lambda c: c, SpaceError, "agent_0.*Box"),
        ("qmix", Pictures, lambda c: c, SpaceError, "image"),
        ("ppo", Cues, lambda c: c.multi_agent(policies={"bot"}), SpaceError, "'bot'.*agent_0"),
        ("ppo", Cues, lambda c: c.training(sharing={"g": ["agent_0"]}), SpaceError, "no group.*agent_1"),
    ],
)
def test_what_does_not_fit_the_environment_is_an_error_before_ray_starts(name, env, change, error, named):
    config = algorithms.config(name).environment(env).env_runners(num_env_runners=0)
    with pytest.raises(error, match=named):
        change(config).build_algo()
    assert not ray.is_initialized()


def test_an_environment_that_cannot_start_is_an_error_before_ray_starts_unless_others_start_it():
    """Remote runners may be on a machine that has what this one lacks."""
    config = algorithms.config("ppo").environment(Unstarted).env_runners(num_env_runners=0)
    with pytest.raises(EnvironmentFailure, match=r"Unstarted.*no display"):
        config.build_algo()
    assert not ray.is_initialized()
    check_environment(config.env_runners(num_env_runners=1), config.algo_class.runner_class)
