"""What is played in a task setting: its scenarios as they were built, and held-out variations of them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from benchmark.experiment.models import Experiment
from benchmark.experiment.runs import TaskSetting, task_settings_of
from smarts.sstudio.build import build_scenario
from smarts.sstudio.built import BuiltScenario
from smarts.sstudio.encoding import digest, encode


def held_out_of(task_setting: TaskSetting) -> Iterator[str]:
    """Yield held-out variations, as "scenario@variation", that are something else than what is trained on.

    Many variations are of the traffic alone: without traffic they are the training once more.

    Raises:
        SmartsError: One cannot be built or played.
    """
    if not task_setting.evaluation.held_out_episodes:
        return
    for scenario in task_setting.task.trained_on:
        trained_on = build_scenario(scenario)
        for variation in trained_on.held_out:
            name = f"{scenario}@{variation}"
            if digest_of(build_scenario(name), task_setting) != digest_of(trained_on, task_setting):
                yield name


def scenario_digests(task_setting: TaskSetting) -> dict[str, str]:
    """Return a digest of each scenario that a task setting is trained and tested on, those held out too.

    Other traffic than that of the run stands behind the scenario's name.

    Raises:
        SmartsError: One cannot be built or played.
    """
    task = task_setting.task
    names = dict.fromkeys([*task.trained_on, *task.validated_on, *held_out_of(task_setting)])
    found = {name: digest_of(build_scenario(name), task_setting) for name in names}
    others = [(each.scenarios, each.traffic) for each in task.test]
    others += [(tuple(task.trained_on), traffic) for traffic in task.train_traffic]
    for scenarios, traffic in others:
        played = replace(task_setting, traffic=traffic or task_setting.traffic)
        mark = "" if played.traffic == task_setting.traffic else f", {played.traffic}"
        found |= {f"{name}{mark}": digest_of(build_scenario(name), played) for name in scenarios}
    return found


def scenarios_by_traffic(experiment: Experiment) -> dict[str, dict[str, str]]:
    """Return the digests of all scenarios of an experiment, by traffic and name.

    Raises:
        SmartsError: One cannot be built or played.
    """
    found: dict[str, dict[str, str]] = {}
    for task_setting in task_settings_of(experiment):
        found.setdefault(task_setting.traffic, {}).update(scenario_digests(task_setting))
    return found


def digest_of(built: BuiltScenario, task_setting: TaskSetting) -> str:
    """Return a digest of all that a task setting's episodes in a scenario are made of.

    That is less than the digest in the name of the build's folder: other traffic of the same scenario, or a
    program that builds the same in another way, change nothing here.
    """
    files = built.traffic_files(task_setting.traffic)
    contents = [file.read_text(encoding="utf-8") for file in (files.net, *files.routes, *files.additional)]
    environment, scenario = task_setting.environment, built.scenario
    plans = built.with_traffic([task_setting.traffic]).episodes(environment.mission_count)
    if not environment.social_agents:
        plans = [replace(plan, spare=()) for plan in plans]
    described = [encode(plan) for plan in plans], encode(scenario.start_variation)
    bubbles = [encode(scenario.bubbles)] if scenario.bubbles else []
    options = [encode(dict(files.options))] if files.options else []
    return digest([contents, files.warm_up, *described, *bubbles, *options], size=8)
