"""The environment variables of agents' processes."""

from __future__ import annotations

import os

from smarts_agent_kit.handshake import SECRET

VIEWER = "SMARTS_ENVISION"
"""May hold the token of a viewer's server."""
KEPT = ("PATH", "HOME", "USER", "LANG", "TZ", "TMPDIR", "LD_LIBRARY_PATH", "PYTHONHASHSEED", "SUMO_HOME")
KEPT_PREFIXES = ("LC_", "XDG_", "SMARTS_", "NUMBA_", "CUDA_", "OMP_", "OPENBLAS_", "MKL_")
"""The environment variables that a child process inherits, but for the secret and the viewer's token."""


def clean_environment() -> dict[str, str]:
    """Return the environment variables of child processes: no secrets of the user's among them."""
    return {
        name: value
        for name, value in os.environ.items()
        if (name in KEPT or name.startswith(KEPT_PREFIXES)) and name not in (SECRET, VIEWER)
    }
