"""Batches for training: against the clips of the split, in every order and part; damage."""

from __future__ import annotations

import shutil

import numpy as np
import pytest

import radarllm as rl

PLAN = """
name = "batches"
shard_clips = 2
max_frames = 20
facet_edge_m = 0.05
[[source]]
kind = "procedural"
train = 7
val = 1
test = 1
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("batches")
    (folder / "plan.toml").write_text(PLAN)
    rl.DatasetPlan(folder / "plan.toml").build(folder / "data")
    return folder / "data"


def rows_of(found) -> dict[str, tuple]:
    """Each clip of some batches as it was before padding."""
    rows = {}
    for b in found:
        assert b.points.dtype == np.float32 and b.mask.dtype == bool and b.lengths.dtype == np.int64
        assert b.points.shape == (*b.mask.shape, 6) and b.mask.shape[:2] == (len(b), b.lengths.max())
        assert not b.points[~b.mask].any()
        for i, id in enumerate(b.ids):
            assert id not in rows
            assert not b.mask[i, b.lengths[i] :].any()
            frames = [b.points[i, t][b.mask[i, t]] for t in range(b.lengths[i])]
            rows[id] = (frames, b.captions[i], b.actions[i])
    return rows


def equal(found: dict[str, tuple], expected: dict[str, tuple]) -> None:
    assert found.keys() == expected.keys()
    for id, (frames, captions, action) in expected.items():
        assert found[id][1:] == (captions, action)
        assert len(found[id][0]) == len(frames)
        for a, b in zip(found[id][0], frames):
            np.testing.assert_array_equal(a, b)


@pytest.fixture(scope="module")
def expected(folder):
    clips = list(rl.Dataset(folder).split("train"))
    assert max(len(c.points.frame(i)) for c in clips for i in range(len(c.points))) > 4
    return {c.id: ([c.points.frame(i) for i in range(len(c.points))], c.captions, c.action) for c in clips}


def test_batches_have_the_clips_of_the_split(folder, expected):
    found = list(rl.batches(folder, batch=3))
    assert [len(b) for b in found] == [3, 3, 1]
    assert [id for b in found for id in b.ids] == list(expected)
    equal(rows_of(found), expected)
    with rl.Dataset(folder) as data:
        equal(rows_of(rl.batches(data, batch=100)), expected)
    assert [len(b) for b in rl.batches(folder, batch=3, drop_last=True)] == [3, 3]
    assert len(next(rl.batches(folder, split="test"))) == 1


def test_long_frames_keep_the_strongest_points(folder, expected):
    (b,) = rl.batches(folder, batch=7, max_points=4, max_frames=3)
    assert b.points.shape == (7, 3, 4, 6)
    cut = {}
    for id, (frames, captions, action) in expected.items():
        # `intensity_db`, the last value, decides.
        order = [frame[np.argsort(-frame[:, 5], kind="stable")[:4]] for frame in frames[:3]]
        cut[id] = (order, captions, action)
    equal(rows_of([b]), cut)


def test_seeds_give_orders(folder, expected):
    def order(**keywords):
        return [id for b in rl.batches(folder, batch=2, **keywords) for id in b.ids]

    assert order(seed=1) == order(seed=1) != order()
    assert len({tuple(order(seed=seed)) for seed in range(5)}) > 1
    equal(rows_of(rl.batches(folder, batch=2, seed=9)), expected)


def test_parts_share_the_shards(folder, expected):
    for seed in (None, 3):
        parts = [rows_of(rl.batches(folder, seed=seed, part=(i, 3))) for i in range(3)]
        assert sum(map(len, parts)) == len(expected)
        equal({id: row for part in parts for id, row in part.items()}, expected)
    # More parts than shards.
    assert sum(len(list(rl.batches(folder, part=(i, 9)))) for i in range(9)) == 4


def test_columns_are_read_without_a_copy(folder):
    (piece, *_) = rl.Dataset(folder).split("train")._shard_points(0)
    assert not piece.points.flags.writeable and not piece.frame_offsets.flags.writeable
    assert piece.points.ctypes.data == piece.points.ctypes.data
    points = piece.points
    before = points.copy()
    del piece
    np.testing.assert_array_equal(points, before)


@pytest.mark.parametrize(
    ("keywords", "message"),
    [
        ({"batch": 0}, "`batch` 0"),
        ({"max_points": 0}, "`max_points` 0"),
        ({"max_frames": -1}, "`max_frames` -1"),
        ({"batch": 10**9}, "`batch` 1000000000"),
        ({"part": (1, 1)}, "`part`"),
        ({"seed": -1}, "`seed` -1"),
        ({"split": "dev"}, "unknown"),
    ],
)
def test_wrong_arguments_are_refused_at_once(folder, keywords, message):
    with pytest.raises(rl.Error, match=message):
        rl.batches(folder, **keywords)


def test_a_changed_byte_is_refused_with_a_hint(folder, tmp_path):
    copy = tmp_path / "copy"
    shutil.copytree(folder, copy)
    shard = sorted((copy / "data").glob("train-*.parquet"))[1]
    raw = bytearray(shard.read_bytes())
    raw[len(raw) // 2] ^= 1
    shard.write_bytes(raw)
    data = rl.Dataset(copy)
    for read in (lambda: list(rl.batches(copy)), lambda: list(data.split("train"))):
        with pytest.raises(rl.Error, match="BLAKE3 is .*, the manifest says") as raised:
            read()
        assert raised.value.path == str(shard) and "build it again" in raised.value.hint
    # What is whole can be read.
    assert len(list(data.split("test"))) == 1
    shard.write_bytes(raw[:-1])
    with pytest.raises(rl.Error, match="bytes, the manifest says"):
        list(rl.batches(copy))
    shard.unlink()
    with pytest.raises(FileNotFoundError):
        list(rl.batches(copy))
    with pytest.raises(FileNotFoundError):
        rl.batches(tmp_path / "none")
