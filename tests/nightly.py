"""Runs nightly tests, pages and examples, prints output: `python -m tests.nightly > results/nightly.txt`.

Of pages with nightly blocks all blocks run; examples are those in `examples/nightly/`. Each page and each
example runs in its own process. `make test` runs with the other Pythons that the machine has.
"""

import shutil
import subprocess
import sys
import tempfile
import traceback
from contextlib import chdir
from datetime import UTC, datetime
from pathlib import Path
from textwrap import indent

from tests.blocks import ROOT, Page, blocks_of

PAGES = sorted((ROOT / "docs").rglob("*.md"))
TESTS = [sys.executable, "-m", "pytest", "-q", "-n", "2", "--dist", "worksteal", "-m", "nightly"]
EXAMPLES = sorted((ROOT / "examples" / "nightly").glob("*.py"))
PYTHONS = ("python3.12", "python3.13")


def run_page(page: Path) -> bool:
    """Run all blocks of a page in a temporary folder, print the output, return whether it is as expected."""
    with tempfile.TemporaryDirectory() as folder, chdir(folder):
        sys.path.insert(0, folder)
        try:
            for block, output, seconds in Page(page, Path(folder)).run(nightly=True):
                output = output.replace(folder, ".")
                if output:
                    print(
                        f"{block.place} ({seconds:.0f} s of CPU)\n{indent(output.rstrip(), '    ')}",
                        flush=True,
                    )
        except Exception:
            traceback.print_exc(file=sys.stdout)
            return False
        return True


def main() -> int:
    """Run all pages and examples; return 1 if one failed."""
    commit = subprocess.run(
        ["git", "describe", "--always", "--dirty"], capture_output=True, text=True, check=False
    )
    print(f"# make nightly, {datetime.now(UTC):%Y-%m-%d %H:%M} UTC, commit {commit.stdout.strip()}")
    pages = [page for page in PAGES if any(block.note.startswith("nightly") for block in blocks_of(page))]
    commands = {
        str(page.relative_to(ROOT)): [sys.executable, "-m", "tests.nightly", str(page)] for page in pages
    }
    commands |= {str(example.relative_to(ROOT)): [sys.executable, str(example)] for example in EXAMPLES}
    commands |= {
        f"make test PYTHON={name}": ["make", "test", f"PYTHON={name}", f"VENV=.venv-{name}"]
        for name in PYTHONS
        if shutil.which(name) and subprocess.run([name, "-c", ""], check=False).returncode == 0
    }
    print("\n## Tests marked `nightly`\n", flush=True)
    failed = subprocess.run(TESTS, cwd=ROOT, stdout=sys.stdout, check=False).returncode != 0
    for title, command in commands.items():
        print(f"\n## {title}\n", flush=True)
        failed += subprocess.run(command, cwd=ROOT, stdout=sys.stdout, check=False).returncode != 0
    print(f"\n{len(commands) + 1} run, {failed} failed")
    return failed > 0


if __name__ == "__main__":
    sys.exit(not run_page(Path(sys.argv[1])) if len(sys.argv) > 1 else main())
