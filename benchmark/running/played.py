"""What is played in a task setting: its scenarios as they were built, and held-out variations of them."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterable, Iterator
from dataclasses import replace

from benchmark.experiment.models import Experiment
from benchmark.experiment.runs import TaskSetting, task_settings_of
from smarts.sstudio.build import build_scenario, build_scenarios
from smarts.sstudio.built import BuiltScenario
from smarts.sstudio.cache import file_hash
from smarts.sstudio.encoding import digest, encode

SECONDS = 5.0
"""Time between two lines about scenarios that are being built [s]."""


def build_played(names: Iterable[str]) -> None:
    """Build scenarios side by side, and print from time to time how many are built.

    Raises:
        SmartsError: One cannot be built.
    """
    said = time.monotonic()

    def show(built: int, count: int) -> None:
        nonlocal said
        if time.monotonic() - said > SECONDS:
            said = time.monotonic()
            print(f"built {built} of {count} scenarios", file=sys.stderr)

    build_scenarios(names, show)


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
    found = _digests(task_setting, names) | tested_digests(task_setting)
    for traffic in task.train_traffic:
        found |= _digests(task_setting, task.trained_on, traffic)
    return found


def tested_digests(task_setting: TaskSetting) -> dict[str, str]:
    """Return the digests of what a task setting's tests play, without held-out variations.

    Raises:
        SmartsError: One cannot be built or played.
    """
    found: dict[str, str] = {}
    for each in task_setting.task.test:
        found |= _digests(task_setting, each.scenarios, each.traffic)
    return found or _digests(task_setting, task_setting.task.trained_on)


def _digests(task_setting: TaskSetting, names: Iterable[str], traffic: str | None = None) -> dict[str, str]:
    """Return digests by name, behind which stands traffic that is not the run's."""
    played = replace(task_setting, traffic=traffic or task_setting.traffic)
    mark = "" if played.traffic == task_setting.traffic else f", {played.traffic}"
    return {f"{name}{mark}": digest_of(build_scenario(name), played) for name in names}


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
    drawn = [plan.drawn.fingerprint(16) for plan in plans if plan.drawn is not None]
    plans = [replace(plan, drawn=None) for plan in plans]
    described = [encode(plan) for plan in plans], encode(scenario.start_variation)
    bubbles = [encode(scenario.bubbles)] if scenario.bubbles else []
    options = [encode(dict(files.options))] if files.options else []
    recorded = []
    if files.recording:
        # Its log is the same in another mode.
        played = files.recording.mode, files.recording.begin, files.recording.latest
        recorded = [file_hash(files.recording.log), *played]
    return digest([contents, files.warm_up, *described, *bubbles, *options, *drawn, *recorded], size=8)
