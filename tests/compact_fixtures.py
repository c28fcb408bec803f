"""Makes the compact episodes in tests/data/envision, which the tests of the page read, too.

`python -m tests.compact_fixtures EPISODE NAME` writes NAME.smarts, and NAME.json with the rows of some steps;
with `END POLICY` behind, the episode up to that time [s] as NAME.smarts alone, for pictures.

`keep_lane` and `gap_acceptance` are test episode 1 of these policies at the intersection among social
vehicles (`smarts-bench run scripted`); `observed` is four agents that keep
their lanes there, with `record_observations`.
"""

import json
import sys
from pathlib import Path

import numpy as np

from smarts.envision.compact_episode import compact_episode, messages_of
from smarts.sim.episode_files import RecordedEpisode
from smarts.stream.container import framed
from tests.compact_reading import CompactEpisode

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


def write_part(episode: Path, name: str, end: float, policy: str) -> None:
    """Write an episode up to a time [s]."""
    recorded = RecordedEpisode(episode)
    data = b"".join(framed(messages_of(recorded, round(end / 0.1), policy)))
    (FOLDER / f"{name}.smarts").write_bytes(data)


if __name__ == "__main__":
    place, named, *part = sys.argv[1:]
    if part:
        write_part(Path(place), named, float(part[0]), part[1])
    else:
        write(Path(place), named)
