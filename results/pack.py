"""Pack an experiment's finished runs and plays into few files, as git keeps them.

    python results/pack.py results/NAME OUT

`smarts-bench` and `results/recompute.py` read OUT as they read results/NAME; `run` does not repeat what is in
it. Checkpoints and recorded episodes are not packed. Of a test's columns those that metrics need are kept;
measures of many distinct values are rounded to seven digits. Of episodes of held-out variations only outcomes
are kept: no metric of a report needs more.
"""

import shutil
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from benchmark.metrics import METRICS
from benchmark.metrics.table import COUNTS
from benchmark.results.commands import COMMAND
from benchmark.results.files import write_versioned
from benchmark.results.reading import CONDITION, LABELS, MEETS, PLACE, PROGRESS, RUNS, read_results
from benchmark.results.release import RATES
from benchmark.results.robustness import PARTNER, ROBUSTNESS, plays_of
from benchmark.results.run_folder import TABLE

BITS = 24
"""Bits of the significand of a packed measure."""


def pack(root: Path, out: Path) -> None:
    """Write the packed results."""
    runs = read_results(root).finished
    content = {run.place: {"run": run.facts, "config": run.config} for run in runs}
    for run in runs:
        content[run.place][COUNTS] = run.table.attrs[COUNTS]
    plays = {place: (content(), rows()) for place, content, rows in plays_of(root)}
    write_versioned(out / RUNS, content)
    if root != out:
        shutil.copy(root / COMMAND, out)
    write_rows(out / TABLE, compact(joined({run.place: run.table for run in runs})))
    if curves := {run.place: run.progress for run in runs if run.progress is not None}:
        write_rows(out / PROGRESS, joined(curves))
    if plays:
        write_versioned(out / ROBUSTNESS / RUNS, {place: content for place, (content, _) in plays.items()})
        rows = joined({place: rows for place, (_, rows) in plays.items()})
        write_rows(out / ROBUSTNESS / TABLE, compact(rows))


def joined(parts: dict[str, pd.DataFrame]) -> pd.DataFrame:
    """Return the rows of several runs, with a column of their places."""
    return pd.concat([part.assign(**{PLACE: place}) for place, part in parts.items()], ignore_index=True)


def compact(table: pd.DataFrame) -> pd.DataFrame:
    """Return agent-episodes without what no report needs."""
    rates = {name for rate in (*RATES, "generalization") for name in METRICS[rate].needs}
    needed = {name for metric in METRICS.values() for name in metric.needs}
    labels = LABELS | {"outcome", PARTNER, CONDITION, MEETS, PLACE}
    found = table[[name for name in table if name in needed | labels]].copy()
    fine = [name for name in fine_columns(found) if name not in LABELS]
    fraction, exponent = np.frexp(found[fine].to_numpy(float))
    found[fine] = np.ldexp(np.round(np.ldexp(fraction, BITS)), exponent - BITS)
    found.loc[found["split"] == "held_out", [name for name in needed - rates if name in found]] = np.nan
    return found


def fine_columns(table: pd.DataFrame) -> list[str]:
    """Return the columns of numbers most of which differ."""
    return [name for name in table.select_dtypes("float") if table[name].nunique() > len(table) / 12]


def write_rows(file: Path, rows: pd.DataFrame) -> None:
    """Write a table; numbers most of which differ are stored byte by byte."""
    fine = fine_columns(rows)
    pq.write_table(
        pa.Table.from_pandas(rows, preserve_index=False),
        file,
        compression="zstd",
        compression_level=19,
        row_group_size=len(rows),
        use_dictionary=[name for name in rows if name not in fine],
        use_byte_stream_split=fine,
    )


if __name__ == "__main__":
    pack(*map(Path, sys.argv[1:]))
