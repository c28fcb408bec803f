"""A run's folder, and how an interrupted run resumes.

config.yaml      all that the run depends on
run.json         format, status, versions, machine, times
progress.csv     a line for each iteration
tensorboard/     the same for TensorBoard
checkpoint/      the last checkpoint, with the state of training and the digest of each file
best/            the best checkpoint in validation
episodes.parquet results of the test: a row for each agent-episode
episodes/        recorded test episodes, if they are kept
"""

from __future__ import annotations

import shutil
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import yaml

from algorithms import config
from benchmark.experiment.runs import (
    DATA,
    INPUTS,
    OWN_CODE,
    START,
    TESTED,
    changed_settings,
    default_settings,
    inputs_of,
    is_larger,
    known_inputs,
    with_defaults,
    with_inputs,
)
from benchmark.metrics import read_table
from benchmark.results.digests import check_digests, digest_of
from benchmark.results.files import (
    ResultsError,
    files_in,
    first_line,
    named_failures,
    previous_of,
    read_json,
    read_versioned,
    recover_folder,
    replaced_folder,
    write_files,
    write_versioned,
    write_whole,
)
from smarts.errors import SmartsError

CHECKPOINT, BEST, TABLE, EPISODES = "checkpoint", "best", "episodes.parquet", "episodes"
"""Names of folders and files in a run's folder."""
ENDED_BY = "ended_by"
"""Key of run.json: the budget that was used up first, "agent_steps" or "minutes"."""
CONTINUED = "continued"
"""Key of run.json: versions, machine and times of each continuation."""
DEFAULTS = "defaults"
"""Key of run.json: settings that the config does not give, as they were by default; older runs lack it."""
SCENARIOS = "scenarios"
"""Key of run.json: name -> digest of each scenario of the run, as built; the oldest runs lack it."""
CONFIG_REMEDY = "restore it from a copy, or remove the run's folder to start again"
BUDGET = "budget"
"""Key of a run's content whose values may grow."""
IMPORTS = "imports"
"""Key of a run's content that lists files and folders of own code."""
UNSET = "default"
"""Shown for a value that only one of two configs has."""
FINISHED, TRAINING, TESTING = "finished", "training", "testing"


