#!/usr/bin/env bash
# fastparquet reads the points of a radar frame as None.
#
# Guess: a column with a list of points (x, y, z, velocity) for every frame is read, or refused with an error.
# What happens: the column has the right name and length, and every value is None, for lists of structs and for lists
# of lists alike. Half floats are read as pairs of raw bytes. pyarrow, polars and DuckDB read the same file correctly.
# Why it matters: a varying number of points is naturally a nested list, and pandas takes fastparquet where pyarrow is
# missing. A data set then looks as if the radar had seen nothing.
# What to do: name the engine. Here: points files have one row for each point, but the column `points` of data-set
# shards is a nested list (crates/dataset/src/shard.rs), so fastparquet cannot be used for it; no page says so yet.
source "$(dirname "$0")/lib.sh"
install numpy==2.4.6 pandas==3.1.1 pyarrow==26.0.1 polars==2.1.0 duckdb==2.0.1 fastparquet==2026.9.0
observe <<'PYTHON'
import duckdb
import fastparquet
import numpy as np
import polars
import pyarrow
import pyarrow.parquet

from finding import report

point = pyarrow.struct([("x", pyarrow.float32()), ("velocity", pyarrow.float32())])
frames = [[{"x": 1.5, "velocity": -0.5}, {"x": 2.0, "velocity": 0.25}], [], [{"x": 3.0, "velocity": 1.0}]]
half = np.array([0.5, -1.25, 3.0], np.float16)
nested = [[[[1.0, 2.0, 0.5], [3.0, 4.0, 0.25]], []], [[[5.0, 6.0, 0.75]]], []]
table = pyarrow.table({
    "structs": pyarrow.array(frames, pyarrow.list_(point)),
    "nested": pyarrow.array(nested, pyarrow.list_(pyarrow.list_(pyarrow.list_(pyarrow.float32(), 3)))),
    "speed": pyarrow.array(half),
})
pyarrow.parquet.write_table(table, "frames.parquet")

written = {"structs": frames, "nested": nested, "speed": [float(v) for v in half]}
duck = duckdb.sql("select structs, nested, speed from 'frames.parquet'").fetchall()
file = fastparquet.ParquetFile("frames.parquet")
read = {
    "pyarrow": pyarrow.parquet.read_table("frames.parquet").to_pydict(),
    "polars": polars.read_parquet("frames.parquet").to_dict(as_series=False),
    "duckdb": {name: [list(v) if name == "nested" else v for v in column] for name, column in zip(written, zip(*duck))},
    "fastparquet": {name: file.to_pandas(columns=[name])[name].tolist() for name in written},
}
observed = [
    f"{reader}: {name} {'as written' if columns[name] == values else columns[name]}"
    for reader, columns in read.items()
    for name, values in written.items()
]
report(
    "all columns as written, or an error",
    observed,
    [f"{reader}: {name} as written" for reader in ("pyarrow", "polars", "duckdb") for name in written]
    + [
        "fastparquet: structs [None, None, None]",
        "fastparquet: nested [None, None, None]",
        "fastparquet: speed [b'\\x008', b'\\x00\\xbd', b'\\x00B']",
    ],
)
PYTHON
