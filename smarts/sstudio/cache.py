"""The folder of a scenario's artefacts: complete or absent at any moment, whoever writes and is killed.

build/<key>/                artefacts, never changed once there
build/index/<inputs>.json   which artefacts some inputs lead to
build/.partial-*            being written by the holder of build/.lock, or left behind by the dead
"""

from __future__ import annotations

import fcntl
import json
import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from smarts.errors import ScenarioError

PARTIAL = ".partial-"


@dataclass(frozen=True)
class BuildCache:
    """One folder of artefacts."""

    root: Path

    @classmethod
    def writable(cls, candidates: tuple[Path, ...]) -> BuildCache:
        """Return the cache in the first folder that can be written.

        Raises:
            ScenarioError: None can.
        """
        for root in candidates:
            try:
                (root / "index").mkdir(parents=True, exist_ok=True)
                with tempfile.TemporaryFile(dir=root):
                    return cls(root)
            except OSError:
                continue
        raise ScenarioError(
            "there is no place for the built scenario",
            place=", ".join(map(str, candidates)),
            remedy="make one of these folders writable, or set XDG_CACHE_HOME to a folder that is",
        )

    @contextmanager
    def lock(self) -> Iterator[None]:
        """Keep other processes from building here meanwhile.

        The system lets go when the holder dies, so whatever is half done at that time was left by the dead.
        """
        with open(self.root / ".lock", "w") as handle:
            fcntl.flock(handle, fcntl.LOCK_EX)
            for abandoned in self.root.glob(f"{PARTIAL}*"):
                shutil.rmtree(abandoned, ignore_errors=True)
            for abandoned in (self.root / "index").glob(f"{PARTIAL}*"):
                abandoned.unlink(missing_ok=True)
            yield

    @contextmanager
    def publish(self, key: str) -> Iterator[Path]:
        """Give a folder to write to, which becomes the artefacts of `key` if all goes well."""
        partial = Path(tempfile.mkdtemp(prefix=PARTIAL, dir=self.root))
        try:
            yield partial
            partial.chmod(0o755)
            self._rename(partial, self.root / key)
        finally:
            shutil.rmtree(partial, ignore_errors=True)

    @staticmethod
    def _rename(partial: Path, complete: Path) -> None:
        try:
            partial.rename(complete)
        except OSError:
            # On a file system without locks another process may have been faster, with the same artefacts.
            if not complete.is_dir():
                raise

    def artefacts(self, key: str) -> Path | None:
        """Return the folder of artefacts, if there are any under `key`."""
        folder = self.root / key
        return folder if folder.is_dir() else None

    def read(self, entry: str) -> dict[str, Any] | None:
        """Return an entry of the index, None where there is none."""
        try:
            return json.loads((self.root / "index" / f"{entry}.json").read_text(encoding="utf-8"))
        except (OSError, ValueError):
            return None

    def write(self, entry: str, content: dict[str, Any]) -> None:
        """Put an entry into the index, whole or not at all."""
        descriptor, name = tempfile.mkstemp(prefix=PARTIAL, dir=self.root / "index")
        with os.fdopen(descriptor, "w", encoding="utf-8") as file:
            json.dump(content, file, indent=1)
        os.replace(name, self.root / "index" / f"{entry}.json")