class RunFolder:
    """The results of one run on disk.

    Args:
        path: The folder.
        packed: What `results/pack.py` has kept of a finished run in place of its folder.
    """

    def __init__(self, path: Path, packed: Mapping[str, Any] | None = None) -> None:
        self.path, self._packed = path, packed
        self.config = path / "config.yaml"
        self.run = path / "run.json"
        self.progress = path / "progress.csv"
        self.checkpoint = path / CHECKPOINT
        self.best = path / BEST
        self.inputs = path / INPUTS
        """In a training's scratch folder: what it takes from elsewhere, a folder each; see `inputs_of`."""
        self.table = path / TABLE
        self.episodes = path / EPISODES

    def facts(self) -> dict[str, Any]:
        """Return the content of run.json, empty without one.

        Raises:
            ResultsError: It is damaged, or of another format.
        """
        if self._packed:
            return dict(self._packed["run"])
        return read_versioned(self.run) if self.run.exists() else {}

    @property
    def status(self) -> str | None:
        """The run's phase; None before it has begun."""
        return self.facts().get("status")

    @property
    def has_table(self) -> bool:
        """Whether the test's table is there and whole."""
        with suppress(SmartsError):
            return self._packed is not None or len(read_table(self.table)) > 0
        return False

    @property
    def has_episodes(self) -> bool:
        """Whether the test's episodes are there, or cannot be played again for want of a checkpoint."""
        return self.episodes.exists() or self.has_lost_checkpoint

    @property
    def has_lost_checkpoint(self) -> bool:
        """Whether it was trained, and cannot be tested again."""
        if self._packed:
            return BUDGET in self._packed["config"]
        return self.progress.exists() and not self.checkpoint.exists()

    def is_finished(self, tested: Mapping[str, Any]) -> bool:
        """Return whether the run is trained and tested in this way.

        Raises:
            ResultsError: The table is lost, damaged or of another test, and there is no checkpoint.
        """
        if self.status != FINISHED:
            return False
        before = self.facts().get(TESTED, {})
        if self.has_table and _is_same_test(before, tested):
            return True
        if self.has_lost_checkpoint:
            lost = "the test's table is missing or damaged"
            problem = "it was tested in another way" if self.has_table else lost
            raise ResultsError(
                f"{problem}; there is no checkpoint either that could be tested again",
                place=str(self.table),
                remedy=f"restore it, test as before ({before}), or train into another --out",
            )
        return False

    def check(self, content: Mapping[str, Any]) -> None:
        """Raise if the folder holds anything but this run, perhaps with a smaller budget.

        Args:
            content: All that the run's training depends on.

        Raises:
            ResultsError: It holds another or an unknown run, or is damaged; or the budget has grown and there
                is no checkpoint to continue from.
        """
        there, here = self._content(), with_defaults(content)
        if there is None:
            return
        inputs = inputs_of(here)
        for name, digest in known_inputs(self.facts()).items():
            if name in inputs:
                here = with_inputs(here, {name: digest})  # where it is gone or damaged
                with suppress(ResultsError):
                    here = with_inputs(here, {name: digest_of(input_files(name, inputs[name]))})
        is_extended = _is_extended(here, there)
        compared = comparable(there, here), comparable(here, there)
        differing = differing_values(*({**each, BUDGET: None} if is_extended else each for each in compared))
        if differing:
            settings = [each.get("settings") for each in compared]
            raise ResultsError(
                f"here are results of a run with another config: {differing}",
                place=str(self.config),
                remedy="give the experiment another name or --out, "
                + ("or set the old values in `settings`, " if settings[0] != settings[1] else "")
                + "or remove the folder to start again "
                "(with a larger budget and all else as it is, the run trains on)",
            )
        if is_extended and self.status in (TESTING, FINISHED) and not self._is_there(self.checkpoint):
            self.kept("last")

    def check_start(self, content: Mapping[str, Any]) -> None:
        """Raise if the run has not begun, and cannot start from the run that it names.

        Raises:
            ResultsError: That has no checkpoint, or is of an algorithm with other policy networks.
        """
        if START in content and not self._has_results():
            other, own = RunFolder(Path(content[START])), content["algorithm"]
            other.kept("last")
            trained = other.read_config()["algorithm"]
            if trained != own and config(trained).policy_module is not config(own).policy_module:
                problem = f"is a run of {trained}, which has other policy networks than {own}"
                raise ResultsError(problem, place=str(other.path), remedy=f"name a run of {own}")

    def is_extended(self, content: Mapping[str, Any]) -> bool:
        """Return whether the folder holds this run with a smaller budget."""
        there = self._content()
        return there is not None and _is_extended(with_defaults(content), there)

    def changed_scenarios(self, digests: Mapping[str, str]) -> list[str]:
        """Return the scenarios that have changed since this run, as far as their digests are recorded.

        Args:
            digests: Name -> present digest.
        """
        known = self.facts().get(SCENARIOS, {}) if self._has_results() else {}
        return [name for name, digest in digests.items() if known.get(name, digest) != digest]

    def _content(self) -> dict[str, Any] | None:
        """Return the config of the run in the folder, with the defaults of its time; None without one."""
        if not self._has_results():
            return None
        return with_own_defaults(self.read_config(), self.facts())

    def _has_results(self) -> bool:
        """Return whether the folder holds more than the begin of a run."""
        if self.status == FINISHED or self._is_there(self.checkpoint):
            return True
        # Without a checkpoint nothing of an unfinished training can be used; scripted policies have none.
        return self.status == TESTING and self.progress.exists()

    @staticmethod
    def _is_there(folder: Path) -> bool:
        """Return whether a folder exists or can be recovered."""
        return folder.exists() or previous_of(folder).exists()

    def read_config(self) -> dict[str, Any]:
        """Return the content of config.yaml.

        Raises:
            ResultsError: It is missing or damaged.
        """
        if self._packed:
            return dict(self._packed["config"])
        try:
            return yaml.safe_load(self.config.read_text(encoding="utf-8"))
        except (OSError, ValueError, yaml.YAMLError) as error:
            problem = f"cannot be read: {getattr(error, 'strerror', None) or first_line(error)}"
            raise ResultsError(problem, place=str(self.config), remedy=CONFIG_REMEDY) from error

    def open(self, content: Mapping[str, Any]) -> None:
        """Begin or resume the run; see `check`."""
        self.check(content)
        with named_failures(self.path):
            self.path.mkdir(parents=True, exist_ok=True)
        if is_extended := self.is_extended(content):
            self.note(status=TRAINING)  # first, so that a kill in between does not leave the run finished
        before = self._content()
        if before is None:  # perhaps of another config, which was corrected
            self.run.unlink(missing_ok=True)
        if is_extended or before is None or before.get(IMPORTS) != content.get(IMPORTS):
            text = yaml.safe_dump(dict(content), sort_keys=False)
            write_whole(self.config, lambda file: file.write_text(text, encoding="utf-8"))
        recover_folder(self.checkpoint)
        recover_folder(self.best)

    def note(self, **changes: Any) -> None:
        """Write values into run.json."""
        write_versioned(self.run, {**self.facts(), **changes})

    def note_continuation(self, circumstances: Mapping[str, Any]) -> None:
        """Write versions, machine and time of a continuation or a repeated test into run.json."""
        self.note(**{CONTINUED: [*self.facts().get(CONTINUED, []), dict(circumstances)]})

    def keep(self, place: str, content: Mapping[str, bytes] | bytes) -> None:
        """Write a file or a folder of the run, whole or not at all.

        Args:
            place: Its path in the run's folder.
            content: The file's content, or a folder's files by their paths in it; an empty folder is removed.

        Raises:
            ResultsError: The disk is full, or the folder cannot be written to. The old content stays.
        """
        path = self.path / place
        if isinstance(content, bytes):
            write_whole(path, lambda file: file.write_bytes(content))
        elif content:
            with replaced_folder(path) as folder:
                write_files(folder, content)
        else:
            with named_failures(path), suppress(FileNotFoundError):
                shutil.rmtree(path)

    def kept(self, checkpoint: str) -> Path:
        """Return the folder of the "last" or "best" checkpoint.

        Raises:
            ResultsError: The checkpoint is missing.
        """
        folder = self.checkpoint if checkpoint == "last" else self.best
        if folder.exists():
            return folder
        problem, other = f"the run has no {checkpoint} checkpoint", "last"
        has_last = checkpoint != other and self.checkpoint.exists()
        remedy = f"take the last one: --checkpoint {other}" if has_last else "train it, into another --out"
        raise ResultsError(problem, place=str(self.path), remedy=remedy)

    def networks(self) -> dict[str, bytes]:
        """Return the files of the last checkpoint's networks, for a run that starts from them.

        Raises:
            ResultsError: There is no checkpoint, or it is damaged.
        """
        folder = self.kept("last")
        check_digests(folder, "start from another run")
        return files_in(folder / "learner_group" / "learner" / "rl_module")

    def training_state(self) -> dict[str, Any] | None:
        """Return the state of training at the last checkpoint, None without one.

        Raises:
            ResultsError: The checkpoint is damaged.
        """
        if not self.checkpoint.exists():
            return None
        return read_json(
            self.checkpoint / "training.json",
            remedy=f"remove the folder {self.checkpoint} to train from the start",
        )


