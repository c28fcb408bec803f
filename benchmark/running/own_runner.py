"""Environment runners that import own code before anything else, in whatever process they are."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import ray

from algorithms.errors import AlgorithmError
from algorithms.joint.runner import JointEnvRunner, SampleResult
from benchmark.running.importing import named_own_code
from smarts.errors import OwnCodeError
from smarts.registry import import_own


class _Imports:
    """Paths that are imported wherever this is unpickled."""

    def __init__(self, paths: Sequence[str]) -> None:
        self._paths = tuple(paths)
        import_own(self._paths)

    def __reduce__(self):
        return _Imports, (self._paths,)


class OwnCodeRunner(JointEnvRunner):
    """Answers with errors of own code, which end the run; other errors end the runner, which is restarted."""

    def request(self, state: dict[str, Any] | ray.ObjectRef, steps: int) -> SampleResult:
        """Take over weights and counters, return a fragment."""
        try:
            with named_own_code("the run's own code"):
                return super().request(state, steps)
        except OwnCodeError as error:
            failure = AlgorithmError(error.problem, place=error.place, remedy=error.remedy)
            return SampleResult(self.worker_index, failure, self.get_metrics())


def own_code_runner(paths: Sequence[str]) -> type[JointEnvRunner]:
    """Return the class of environment runners of a run with these files and folders of own code.

    RLlib's runners are actors, whose arguments name classes of the user's: Ray unpickles the actor's class
    first. This one is in no module, so it is pickled whole, with the paths.
    """
    return type("ImportingRunner", (OwnCodeRunner,), {"__module__": __name__, "imports": _Imports(paths)})
