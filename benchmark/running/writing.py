"""The only writer of a run's results: the driver, from the messages of the run's process."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from functools import partial
from hashlib import blake2b
from typing import Any

from benchmark.experiment.loggers import LOGGERS
from benchmark.experiment.runs import (
    INPUTS,
    NOT_TAKEN,
    START,
    STARTED_FROM,
    TESTED,
    Run,
    ScriptedRun,
    default_settings,
    inputs_of,
)
from benchmark.results.digests import digest_of
from benchmark.results.files import files_in
from benchmark.results.progress import add_progress, begin_progress
from benchmark.results.run_folder import (
    DEFAULTS,
    FINISHED,
    SCENARIOS,
    TESTING,
    TRAINING,
    RunFolder,
    input_files,
)
from benchmark.running.logger_threads import logger_thread
from benchmark.running.loggers import Logged
from benchmark.running.messages import Began, Kept, Line, Message, Noted, RunProgress


class RunWriter:
    """Writes what the process of a run reports, in that order, each message whole or not at all.

    Args:
        run: The run, or the test of a scripted policy.
        folder: Folder of its results; begun or resumed.
        loggers: Names of what shows its progress beside progress.csv.

    Raises:
        ResultsError: The folder cannot be used.
    """

    def __init__(self, run: Run | ScriptedRun, folder: RunFolder, loggers: Sequence[str] = ()) -> None:
        self._run, self._folder, self._names = run, folder, loggers
        self._loggers: dict[str, Any] = {}
        """Those that have begun, or will, and have not failed."""
        self._inputs: dict[str, Any] = {}
        has_begun = folder.status is not None
        folder.open(run.content())
        if has_begun and folder.status is None:
            print(f"{run}: has no checkpoint to continue from, and begins again", file=sys.stderr)

    def checkpoint(self) -> dict[str, bytes]:
        """Return the files of the last checkpoint, from which the run continues; empty without one."""
        return files_in(self._folder.checkpoint)

    def inputs(self) -> dict[str, bytes]:
        """Return the files of what the training takes from elsewhere now, by their paths in `inputs`.

        A test needs no such files. A training that is resumed needs no initial weights.

        Raises:
            ResultsError: It is missing or damaged.
        """
        if not isinstance(self._run, Run) or self._folder.status in (TESTING, FINISHED):
            return {}
        found, files = {}, {}
        for name, place in inputs_of(self._run.content()).items():
            if name == START and self._folder.checkpoint.exists():
                continue
            content = input_files(name, place)
            found[name] = digest_of(content)
            files |= {f"{name}/{path}": each for path, each in content.items()}
        start = {STARTED_FROM: found.pop(START)} if START in found else {}
        self._inputs = start | ({INPUTS: found} if found else {})
        return files

    def take(self, message: Message) -> RunProgress | None:
        """Write what a message says; return it if it is progress.

        Raises:
            ResultsError: The disk is full, the folder cannot be written to, or what is there is damaged.
        """
        match message:
            case RunProgress():
                return message
            case Began():
                self._begin(message)
            case Noted(values):
                self._folder.note(**values)
                if NOT_TAKEN in values:
                    unfit = f", but for {', '.join(values[NOT_TAKEN])}" if values[NOT_TAKEN] else ""
                    begun = f"begins with weights of {self._run.task_setting.task.start_from}"
                    print(f"{self._run}: {begun}{unfit}", file=sys.stderr)
            case Line(columns):
                add_progress(self._folder.progress, columns)
                self._tell(lambda name: self._loggers[name].add(columns))
            case Kept(place, content):
                self._folder.keep(place, content)
        return None

    def close(self) -> None:
        """Write what is left; may be called again."""
        self._tell(lambda name: self._loggers.pop(name).close())
        for name in self._names:
            logger_thread(name).wait()

    def _tell(self, call: Callable[[str], object]) -> None:
        """Call every logger by its name, in its thread."""
        for name in self._names:
            logger_thread(name).add(partial(self._try, name, call))

    def _try(self, name: str, call: Callable[[str], object]) -> None:
        """Call a logger; what fails, as where a server is gone, is left out from then on."""
        try:
            if name in self._loggers:
                call(name)
        except Exception as error:  # whatever a package of others raises
            self._loggers.pop(name, None)
            print(f"note: {self._run}: the logger {name} has failed: {error}", file=sys.stderr)

    def _begin(self, began: Began) -> None:
        """Note where a training runs, and cut its progress to what its checkpoint has."""
        if self._folder.status is None:
            content = self._run.content()
            given = content.get("settings", {})
            defaults = {name: each for name, each in default_settings(content).items() if name not in given}
            known = {SCENARIOS: dict(began.scenarios), DEFAULTS: defaults}
            known[TESTED] = self._run.task_setting.test_content()
            self._folder.note(status=TRAINING, run=str(self._run), **known, **began.circumstances)
        else:
            self._folder.note_continuation(began.circumstances)
        if self._inputs:
            self._folder.note(**self._inputs)
        state = self._folder.training_state()
        lines = begin_progress(self._folder.progress, state["iteration"] if state else 0)
        self._loggers, logged = dict.fromkeys(self._names), self._logged()
        self._tell(lambda name: self._loggers.update({name: LOGGERS[name](logged, lines)}))

    def _logged(self) -> Logged:
        """Return the training as loggers show it."""
        path = self._folder.path.absolute()
        began = f"{path} {self._folder.facts().get('begun')}"
        experiment = path.parents[len(self._run.folder.parts) - 1].name
        known = blake2b(began.encode(), digest_size=8).hexdigest()
        return Logged(experiment, str(self._run), known, path, self._run.content())
