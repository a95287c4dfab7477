"""Columns: shared memory, lifetime, and what becomes of wrong arrays."""

from __future__ import annotations

import copy
import gc
import pickle
import subprocess
import sys

import numpy as np
import pytest

import radarllm as rl

COLUMNS = ["x_m", "y_m", "z_m", "range_m", "velocity_mps", "intensity_db"]


def test_columns_are_views_of_one_memory(walk):
    x_m = walk["x_m"]
    assert x_m.dtype == np.float32 and x_m.shape == (walk.n_points,)
    assert walk["x_m"].ctypes.data == x_m.ctypes.data
    assert walk["frame"].dtype == np.uint32 and walk["t_s"].dtype == np.float64
    assert rl.Points.columns == ("frame", "t_s", *COLUMNS)
    for name in rl.Points.columns:
        assert not walk[name].flags.writeable and not walk[name].flags.owndata
        with pytest.raises(ValueError):
            walk[name][0] = 1
    with pytest.raises(ValueError):
        x_m.flags.writeable = True
    with pytest.raises(KeyError, match="velocity_mps"):
        walk["velocity"]


def test_frames_and_columns_hold_the_same_values(walk):
    assert walk.offsets.dtype == np.int64 and walk.offsets.shape == (len(walk) + 1,)
    assert walk.offsets[0] == 0 and walk.offsets[-1] == walk.n_points
    for index in (0, len(walk) // 2, -1):
        frame = walk.frame(index)
        start, end = walk.offsets[index : index + 2] if index >= 0 else walk.offsets[-2:]
        assert frame.dtype == np.float32 and frame.flags.writeable
        np.testing.assert_array_equal(frame, np.stack([walk[c][start:end] for c in COLUMNS], axis=1))
        assert (walk["frame"][start:end] == walk.frame_numbers[index]).all()
        assert (walk["t_s"][start:end] == walk.times_s[index]).all()
    for wrong in (len(walk), -len(walk) - 1):
        with pytest.raises(IndexError):
            walk.frame(wrong)


def test_a_view_outlives_its_points():
    points = rl.simulate("builtin:wave?side=left")
    view, expected = points["y_m"], points["y_m"].copy()
    offsets = points.offsets
    del points
    gc.collect()
    np.testing.assert_array_equal(view, expected)
    assert offsets[-1] == len(expected)


LIFETIME = """
import gc, resource
import numpy as np
import radarllm as rl

rng = np.random.default_rng(0)
frames = [rng.normal(size=(50, 6)).astype("f4") for _ in range(40)]

def once():
    points = rl.Points.from_numpy(frames, frame_rate_hz=10, radar="x", synthetic=True)
    views = [points[c] for c in points.columns] + [points.offsets, points.times_s, points.frame_numbers]
    streams = [points.__arrow_c_stream__() for _ in range(3)]
    again = rl.Points.from_arrow(points)
    total = sum(float(v.sum()) for v in views)
    del points
    return total, sum(float(v.sum()) for v in views), again.n_points

def peak():
    gc.collect()
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss

first = once()
for _ in range(200):
    assert once() == first
before = peak()
for _ in range(1000):
    assert once() == first
# 1,000 rounds of 48 kB of columns would be 48 MB.
assert peak() - before < 16_000, (before, peak())
"""


@pytest.mark.skipif(sys.platform != "linux", reason="measures memory in kB, as Linux reports it")
def test_memory_stays_flat_under_the_debugging_allocator():
    done = subprocess.run(
        [sys.executable, "-c", LIFETIME],
        env={"PYTHONMALLOC": "debug", "PATH": ""},
        capture_output=True,
        text=True,
        timeout=600,
    )
    assert done.returncode == 0, done.stderr


def frames_of(points):
    return [points.frame(i) for i in range(len(points))]


def test_arrays_of_any_layout_give_the_same_points(walk):
    def made(convert):
        return rl.Points.from_numpy(
            [convert(frame) for frame in frames_of(walk)],
            frame_rate_hz=walk.frame_rate_hz,
            radar=walk.radar,
            synthetic=True,
            source="a test",
        )

    plain = made(lambda f: f)
    assert plain.synthetic and plain.source == "simulated:a test"
    for name in COLUMNS:
        np.testing.assert_array_equal(plain[name], walk[name])
    read_only = np.array

    def locked(frame):
        frame = read_only(frame)
        frame.flags.writeable = False
        return frame

    layouts = {
        "Fortran order": np.asfortranarray,
        "float64": lambda f: f.astype("f8"),
        "other byte order": lambda f: f.astype(">f4"),
        "negative steps": lambda f: np.ascontiguousarray(f[::-1, ::-1])[::-1, ::-1],
        "every second row": lambda f: np.repeat(f, 2, axis=0)[::2],
        "read-only": locked,
        "lists": lambda f: f.tolist(),
    }
    for layout, convert in layouts.items():
        assert made(convert) == plain, layout


def test_the_arrays_are_copied(walk):
    frames = frames_of(walk)
    points = rl.Points.from_numpy(frames, frame_rate_hz=10, radar="x", synthetic=False)
    before = points["x_m"].copy()
    for frame in frames:
        frame[:] = 0
    np.testing.assert_array_equal(points["x_m"], before)


@pytest.mark.parametrize(
    ("frame", "message"),
    [
        (np.zeros((3, 5), "f4"), r"frame 1: shape \[3, 5\], expected \(n, 6\)"),
        (np.zeros(6, "f4"), r"frame 1: shape \[6\]"),
        (np.zeros((2, 3, 6), "f4"), r"frame 1: shape \[2, 3, 6\]"),
        (np.zeros((3, 6), "c8"), "frame 1: elements complex64"),
        (np.zeros((3, 6), bool), "frame 1: elements bool"),
        (np.full((3, 6), "x"), "frame 1: elements <U1"),
        (np.full((3, 6), np.nan, "f4"), "frame 1, point 0: `x_m` is NaN"),
        (np.array([[0, 0, 0, 0, np.inf, 0]]), "frame 1, point 0: `velocity_mps` is inf"),
        (np.array([[0, 0, 0, 0, 0, 1e300]]), "frame 1, point 0: `intensity_db` is inf"),
    ],
)
def test_wrong_arrays_are_refused(frame, message):
    good = np.zeros((2, 6), "f4")
    with np.errstate(over="ignore"), pytest.raises(rl.Error, match=message):
        rl.Points.from_numpy([good, frame], frame_rate_hz=10, radar="x", synthetic=False)


@pytest.mark.parametrize(
    ("keywords", "message", "hint"),
    [
        ({"synthetic": None}, "where the points come from is not known", "synthetic=True if a simulator"),
        ({"frame_rate_hz": 0}, "`frame_rate_hz` 0: must be finite and positive", None),
        ({"frame_rate_hz": float("nan")}, "`frame_rate_hz` NaN", None),
        ({"radar_height_m": float("inf")}, "`radar_height_m` is inf", None),
        ({"times_s": [0.0]}, "`times_s`: 1 times for 2 frames", None),
        ({"times_s": [1.0, 0.5]}, "`times_s`: frame 1 is at 0.5 s after 1 s", None),
        ({"seed": 3}, "`seed`: a recording has none", None),
    ],
)
def test_wrong_keywords_are_refused(keywords, message, hint):
    frames = [np.zeros((2, 6), "f4")] * 2
    given = {"frame_rate_hz": 10, "radar": "x", "synthetic": False, **keywords}
    with pytest.raises(rl.Error) as raised:
        rl.Points.from_numpy(frames, **given)
    assert message in str(raised.value)
    assert (raised.value.hint is None) == (hint is None)
    assert hint is None or hint in raised.value.hint
    with pytest.raises(TypeError):
        rl.Points.from_numpy(frames, 10.0, "x")


def test_frames_without_points_stay():
    frames = [np.zeros((0, 6)), [], np.ones((2, 6)), np.zeros((0, 6))]
    points = rl.Points.from_numpy(frames, frame_rate_hz=20, radar="x", synthetic=False, source="room")
    assert len(points) == 4 and points.offsets.tolist() == [0, 0, 0, 2, 2]
    assert points.frame(0).shape == (0, 6) and points.times_s.tolist() == [0, 0.05, 0.1, 0.15]
    assert rl.Points.from_arrow(points) == points
    empty = rl.Points.from_numpy([], frame_rate_hz=20, radar="x", synthetic=False)
    assert len(empty) == 0 and empty["x_m"].shape == (0,) and empty.offsets.tolist() == [0]


def test_files_are_written_whole_and_not_replaced(walk, tmp_path):
    path = tmp_path / "points.parquet"
    walk.write(path)
    read = rl.Points.read(path)
    assert read.source == walk.source and read.seed == walk.seed == 1
    for name in rl.Points.columns:
        np.testing.assert_array_equal(read[name], walk[name])
    with pytest.raises(FileExistsError) as raised:
        walk.write(path)
    assert isinstance(raised.value, rl.Error)
    assert raised.value.path == str(path) and "overwrite=True" in raised.value.hint
    walk.write(path, overwrite=True)
    assert [p.name for p in tmp_path.iterdir()] == ["points.parquet"]
    with pytest.raises(FileNotFoundError):
        rl.Points.read(tmp_path / "none.parquet")
    path.write_bytes(path.read_bytes()[:-9])
    with pytest.raises(rl.Error, match="points.parquet"):
        rl.Points.read(path)


def test_points_survive_copies_and_other_processes(walk, model):
    for again in (copy.deepcopy(walk), pickle.loads(pickle.dumps(walk))):
        assert again == walk and again is not walk
        assert model.describe(again).caption == model.describe(walk).caption
    assert walk != 3 and walk != rl.simulate("builtin:wave?side=left")


def test_the_page_is_inline(walk, model):
    for shown in (walk, model.describe(walk)):
        page, inline = shown.to_html(), shown._repr_html_()
        assert page.startswith("<!doctype html>") and "awr1843boost" in page
        assert inline.startswith('<iframe sandbox="allow-scripts"') and "srcdoc=" in inline
        # The page cannot leave its attribute.
        assert inline.count('"') == 6
    assert model.describe(walk).caption in model.describe(walk).to_html()


TRACKED = """Session_ID,Recording_Number,Frame_count,tid,posy,posz,vely,velz,pointy0,pointz0,snr0,pointy1,pointz1,snr1
7,1,65,0,2.5,-0.5,0.1,-1.2,2.4,-0.6,16.5,2.6,-0.4,12
7,1,66,0,2.5,-0.6,0.1,-1.3,,,,,,
7,1,66,1,4,0.3,0,0,,,,,,
7,1,67,0,2.5,-0.7,0.1,0,2.4,-0.6,16.5,,,
"""


def test_tracks_of_the_board_are_kept(tmp_path, walk):
    path = tmp_path / "tracked.csv"
    path.write_text(TRACKED)
    points = rl.open_capture(path, frame_rate_hz=10).points()
    # The second frame has two tracks and no point.
    assert len(points) == 3 and points.n_points == 3 and len(points["x_m"]) == 3
    assert list(points.offsets) == [0, 2, 2, 3]
    tracks = points.tracks
    assert tracks["frame"].tolist() == [0, 1, 1, 2] and tracks["id"].tolist() == [0, 0, 1, 0]
    np.testing.assert_allclose(tracks["y_m"], [2.5, 2.5, 4.0, 2.5])
    np.testing.assert_allclose(tracks["z_m"], [-0.5, -0.6, 0.3, -0.7], rtol=1e-6)
    np.testing.assert_allclose(tracks["vz_mps"], [-1.2, -1.3, 0.0, 0.0], rtol=1e-6)
    points.write(tmp_path / "tracked.parquet")
    again = rl.Points.read(tmp_path / "tracked.parquet")
    assert again == points and pickle.loads(pickle.dumps(points)) == points
    for name, values in tracks.items():
        np.testing.assert_array_equal(again.tracks[name], values)
    assert all(len(values) == 0 for values in walk.tracks.values())
