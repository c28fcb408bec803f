"""The folder of a scenario's artefacts, written atomically: an artefact is complete or absent.

build/<key>/                artefacts, never changed once there
build/index/<inputs>.json   which artefacts some inputs lead to
build/.partial-*            being written by the holder of build/.lock, or left by a killed process

Artefacts that were unused for `KEPT_DAYS` (neither built nor played) are
deleted when new ones are built.
"""

from __future__ import annotations

import contextlib
import fcntl
import hashlib
import json
import os
import re
import shutil
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from smarts.errors import ScenarioError
from smarts.whole_files import PARTIAL, written_whole

MANIFEST = "manifest.json"
"""The artefact that says what was built."""
KEPT_DAYS = 14
"""Days that unused artefacts are kept."""
_DAY = 86400.0
_KEY = re.compile("[0-9a-f]{16}")


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
            remedy="make one of these folders writable, or set XDG_CACHE_HOME",
        )

    @contextmanager
    def lock(self) -> Iterator[None]:
        """Keep other processes from building here meanwhile.

        The system releases the lock when its holder dies, so partial folders found here are abandoned.
        """
        with open(self.root / ".lock", "w") as handle:
            fcntl.flock(handle, fcntl.LOCK_EX)
            for folder in (self.root, self.root / "index"):
                for abandoned in folder.glob(f"{PARTIAL}*"):
                    shutil.rmtree(abandoned, ignore_errors=True)
            yield

    @contextmanager
    def publish(self, key: str) -> Iterator[Path]:
        """Provide a folder that becomes the artefacts of `key` if the body succeeds."""
        partial = Path(tempfile.mkdtemp(prefix=PARTIAL, dir=self.root))
        try:
            yield partial
            partial.chmod(0o755)
            partial.rename(self.root / key)
        finally:
            shutil.rmtree(partial, ignore_errors=True)

    def artefacts(self, key: str) -> Path | None:
        """Return the folder of the artefacts under `key` if there are any."""
        folder = self.root / key
        note_use(folder)
        return folder if (folder / MANIFEST).is_file() else None

    def prune(self) -> None:
        """Delete artefacts unused for `KEPT_DAYS`, and index entries without artefacts.

        The caller holds the lock. Other folders stay, since a scenario's `build` may also hold files of its
        author.
        """
        keys = set()
        for folder in self.root.iterdir():
            if not _KEY.fullmatch(folder.name) or not (folder / MANIFEST).is_file():
                continue
            if time.time() - folder.stat().st_mtime > KEPT_DAYS * _DAY:
                away = Path(tempfile.mkdtemp(prefix=PARTIAL, dir=self.root))  # atomically
                folder.rename(away / folder.name)
                shutil.rmtree(away, ignore_errors=True)
            else:
                keys.add(folder.name)
        for file in (self.root / "index").glob("*.json"):
            entry = self.read(file.stem) or {}
            if "key" in entry and entry["key"] not in keys:
                file.unlink(missing_ok=True)

    def read(self, entry: str) -> dict[str, Any] | None:
        """Return an entry of the index, None if it is missing or unreadable."""
        try:
            return json.loads((self.root / "index" / f"{entry}.json").read_text(encoding="utf-8"))
        except (OSError, ValueError):
            return None

    def write(self, entry: str, content: dict[str, Any]) -> None:
        """Write an entry of the index atomically."""
        with written_whole(self.root / "index" / f"{entry}.json") as file:
            file.write_text(json.dumps(content, indent=1), encoding="utf-8")


def note_use(folder: Path) -> None:
    """Note that artefacts are used, at most once a day, so that they are not deleted."""
    with contextlib.suppress(OSError):
        if time.time() - folder.stat().st_mtime > _DAY:
            os.utime(folder)


def file_hash(file: Path) -> str | None:
    """Return a fingerprint of a file's content, None if it is no readable file."""
    try:
        # Other files than regular ones might never end.
        return hashlib.blake2b(file.read_bytes(), digest_size=16).hexdigest() if file.is_file() else None
    except OSError:
        return None
