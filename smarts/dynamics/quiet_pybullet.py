"""pybullet without its greeting: at its import, its C code prints to standard error when it was built."""

from __future__ import annotations

import os
import sys
from types import ModuleType


def _load() -> ModuleType:
    """Import pybullet while the process's standard error leads nowhere, and restore it.

    What Python has written but not sent yet is sent before, so that it is not lost. Where there is no
    standard error, pybullet has nowhere to print either. A failed import raises as ever.
    """
    try:
        errors = os.dup(2)
    except OSError:
        import pybullet

        return pybullet
    if sys.stderr is not None and not sys.stderr.closed:
        sys.stderr.flush()
    nowhere = os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, 2)
        import pybullet
    finally:
        os.dup2(errors, 2)
        os.close(nowhere)
        os.close(errors)
    return pybullet


pybullet = _load()
