"""The page that says what is in a recorded episode, made from the schema that writer and reader use.

`python -m smarts.sim.episode_documentation` writes it.
"""

from __future__ import annotations

from pathlib import Path

from smarts.types.episode_schema import TABLES, VERSION

PAGE = Path(__file__).parents[2] / "docs" / "guide" / "episodes.md"

_OPENING = f"""# Recorded episodes

Written by `python -m smarts.sim.episode_documentation` from `smarts/types/episode_schema.py`. This is format
{VERSION}.

`simulation=Options(record=folder)` lets any environment record every episode into a folder of its own below
`folder`, one Parquet file for each table below (those marked "if any" have none where there are no rows);
`smarts.sim.episode_files.RecordedEpisode(folder)` reads them, and
`smarts-bench render EPISODE --out film.gif` draws them. A folder appears when all is in it: a process that
is killed leaves a hidden folder, which the next one to record there takes away. It is called
`seed<S>_world<W>_episode<E>`, with `~2` and so on behind it where there is one of that name, as of another
traffic. What was cut short is kept, too, and `is_complete` is false. Tables carry checksums, and a damaged
one is refused with a `RecordError`. The maps lie beside the episodes as `maps/<map>.npz` and are lane
graphs.

Row `step = k` of vehicles, agents and signals is the state after k steps; k = 0 is the reset. Row `step = k`
of decisions and extras is what was decided on that state, or followed from it until the next decision.
A vehicle is (slot, generation); lanes and edges are numbers in the lane graph. Metrics measure the egos;
holds, transfers and [bubbles](bubbles.md) say which other agents drove which vehicles.
"""


def episodes_page() -> str:
    """Return the page as Markdown."""
    parts = [_OPENING]
    for table in TABLES:
        meaning = f"{table.meaning[0].upper()}{table.meaning[1:]}"
        parts += [f"## {table.name}\n", f"{meaning}{', if any' if table.is_optional else ''}.\n"]
        parts += ["| column | type | unit | meaning |", "|---|---|---|---|"]
        parts += [f"| {c.name} | {c.kind} | {c.unit} | {c.meaning} |" for c in table.columns]
        parts.append("")
    return "\n".join(parts)


if __name__ == "__main__":
    PAGE.write_text(episodes_page())
