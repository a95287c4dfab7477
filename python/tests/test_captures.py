"""Recordings: cubes, points, reports, closing; arrays through the chain."""

from __future__ import annotations

import numpy as np
import pytest

import radarllm as rl


def opened(files, name):
    path, keywords, _ = files[name]
    return rl.open_capture(path, **keywords)


def test_cubes_come_one_by_one(files, cubes):
    with opened(files, "npy") as capture:
        for _ in range(2):
            read = list(capture)
            assert len(read) == 3 and read[0].dtype == np.complex64
            np.testing.assert_array_equal(np.stack(read), cubes)
        assert capture.report["radar"] == "iwr6843isk" and capture.report["format"] == "npy"
        # What was given belongs to the caller.
        read[0][:] = 0
        np.testing.assert_array_equal(next(iter(capture)), cubes[0])


def test_columns_of_a_table_without_a_header(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("".join(f"{n},a,0.5,2.0,0.25,-0.125,15,{100 * n}\n" for n in range(10)))
    with pytest.raises(rl.Error, match="a table without a header"):
        rl.open_capture(path).points()
    points = rl.open_capture(path, columns="frame,-,x,y,z,velocity,snr,timestamp").points()
    assert len(points) == 10 and points.n_points == 10
    assert points.frame_rate_hz == pytest.approx(10.0)


def test_max_frames_ends_early(files):
    path, keywords, _ = files["npy"]
    with rl.open_capture(path, max_frames=2, **keywords) as capture:
        assert len(list(capture)) == 2 and len(capture.points()) == 2


def test_points_and_report(files):
    with opened(files, "adc") as capture:
        assert isinstance(capture.notes, list)
        points = capture.points()
        assert points == capture.points()
        report = capture.report
        assert (report["frames"], report["damaged_frames"], report["lost_frames"]) == (3, 0, 0)
        assert report["trailing_bytes"] == 0 and report["transfer"] is None
        assert points.radar == "iwr6843isk" and not points.synthetic and points.n_points > 0


def test_a_background_is_subtracted(files):
    with opened(files, "npy") as capture:
        alone = capture.points()
        with_background = capture.points(background=files["npy"][0])
        assert with_background != alone
        assert any("background: mean of 3 frames" in note for note in with_background.notes)
        assert capture.points() == alone


def test_processing_is_a_file(files, tmp_path):
    chain = tmp_path / "chain.toml"
    chain.write_text("[processing]\nmax_points = 5\n")
    with opened(files, "npy") as capture:
        assert max(map(len, map(capture.points(processing=chain).frame, range(3)))) <= 5
        chain.write_text("[processing]\nmax_point = 5\n")
        with pytest.raises(rl.Error, match="max_point"):
            capture.points(processing=chain)
        # A failure is not the end of the capture.
        assert len(capture.points()) == 3


def test_closed_captures_are_not_used_again(files):
    capture = opened(files, "npy")
    cubes = iter(capture)
    next(cubes)
    with capture:
        assert not capture.closed
    capture.close()
    assert capture.closed and repr(capture) == "Capture(closed)"
    for use in (
        lambda: next(cubes),
        lambda: iter(capture),
        capture.points,
        lambda: capture.report,
        lambda: capture.notes,
        capture.__enter__,
    ):
        with pytest.raises(rl.Error, match="this capture is closed"):
            use()


def test_recorded_points(files):
    with opened(files, "uart") as capture:
        points = capture.points()
        assert len(points) == 60 and points.source.startswith("recorded:uart:")
        assert points.notes == capture.notes == capture.report["notes"]
        with pytest.raises(rl.Error, match="holds points, not raw samples") as raised:
            list(capture)
        assert "points()" in raised.value.hint


def test_options_are_named_as_in_python(files, tmp_path):
    path, _, _ = files["npy"]
    with pytest.raises(rl.Error, match="need `radar`"):
        rl.open_capture(path)
    with pytest.raises(rl.Error, match="`frame_rate_hz` is for recorded points"):
        rl.open_capture(path, radar="iwr6843isk", frame_rate_hz=10)
    with pytest.raises(rl.Error, match="`remove_leakage_m` needs raw samples"):
        rl.open_capture(files["uart"][0], radar="iwr6843isk", remove_leakage_m=1).points()
    for wrong in ({"iq": "first"}, {"orientation": "up"}, {"dialect": "x"}, {"lanes": 7}, {"format": "x"}):
        with pytest.raises(rl.Error, match="unknown|no such"):
            rl.open_capture(path, radar="iwr6843isk", **wrong)
    with pytest.raises(TypeError):
        rl.open_capture(path, radars="iwr6843isk")
    # A recording of another radar does not fit.
    with pytest.raises(rl.Error, match="raw.npy"):
        rl.open_capture(path, radar="awr1843boost")


def processed(cubes, **keywords):
    given = {"radar": "iwr6843isk", "synthetic": False, "source": "x", **keywords}
    return rl.process(cubes, **given)


def test_arrays_in_memory_and_in_files_give_the_same_points(files, cubes):
    with opened(files, "npy") as capture:
        expected = capture.points()
    points = processed(cubes)
    for name in rl.Points.columns:
        np.testing.assert_array_equal(points[name], expected[name])
    assert points.source == "recorded:x" and points.frame_rate_hz == expected.frame_rate_hz


def test_arrays_of_any_layout(cubes):
    expected = processed(cubes)
    n_frames, loops, tx, rx, samples = cubes.shape
    chirps = cubes.reshape(n_frames, loops * tx, rx, samples)
    layouts = [
        (cubes.astype("c16"), None),
        (cubes.astype(">c8"), None),
        (np.asfortranarray(cubes), None),
        (np.ascontiguousarray(cubes[..., ::-1])[..., ::-1], None),
        (np.ascontiguousarray(cubes[::-1])[::-1], None),
        (chirps, "frame,chirp,rx,sample"),
        (cubes.transpose(4, 0, 2, 1, 3), "sample,frame,tx,loop,rx"),
        (np.stack([cubes.real, cubes.imag], -1), "frame,loop,tx,rx,sample,iq"),
        (cubes.reshape(n_frames, loops, tx * rx, samples), "frame,loop,virtual,sample"),
        (list(cubes), None),
        ((cube for cube in chirps), "chirp,rx,sample"),
    ]
    for array, axes in layouts:
        assert processed(array, axes=axes) == expected, axes
    assert len(processed(cubes[0], axes="loop,tx,rx,sample")) == 1
    read_only = cubes.copy()
    read_only.flags.writeable = False
    assert processed(read_only) == expected


def test_integers_and_real_samples(cubes):
    counts = np.round(cubes * (2000 / np.abs(cubes).max()))
    parts = np.stack([counts.real, counts.imag], -1)
    axes = "frame,loop,tx,rx,sample,iq"
    expected = processed(parts.astype("f4"), axes=axes)
    assert expected.n_points > 0
    for dtype in ("i2", "f8"):
        assert processed(parts.astype(dtype), axes=axes) == expected
    # Words that a recorder declared as unsigned.
    assert processed(parts.astype("i2").view("u2"), axes=axes) == expected
    assert processed(counts.real.astype("i2")).n_points > 0


def test_the_caller_may_write_into_the_cubes(cubes):
    expected = processed(cubes)
    buffer = np.empty_like(cubes[0])

    def reused():
        for cube in cubes:
            buffer[:] = cube
            yield buffer
            buffer[:] = 0

    assert processed(reused()) == expected


@pytest.mark.parametrize(
    ("change", "keywords", "message"),
    [
        (lambda c: c[:, :, :, :, :-1], {}, "shape"),
        (lambda c: c[0], {}, "expected 5 axes"),
        (lambda c: c, {"axes": "frame,loop,tx,rx,time"}, "axis `time`"),
        (lambda c: c, {"axes": "frame,frame,tx,rx,sample"}, "shape|twice"),
        (lambda c: c.astype("i4"), {}, "elements i4"),
        (lambda c: c.astype("U8"), {}, "elements U"),
        (lambda c: c[:0], {}, "no frame"),
        (lambda c: c * np.nan, {}, "frame 0, element 0 is"),
        (lambda c: [c[0], c[1, :2]], {}, "frame 1 has shape"),
        (lambda c: [c[0], c[1].astype("c16")], {}, "frame 1 has shape"),
        (lambda c: list(c), {"axes": "frame,loop,tx,rx,sample"}, "no axis `frame`"),
        (lambda c: c, {"synthetic": None}, "where the points come from"),
        (lambda c: c, {"radar_height_m": np.nan}, "`radar_height_m`"),
    ],
)
@pytest.mark.filterwarnings("ignore")
def test_wrong_arrays_are_refused(cubes, change, keywords, message):
    with pytest.raises(rl.Error, match=message):
        processed(change(cubes), **keywords)


def test_a_capture_is_no_array(files):
    with opened(files, "npy") as capture, pytest.raises(rl.Error, match="takes arrays") as raised:
        processed(capture)
    assert "capture.points" in raised.value.hint


def test_an_enormous_array_is_refused_before_it_is_copied():
    # 1 TB of zeros that do not exist.
    huge = np.broadcast_to(np.zeros(1, "c8"), (20_000, 96, 3, 4, 128 * 1024))
    with pytest.raises(rl.Error, match="shape"):
        processed(huge)
    with pytest.raises(rl.Error, match="points, at most"):
        rl.Points.from_numpy(
            [np.broadcast_to(np.zeros(1), (10**9, 6))], frame_rate_hz=10, radar="x", synthetic=True
        )
