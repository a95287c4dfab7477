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


def files_of(folder):
    # The lock is empty; everything else is compared.
    return {p.relative_to(folder): p.read_bytes() for p in folder.rglob("*") if p.is_file() and p.name != "lock"}


def build_shard(plan, out, shard):
    return plan.build_shard(out, shard)


def test_several_processes_build_the_bytes_of_one(folder, tmp_path):
    import multiprocessing
    import pickle

    plan = rl.DatasetPlan(folder.parent / "plan.toml")
    assert (plan.n_clips, plan.n_shards, len(plan.fingerprint)) == (5, 3, 64)
    out = tmp_path / "out"
    with pytest.raises(FileNotFoundError, match="not prepared"):
        plan.build_shard(out, 0)
    plan.prepare(out)
    # Objects that travel to other processes are the same plan, also without the file.
    again = pickle.loads(pickle.dumps(plan))
    assert again.fingerprint == plan.fingerprint
    with multiprocessing.get_context("spawn").Pool(2) as pool:
        made = pool.starmap_async(build_shard, [(plan, out, 2), (plan, out, 0)]).get(timeout=300)
    assert [entry["split"] for entry in made] == ["test", "train"] and all(entry["made"] for entry in made)
    with pytest.raises(rl.Error, match="1 of 3 shards are missing or damaged: val-00000-of-00001") as raised:
        plan.finish(out)
    assert raised.value.hint and not (out / "manifest.json").exists()
    entry = plan.build_shard(out, 1, threads=2)
    assert (entry["rows"], entry["failed"], len(entry["ids"])) == (1, [], 1)
    assert not plan.build_shard(out, 1)["made"]
    assert plan.finish(out) == {"clips": 5, "failed": 0, "skipped": 0, "shards": 3}
    assert files_of(out) == files_of(folder)


def test_steps_that_do_not_fit_are_refused(folder, tmp_path):
    import fcntl

    plan = rl.DatasetPlan(folder.parent / "plan.toml")
    plan.prepare(tmp_path / "out")
    with pytest.raises(rl.Error, match="no shard 3"):
        plan.build_shard(tmp_path / "out", 3)
    with pytest.raises(OverflowError):
        plan.build_shard(tmp_path / "out", -1)
    with pytest.raises(rl.Error, match="`threads` 0"):
        plan.build_shard(tmp_path / "out", 0, threads=0)
    for wrong in (-1.0, float("nan"), float("inf")):
        with pytest.raises(rl.Error, match="`wait_s`"):
            plan.prepare(tmp_path / "out", wait_s=wrong)
    with pytest.raises(rl.Error, match="an address and not a folder") as raised:
        plan.prepare("s3://bucket/data")
    assert "export" in raised.value.hint
    # Another configuration in the same folder.
    other = tmp_path / "other.toml"
    other.write_text((folder.parent / "plan.toml").read_text().replace("train = 3", "train = 2"))
    with pytest.raises(rl.Error, match="another configuration") as raised:
        rl.DatasetPlan(other).build_shard(tmp_path / "out", 0)
    assert "the same configuration" in raised.value.hint
    # Another version of the package.
    record = tmp_path / "out/.shards/plan.json"
    record.write_text(record.read_text().replace(f'"{rl.__version__}"', '"0.0.1"'))
    with pytest.raises(rl.Error, match="begun by version 0.0.1") as raised:
        plan.build_shard(tmp_path / "out", 0)
    assert "the same program" in raised.value.hint
    with open(tmp_path / "out/.shards/lock") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        with pytest.raises(rl.Error, match="another process is working"):
            plan.finish(tmp_path / "out", wait_s=0.2)
    assert not list((tmp_path / "out/data").iterdir())
