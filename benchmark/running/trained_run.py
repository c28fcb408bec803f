"""A trained run, read from its folder."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from benchmark.experiment.runs import Run, run_from
from benchmark.results.files import ResultsError
from benchmark.results.run_folder import RunFolder
from smarts.errors import nearest_names
from smarts.registry import import_own


def read_run(folder: RunFolder, imports: Sequence[str | Path] = ()) -> Run:
    """Return the run of a folder and import its own code.

    Args:
        folder: The run's.
        imports: Files and folders of own code, by default the ones of the training.

    Raises:
        ResultsError: There is none, or its config is damaged.
        OwnCodeError: A file or folder of own code does not exist.
    """
    if not folder.path.exists():
        beside = folder.path.parent.iterdir() if folder.path.parent.is_dir() else ()
        near = nearest_names(folder.path.name, (each.name for each in beside if each.is_dir()))
        raise ResultsError(
            "there is no such folder",
            place=str(folder.path),
            remedy=near
            if near.startswith("did you mean")
            else "give the folder of a run or of an exported policy",
        )
    try:
        facts = folder.facts()
        run = run_from(folder.read_config())
        tested = (facts.get("tested") or {}).get("metrics")
        metrics = None if tested is None else tuple(tested)
        own = tuple(str(Path(path).absolute()) for path in imports) or run.task_setting.imports
        import_own(own)
        return replace(run, task_setting=replace(run.task_setting, imports=own, metrics=metrics))
    except (ResultsError, ValueError) as error:
        reason = error.problem if isinstance(error, ResultsError) else error
        raise ResultsError(
            f"not a run: {reason}",
            place=(error.place if isinstance(error, ResultsError) else "") or str(folder.config),
            remedy="give a folder such as results/NAME/ppo/intersection/no_social_vehicles/seed_1, or that "
            "of an exported policy",
        ) from error
