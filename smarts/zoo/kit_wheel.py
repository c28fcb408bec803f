"""The wheel of the agents' kit, made from the package that is imported here."""

from __future__ import annotations

import base64
import hashlib
import zipfile
from pathlib import Path

import smarts_agent_kit

NAME = "smarts_agent_kit"
METADATA = f"""\
Metadata-Version: 2.1
Name: {NAME}
Version: {smarts_agent_kit.__version__}
Summary: What an agent needs to act for smarts-bench from a process of its own
License: MIT
Requires-Python: >=3.10
Requires-Dist: numpy>=1.23
Requires-Dist: msgpack>=1.0
"""
WHEEL = "Wheel-Version: 1.0\nGenerator: smarts-bench\nRoot-Is-Purelib: true\nTag: py3-none-any\n"
OLDEST = (1980, 1, 1, 0, 0, 0)
"""The time of all files, so that equal contents are equal wheels."""


def build_wheel(folder: str | Path) -> Path:
    """Write the wheel into a folder, and return its path."""
    stem = f"{NAME}-{smarts_agent_kit.__version__}"
    root = Path(smarts_agent_kit.__file__).parent
    sources = sorted([*root.glob("*.py"), root / "py.typed"])
    files = {f"{NAME}/{file.name}": file.read_bytes() for file in sources}
    files |= {
        f"{stem}.dist-info/METADATA": METADATA.encode(),
        f"{stem}.dist-info/WHEEL": WHEEL.encode(),
    }
    record = f"{stem}.dist-info/RECORD"
    lines = [f"{name},sha256={_digest(content)},{len(content)}" for name, content in files.items()]
    files[record] = "\n".join([*lines, f"{record},,", ""]).encode()
    wheel = Path(folder) / f"{stem}-py3-none-any.whl"
    with zipfile.ZipFile(wheel, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in files.items():
            archive.writestr(zipfile.ZipInfo(name, OLDEST), content)
    return wheel


def _digest(content: bytes) -> str:
    return base64.urlsafe_b64encode(hashlib.sha256(content).digest()).rstrip(b"=").decode()
