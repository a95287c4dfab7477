"""Data sets: clips, splits, Arrow, damage."""

from __future__ import annotations

import numpy as np
import pytest

import radarllm as rl


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("data")
    plan = folder / "plan.toml"
    plan.write_text('name = "small"\n[[source]]\nkind = "procedural"\ntrain = 3\nval = 1\ntest = 1\n')
    rl.DatasetPlan(plan).build(folder / "small")
    return folder / "small"


def test_clips_of_a_split(folder, model):
    with rl.Dataset(folder) as data:
        assert (data.name, data.radar, data.frame_rate_hz) == ("small", "awr1843boost", 10.0)
        train = data.split("train")
        clips = list(train)
        assert len(train) == len(clips) == 3 and len(list(train)) == 3
        for clip in clips:
            assert clip.split == "train" and clip.captions and clip.action
            assert clip.points.synthetic and clip.points.n_points > 0
            assert clip.joints.dtype == np.float32 and clip.joints.shape[1:] == (22, 3)
        assert len({clip.id for clip in clips}) == 3
        assert model.describe(clips[0].points).caption
        assert data.validate() == []


def test_closed_data_sets_are_not_used_again(folder):
    with rl.Dataset(folder) as data:
        test = data.split("test")
    assert data.closed and repr(data) == "Dataset(closed)"
    for use in (lambda: data.split("test"), data.info, data.validate, lambda: data.name, data.__enter__):
        with pytest.raises(rl.Error, match="this data set is closed"):
            use()
    # A split has all that it needs.
    assert len(list(test)) == 1
    with pytest.raises(rl.Error, match="split 'dev'|split \"dev\""):
        rl.Dataset(folder).split("dev")


def test_damage_is_found(folder, tmp_path):
    import shutil

    copy = tmp_path / "copy"
    shutil.copytree(folder, copy)
    shard = next((copy / "data").glob("train-*.parquet"))
    raw = bytearray(shard.read_bytes())
    raw[len(raw) // 2] ^= 1
    shard.write_bytes(raw)
    problems = rl.Dataset(copy).validate()
    assert problems and "train-" in problems[0]
    shard.write_bytes(raw[: len(raw) // 2])
    with pytest.raises(rl.Error, match="train-"):
        list(rl.Dataset(copy).split("train"))
    (copy / "manifest.json").write_text("{")
    with pytest.raises(rl.Error, match="manifest.json"):
        rl.Dataset(copy)


def test_plans_and_folders_that_do_not_fit(folder, tmp_path):
    plan = tmp_path / "plan.toml"
    plan.write_text("name = 3")
    with pytest.raises(rl.Error, match="plan.toml"):
        rl.DatasetPlan(plan)
    plan.write_text('name = "other"\n[[source]]\nkind = "procedural"\ntrain = 1\nval = 1\ntest = 1\n')
    with pytest.raises(FileExistsError) as raised:
        rl.DatasetPlan(plan).build(folder)
    assert "overwrite=True" in raised.value.hint
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine/letter.txt").write_text("dear")
    with pytest.raises(FileExistsError, match="not a data set"):
        rl.DatasetPlan(plan).build(tmp_path / "mine", overwrite=True)
    assert (tmp_path / "mine/letter.txt").read_text() == "dear"
    with pytest.raises(rl.Error, match="`threads` 0"):
        rl.DatasetPlan(plan).build(tmp_path / "x", threads=0)
    with pytest.raises(rl.Error, match="another process is working"):
        import fcntl

        with open(folder / ".shards/lock") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            rl.DatasetPlan(folder.parent / "plan.toml").build(folder)


def test_splits_are_arrow_streams(folder):
    pa = pytest.importorskip("pyarrow", reason="pyarrow is not installed")
    train = rl.Dataset(folder).split("train")
    table = pa.table(train)
    assert table.num_rows == 3
    clips = list(train)
    assert table["id"].to_pylist() == [clip.id for clip in clips]
    frames = table["points"][0].as_py()
    assert [len(frame) for frame in frames] == np.diff(clips[0].points.offsets).tolist()
    reader = pa.RecordBatchReader.from_stream(train)
    assert reader.schema == table.schema and sum(batch.num_rows for batch in reader) == 3
    import pyarrow.parquet as pq

    shards = sorted((folder / "data").glob("train-*.parquet"))
    assert pa.concat_tables([pq.read_table(s) for s in shards]).to_pylist() == table.to_pylist()
