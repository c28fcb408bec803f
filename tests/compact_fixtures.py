"""Makes the compact episodes in tests/data/envision, which the tests of the page read, too.

`python -m tests.compact_fixtures EPISODE NAME` writes NAME.smarts, and NAME.json with the rows of some steps.
"""

import json
import sys
from pathlib import Path

import numpy as np

from smarts.envision.compact_episode import compact_episode
from smarts.sim.episode_files import RecordedEpisode
from smarts.stream.reading import CompactEpisode

FOLDER = Path(__file__).parent / "data" / "envision"
SHOWN = 4


def expected(data: bytes) -> dict:
    """Return what a reader finds: the number of rows, and the rows of some steps."""
    episode = CompactEpisode(data)
    motion = episode.motion
    steps = np.linspace(0, int(episode.facts["steps"]), SHOWN).astype(int).tolist()
    return {
        "rows": len(motion.step),
        "columns": motion._fields,
        "steps": {
            str(step): np.stack([column[motion.step == step] for column in motion], -1).tolist()
            for step in steps
        },
        "tables": {name: len(next(iter(columns.values()))) for name, columns in episode.tables.items()},
        "vehicles": len(episode.vehicles["number"]),
    }


def write(episode: Path, name: str) -> None:
    """Write the two files of an episode."""
    data = compact_episode(RecordedEpisode(episode))
    FOLDER.mkdir(exist_ok=True)
    (FOLDER / f"{name}.smarts").write_bytes(data)
    (FOLDER / f"{name}.json").write_text(json.dumps(expected(data)) + "\n")


if __name__ == "__main__":
    write(Path(sys.argv[1]), sys.argv[2])
