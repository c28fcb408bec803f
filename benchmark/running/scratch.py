"""Temporary folders that are removed even if their process is killed."""

from __future__ import annotations

import os
import shutil
import subprocess
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

# In a session of its own, and no child of this process: what ends this one does not end it.
_REMOVE_AT_END = 'exec 3<&0; { read -r _ <&3; rm -rf -- "$1"; } </dev/null >/dev/null 2>&1 &'


@contextmanager
def scratch_folder() -> Iterator[Path]:
    """Provide a folder for all temporary files of this process.

    It is removed at the end, or when the process ends, in whatever way: a shell waits for the end of a pipe
    that only this process can write to.
    """
    before = tempfile.tempdir
    folder = Path(tempfile.mkdtemp(prefix="smarts-bench-"))
    lifeline, own_end = os.pipe()
    try:
        subprocess.run(
            ["sh", "-c", _REMOVE_AT_END, "sh", str(folder)],
            stdin=lifeline,
            start_new_session=True,
            check=True,
        )
        tempfile.tempdir = str(folder)
        yield folder
    finally:
        tempfile.tempdir = before
        os.close(lifeline)
        shutil.rmtree(folder, ignore_errors=True)
        os.close(own_end)
