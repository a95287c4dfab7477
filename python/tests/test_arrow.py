"""Points as Arrow tables, without a copy."""

from __future__ import annotations

import gc

import numpy as np
import pytest

import radarllm as rl

pa = pytest.importorskip("pyarrow", reason="pyarrow is not installed")


def test_tables_share_the_memory_of_the_columns(walk):
    table = pa.table(walk)
    assert table.column_names == list(rl.Points.columns)
    for name in rl.Points.columns:
        (chunk,) = table[name].chunks
        assert chunk.buffers()[1].address == walk[name].ctypes.data
        assert chunk.null_count == 0
    assert table.schema.metadata[b"source"] == walk.source.encode()


def test_a_table_outlives_its_points():
    points = rl.simulate("builtin:wave?side=left")
    expected = points["x_m"].copy()
    table = pa.table(points)
    del points
    gc.collect()
    np.testing.assert_array_equal(table["x_m"].to_numpy(), expected)


def test_points_return_from_tables(walk):
    again = rl.Points.from_arrow(pa.table(walk))
    assert again.source == walk.source and again.seed == walk.seed and len(again) == len(walk)
    for name in rl.Points.columns:
        np.testing.assert_array_equal(again[name], walk[name])
    bare = pa.table(walk).replace_schema_metadata(None)
    with pytest.raises(rl.Error, match="where the points come from"):
        rl.Points.from_arrow(bare, radar="x")
    with pytest.raises(rl.Error, match="which radar"):
        rl.Points.from_arrow(bare, synthetic=True)
    given = rl.Points.from_arrow(bare, radar="x", frame_rate_hz=10, synthetic=True, source="s", seed=4)
    assert (given.radar, given.source, given.seed) == ("x", "simulated:s", 4)
    # Several chunks, other integer and float types, another order of columns.
    pieces = [bare.slice(0, 7), bare.slice(7)]
    wide = pa.concat_tables(pieces).select(list(reversed(rl.Points.columns)))
    wide = wide.cast(pa.schema([(f.name, pa.int64() if f.name == "frame" else pa.float64()) for f in wide.schema]))
    assert rl.Points.from_arrow(wide, radar="x", frame_rate_hz=10, synthetic=True, source="s", seed=4) == given


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda t: t.drop_columns(["z_m"]), "column `z_m`: expected a 32-bit float, found nothing"),
        (lambda t: t.set_column(2, "x_m", pa.array(["a"] * len(t))), "column `x_m`: expected a 32-bit float"),
        (lambda t: t.set_column(2, "x_m", pa.array([None] * len(t), pa.float32())), "row 0: is null"),
        (lambda t: t.set_column(2, "x_m", pa.array([np.nan] * len(t), pa.float32())), "row 0: is NaN"),
        (lambda t: t.set_column(0, "frame", pa.array(range(len(t), 0, -1), pa.int64())), "column `frame`|t_s"),
        (lambda t: t.set_column(0, "frame", pa.array([-1] * len(t), pa.int64())), "not a whole number"),
    ],
)
def test_wrong_tables_are_refused(walk, change, message):
    with pytest.raises(rl.Error, match=message):
        rl.Points.from_arrow(change(pa.table(walk)))


def test_what_is_no_table_is_refused(walk):
    with pytest.raises(rl.Error, match="has no __arrow_c_stream__") as raised:
        rl.Points.from_arrow([1, 2])
    assert "pyarrow" in raised.value.hint


def test_polars_reads_points(walk):
    pl = pytest.importorskip("polars", reason="polars is not installed")
    frame = pl.DataFrame(walk)
    np.testing.assert_array_equal(frame["velocity_mps"].to_numpy(), walk["velocity_mps"])
    again = rl.Points.from_arrow(frame, radar=walk.radar, frame_rate_hz=10, synthetic=True)
    np.testing.assert_array_equal(again["velocity_mps"], walk["velocity_mps"])


def test_tracks_of_the_board_return_from_tables(tmp_path):
    path = tmp_path / "tracked.csv"
    path.write_text("Frame_count,tid,posy,posz,vely,velz,pointy0,pointz0,snr0\n1,4,2.5,-0.5,0,0,2.4,-0.6,16\n2,4,2.5,-0.6,0,0,,,\n")
    points = rl.open_capture(path, frame_rate_hz=10).points()
    table = pa.table(points)
    assert table.num_rows == 2 and table["x_m"].null_count == 1
    assert [len(tracks) for tracks in table["board_tracks"].to_pylist()] == [1, 1]
    assert rl.Points.from_arrow(table) == points
    large = table["board_tracks"].cast(pa.large_list(table.schema.field("board_tracks").type.value_type))
    position = table.column_names.index("board_tracks")
    assert rl.Points.from_arrow(table.set_column(position, "board_tracks", large)) == points
