"""`radarllm.ray` on two local workers: the bytes of one machine, killed workers and drivers, nodes that differ.

Needs Ray, which is too large for continuous integration.
"""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

import radarllm as rl

os.environ["RAY_USAGE_STATS_ENABLED"] = "0"
os.environ["RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO"] = "0"
ray = pytest.importorskip("ray", reason="Ray is not installed")
rr = pytest.importorskip("radarllm.ray", reason="Ray Data is not installed", exc_type=ImportError)

N_SHARDS = 8
PLAN = """
name = "cluster"
shard_clips = 3
max_frames = 12
facet_edge_m = 0.05
[[source]]
kind = "procedural"
train = 18
val = 3
test = 3
"""
INIT = {"num_cpus": 2, "include_dashboard": False, "log_to_driver": False, "object_store_memory": 100 << 20}


@pytest.fixture(scope="module")
def cluster():
    ray.init(**INIT)
    yield
    ray.shutdown()


@pytest.fixture(scope="module")
def plan(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("plan") / "plan.toml"
    path.write_text(PLAN)
    assert rl.DatasetPlan(path).n_shards == N_SHARDS
    return path


@pytest.fixture(scope="module")
def theirs(run, plan, tmp_path_factory) -> Path:
    """What the command builds in one process."""
    folder = tmp_path_factory.mktemp("theirs") / "data"
    run("dataset", "build", plan, "--out", folder)
    return folder


def same(ours: Path, theirs: Path) -> None:
    found = subprocess.run(["diff", "-r", "--exclude=lock", ours, theirs], capture_output=True, text=True)
    assert (found.returncode, found.stdout, found.stderr) == (0, "", "")


def test_the_bytes_are_those_of_one_process(cluster, plan, theirs, tmp_path):
    report = rr.build(plan, out=tmp_path / "ours")
    assert report.pop("seconds") > 0
    assert report == {"clips": 24, "failed": 0, "skipped": 0, "shards": N_SHARDS, "shards_made": N_SHARDS}
    same(tmp_path / "ours", theirs)
    assert rr.build(rl.DatasetPlan(plan), out=tmp_path / "ours")["shards_made"] == 0
    same(tmp_path / "ours", theirs)


def kill_in_mid_write(folder: Path, of: str, killed: list[int], stop: threading.Event) -> None:
    """SIGKILL the process that writes a file whose name begins so: its number is in the name of the temporary file."""
    while not killed and not stop.is_set():
        try:
            names = os.listdir(folder)
        except FileNotFoundError:
            continue
        for name in names:
            if name.startswith(f".{of}") and name.endswith(".tmp"):
                pid = int(name.split(".")[-3])
                assert pid != os.getpid()
                try:
                    os.kill(pid, signal.SIGKILL)
                except ProcessLookupError:
                    continue
                killed.append(pid)
                return


def killed_worker(folder: Path, of: str, work) -> None:
    killed: list[int] = []
    stop = threading.Event()
    thread = threading.Thread(target=kill_in_mid_write, args=(folder, of, killed, stop))
    thread.start()
    try:
        work()
    finally:
        stop.set()
        thread.join()
    assert killed, "no worker was caught in mid-write"


def test_a_killed_worker_loses_nothing(cluster, plan, theirs, tmp_path):
    out = tmp_path / "ours"
    killed_worker(out / "data", "train-00003", lambda: rr.build(plan, out=out))
    same(out, theirs)


DRIVER = """
import json, sys, ray
import radarllm.ray as rr
ray.init(**json.loads(sys.argv[1]))
print("ready", flush=True)
rr.build(sys.argv[2], out=sys.argv[3]) if sys.argv[4] == "build" else rr.describe(sys.argv[2], out=sys.argv[3], split="train", batch=1)
"""


def killed_driver(arguments: list[object], folder: Path, pattern: str) -> None:
    """Start a driver and SIGKILL it when two files are complete."""
    command = [sys.executable, "-c", DRIVER, json.dumps(INIT), *map(str, arguments)]
    driver = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    try:
        assert driver.stdout and driver.stdout.readline() == "ready\n"
        deadline = time.monotonic() + 120
        while len(list(folder.glob(pattern))) < 2:
            assert driver.poll() is None and time.monotonic() < deadline
            time.sleep(0.002)
        driver.send_signal(signal.SIGKILL)
    finally:
        driver.kill()
        driver.wait()


def test_a_killed_driver_loses_nothing(cluster, plan, theirs, tmp_path):
    out = tmp_path / "ours"
    killed_driver([plan, out, "build"], out / "data", "*.parquet")
    assert not (out / "manifest.json").exists()
    n_there = len(list((out / "data").glob("*.parquet")))
    assert 2 <= n_there < N_SHARDS
    made = rr.build(plan, out=out)["shards_made"]
    assert 0 < made <= N_SHARDS - 1
    same(out, theirs)


def test_a_shard_that_fails_is_named_and_the_others_stay(cluster, plan, theirs, tmp_path):
    out = tmp_path / "ours"
    in_the_way = out / "data/train-00002-of-00006.parquet"
    (in_the_way / "x").mkdir(parents=True)
    (out / ".shards").mkdir()
    with pytest.raises(rl.Error, match=r"shard 2: .*\(tried 2 times\)") as raised:
        rr.build(plan, out=out, max_retries=1)
    assert "kept" in raised.value.hint and not (out / "manifest.json").exists()
    assert len([p for p in (out / "data").glob("*.parquet") if p.is_file()]) == N_SHARDS - 1
    shutil.rmtree(in_the_way)
    assert rr.build(plan, out=out)["shards_made"] == 1
    same(out, theirs)


def test_nodes_that_differ_are_refused(cluster, plan, tmp_path):
    out = tmp_path / "ours"
    opened = rl.DatasetPlan(plan)
    opened.prepare(out)
    for change, message in [
        ({"version": "0.0.1"}, "a node has version .* the coordinator 0.0.1"),
        ({"folder": str(tmp_path / "elsewhere")}, "not prepared"),
    ]:
        task = rr._BuildShard(opened, str(out), 1)
        vars(task).update(change)
        with pytest.raises(rl.Error, match=message) as raised:
            rr._each(task, [0], 0, "shard")
        assert raised.value.hint
    assert list((out / "data").iterdir()) == []


def test_object_stores_are_refused(cluster, plan, theirs, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(rl.Error, match="an address and not a folder") as raised:
        rr.build(plan, out="s3://bucket/data")
    assert "export" in raised.value.hint
    with pytest.raises(rl.Error, match="an address and not a file") as raised:
        rr.describe(theirs, out="s3://bucket/captions.jsonl")
    assert "upload" in raised.value.hint
    assert list(tmp_path.iterdir()) == []


@pytest.fixture(scope="module")
def lines(theirs, model) -> list[dict]:
    """What one process says about the training clips."""
    rows = []
    for clip in rl.Dataset(theirs).split("train"):
        said = model.describe(clip.points).to_dict()
        rows.append({"id": clip.id, **{k: v for k, v in said.items() if k not in ("seconds", "peak_memory_mb")}})
    return rows


def read(path: Path) -> list[dict]:
    return [json.loads(line) for line in path.read_text().splitlines()]


def test_sentences_are_those_of_one_process(cluster, theirs, lines, tmp_path):
    out = tmp_path / "captions.jsonl"
    report = rr.describe(theirs, split="train", out=out, batch=2)
    assert (report["clips"], report["parts"], report["parts_made"]) == (18, 12, 12)
    assert read(out) == lines
    with pytest.raises(FileExistsError):
        rr.describe(theirs, split="train", out=out)
    before = out.read_bytes()
    rr.describe(theirs, split="train", out=out, batch=64, overwrite=True)
    # Neither the size of the parts nor the number of workers is in the result.
    assert out.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == ["captions.jsonl"]


def test_a_killed_worker_loses_no_sentence(cluster, theirs, lines, tmp_path):
    out = tmp_path / "captions.jsonl"
    parts = tmp_path / "captions.jsonl.parts"
    # Any of the parts: the write of a small one is over in no time.
    killed_worker(parts, "0", lambda: rr.describe(theirs, split="train", out=out, batch=1))
    assert read(out) == lines and not parts.exists()


def test_a_killed_driver_loses_no_sentence(cluster, theirs, lines, tmp_path):
    out = tmp_path / "captions.jsonl"
    parts = tmp_path / "captions.jsonl.parts"
    killed_driver([theirs, out, "describe"], parts, "0*.jsonl")
    assert not out.exists()
    # With other arguments it is another call.
    with pytest.raises(FileExistsError, match="parts of another call"):
        rr.describe(theirs, split="train", out=out, batch=2)
    report = rr.describe(theirs, split="train", out=out, batch=1)
    assert 0 < report["parts_made"] <= 16
    assert read(out) == lines and not parts.exists()


def test_what_does_not_fit_is_refused(cluster, theirs, plan, tmp_path):
    with pytest.raises(rl.Error, match="`batch` 0"):
        rr.describe(theirs, out=tmp_path / "c.jsonl", batch=0)
    with pytest.raises(rl.Error, match="`max_retries` -1"):
        rr.build(plan, out=tmp_path / "data", max_retries=-1)
    with pytest.raises(FileNotFoundError):
        rr.describe(theirs, out=tmp_path / "c.jsonl", model=tmp_path / "none")
    with pytest.raises(FileExistsError):
        (tmp_path / "mine.jsonl.parts").mkdir()
        (tmp_path / "mine.jsonl.parts/letter.txt").write_text("dear")
        rr.describe(theirs, out=tmp_path / "mine.jsonl", overwrite=True)
    assert (tmp_path / "mine.jsonl.parts/letter.txt").read_text() == "dear"
    # A changed byte of the data set ends the call with the hash that differs.
    copy = tmp_path / "copy"
    shutil.copytree(theirs, copy)
    (shard,) = (copy / "data").glob("test-*.parquet")
    raw = bytearray(shard.read_bytes())
    raw[len(raw) // 2] ^= 1
    shard.write_bytes(raw)
    with pytest.raises(rl.Error, match="part 0: .*BLAKE3"):
        rr.describe(copy, out=tmp_path / "c.jsonl", max_retries=0)
    assert not (tmp_path / "c.jsonl").exists()