def input_files(name: str, place: str) -> dict[str, bytes]:
    """Return the files that a training takes from elsewhere, by their paths in a folder.

    Args:
        name: What they are; see `inputs_of`.
        place: Folder of a run, whose networks are returned, or for `DATA` a file.

    Raises:
        ResultsError: They are missing or damaged.
    """
    if name != DATA:
        return RunFolder(Path(place)).networks()
    try:
        return {Path(place).name: Path(place).read_bytes()}
    except OSError as error:
        problem, remedy = f"cannot be read: {error.strerror}", "give what `smarts-bench demonstrations` wrote"
        raise ResultsError(problem, place=f"data {place!r}", remedy=remedy) from error


def with_own_defaults(config: Mapping[str, Any], facts: Mapping[str, Any]) -> dict[str, Any]:
    """Return a run's config, with the defaults of its time where these were others than today's.

    What it takes from elsewhere is given by digests, as far as they are known, and not by places.

    Args:
        config: Content of config.yaml.
        facts: Facts of run.json.
    """
    content = with_defaults(config)
    content = with_inputs(content, {k: v for k, v in known_inputs(facts).items() if k in inputs_of(content)})
    now = default_settings(content)
    defaults = {name: value for name, value in facts.get(DEFAULTS, {}).items() if name in now}
    return {**content, "settings": defaults | (content.get("settings") or {})} if defaults else content


def _is_same_test(before: Mapping[str, Any], tested: Mapping[str, Any]) -> bool:
    """Return whether two contents of a test are alike; the order of metrics has no meaning."""
    alike = [
        {**comparable(one, other), "metrics": sorted(map(str, one.get("metrics") or ()))}
        for one, other in ((before, tested), (tested, before))
    ]
    return alike[0] == alike[1]


def changed_code(there: Mapping[str, Any], here: Mapping[str, Any]) -> list[str]:
    """Return the names of own code whose digest differs; the oldest runs have none."""
    before, now = (each.get(OWN_CODE) or {} for each in (there, here))
    return [name for name in now if before.get(name, now[name]) != now[name]]


def changes_since(folder: RunFolder, content: Mapping[str, Any], scenarios: Mapping[str, str]) -> list[str]:
    """Return what of a run's own code and scenarios has changed since the run, in words.

    Args:
        folder: The run's.
        content: The run's content, as it would be now.
        scenarios: Name -> present digest of each scenario.
    """
    code = (f"the code of {name!r}" for name in changed_code(folder.read_config(), content))
    return [*code, *(f"the scenario {name!r}" for name in folder.changed_scenarios(scenarios))]


def _is_extended(here: Mapping[str, Any], there: Mapping[str, Any]) -> bool:
    """Return whether the budget of a content is larger than another's, if both have one."""
    return BUDGET in here and BUDGET in there and is_larger(here[BUDGET], there[BUDGET])


def comparable(content: Mapping[str, Any], other: Mapping[str, Any]) -> dict[str, Any]:
    """Return a content without settings that are defaults, and without what another one does not import.

    A metric or an algorithm that is added to an experiment changes nothing in what its other runs trained.
    """
    modules = {Path(path).stem for path in other.get(IMPORTS) or ()}
    common = sorted(path for path in content.get(IMPORTS) or () if Path(path).stem in modules)
    known = other.get(OWN_CODE) or {}
    code = {name: each for name, each in (content.get(OWN_CODE) or {}).items() if name in known}
    settings = {"settings": changed_settings(content)} if "settings" in content else {}
    return {**content, **settings, IMPORTS: common, OWN_CODE: code}


def differing_values(there: Mapping[str, Any], here: Mapping[str, Any]) -> str:
    """Return in words in which values two contents differ; empty if in none."""
    one, two = flat_values(there), flat_values(here)
    names = [name for name in {**one, **two} if one.get(name, UNSET) != two.get(name, UNSET)]
    return ", ".join(f"{name} ({one.get(name, UNSET)}, here {two.get(name, UNSET)})" for name in names)


def flat_values(content: Mapping[str, Any], above: str = "") -> dict[str, Any]:
    """Return the values of sections under names like "budget.minutes"."""
    found: dict[str, Any] = {}
    for name, value in content.items():
        found |= (
            flat_values(value, f"{above}{name}.") if isinstance(value, dict) else {f"{above}{name}": value}
        )
    return found
