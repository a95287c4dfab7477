"""How the package runs beside Python: other threads, Ctrl-C, forks, fresh processes."""

from __future__ import annotations

import multiprocessing
import os
import signal
import subprocess
import sys
import threading
import time

import pytest

import radarllm as rl

MOTION = "builtin:wave?side=left"
PLAN = """
name = "small"
shard_clips = 2
[[source]]
kind = "procedural"
train = {train}
val = 1
test = 1
"""


def test_other_threads_run_during_work(walk):
    """While one thread simulates, this one counts: with Python's lock held it could not."""
    started, ended = threading.Event(), threading.Event()

    def simulate():
        started.set()
        rl.simulate("builtin:walk", threads=1)
        ended.set()

    thread = threading.Thread(target=simulate)
    thread.start()
    started.wait()
    counted = 0
    while not ended.is_set():
        counted += 1
        time.sleep(0.001)
    thread.join()
    # The simulation takes far longer than the few steps that a thread gets before it gives up the lock.
    assert counted > 10


def test_two_threads_make_progress_at_once(model, walk):
    """Each of two threads describes while the other does: their times overlap."""
    spans: list[tuple[float, float]] = []
    together = threading.Barrier(2)

    def describe():
        together.wait()
        for _ in range(5):
            start = time.monotonic()
            model.describe(walk)
            spans.append((start, time.monotonic()))

    threads = [threading.Thread(target=describe) for _ in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(spans) == 10
    overlaps = [a for a in spans for b in spans if a is not b and a[0] < b[1] and b[0] < a[1]]
    assert overlaps


def test_the_number_of_threads_changes_nothing(model, walk):
    assert rl.simulate(MOTION, threads=1) == rl.simulate(MOTION, threads=3) == rl.simulate(MOTION)
    captions = [s.caption for s in model.describe([walk] * 3, threads=3)]
    assert captions == [model.describe(walk).caption] * 3


INTERRUPTED = """
import os, signal, sys, threading, time
import radarllm as rl

# A program that a script started in the background ignores the signal.
signal.signal(signal.SIGINT, signal.default_int_handler)

def interrupt():
    # After the work has begun, also on a machine that is busy with other things.
    time.sleep(1.0)
    os.kill(os.getpid(), signal.SIGINT)

threading.Thread(target=interrupt, daemon=True).start()
try:
    {work}
except KeyboardInterrupt:
    print("interrupted")
"""


def interrupted(work: str, cwd) -> None:
    done = subprocess.run(
        [sys.executable, "-c", INTERRUPTED.format(work=work)],
        cwd=cwd,
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert done.stdout == "interrupted\n", done.stderr


@pytest.mark.skipif(os.name != "posix", reason="sends SIGINT")
def test_ctrl_c_stops_work(tmp_path):
    interrupted("while True: rl.simulate('builtin:walk', threads=1)", tmp_path)
    interrupted("rl.Model().describe([rl.simulate('builtin:walk')] * 100_000)", tmp_path)


@pytest.mark.skipif(os.name != "posix", reason="sends SIGINT")
def test_a_build_goes_on_after_ctrl_c(tmp_path):
    (tmp_path / "plan.toml").write_text(PLAN.format(train=400))
    interrupted("rl.DatasetPlan('plan.toml').build('out', threads=1)", tmp_path)
    assert not (tmp_path / "out/manifest.json").exists()
    # What is there is complete.
    assert not [p for p in tmp_path.glob("out/data/*") if p.suffix != ".parquet"]
    (tmp_path / "plan.toml").write_text(PLAN.format(train=2))
    rl.DatasetPlan(tmp_path / "plan.toml").build(tmp_path / "other", threads=1)
    (tmp_path / "plan.toml").write_text(PLAN.format(train=1))
    with pytest.raises(FileExistsError):
        rl.DatasetPlan(tmp_path / "plan.toml").build(tmp_path / "other")
    report = rl.DatasetPlan(tmp_path / "plan.toml").build(tmp_path / "out", overwrite=True)
    assert (report["clips"], report["failed"]) == (3, 0)


def worker(seed: int) -> tuple[int, str, int]:
    points = rl.simulate(MOTION, seed=seed)
    caption = rl.Model().describe([points, points])[0].caption
    return points.n_points, caption, os.getpid()


@pytest.mark.parametrize("method", ["fork", "spawn"])
def test_workers_of_other_processes(method):
    """A child of a fork has none of its parent's threads; it must make its own, not wait for them."""
    if method not in multiprocessing.get_all_start_methods():
        pytest.skip(f"this system cannot {method}")
    expected = [worker(seed)[:2] for seed in (1, 2)]
    with multiprocessing.get_context(method).Pool(2) as pool:
        found = pool.map_async(worker, [1, 2, 1, 2], chunksize=1).get(timeout=300)
    assert [f[:2] for f in found] == expected * 2
    assert os.getpid() not in {f[2] for f in found}
    # The parent's own threads are still there.
    assert worker(1)[:2] == expected[0]


@pytest.mark.skipif(not hasattr(os, "fork"), reason="this system has no fork")
def test_a_fork_of_a_fork():
    rl.simulate(MOTION)

    def child(depth: int) -> int:
        pid = os.fork()
        if pid == 0:
            signal.alarm(200)
            ok = rl.simulate(MOTION).n_points > 0 and (depth == 0 or child(depth - 1) == 0)
            os._exit(0 if ok else 1)
        return os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])

    assert child(1) == 0


class Motions:
    """A data set of PyTorch. Processes that are spawned find it by its name in this module."""

    def __len__(self):
        return 6

    def __getitem__(self, index):
        return rl.simulate(MOTION, seed=index).n_points


def test_loaders_of_torch_by_fork_and_spawn():
    torch = pytest.importorskip("torch", reason="torch is not installed")
    data = torch.utils.data
    expected = None
    for method in ("fork", "spawn"):
        loader = data.DataLoader(Motions(), batch_size=2, num_workers=2, multiprocessing_context=method)
        batches = [batch.tolist() for batch in loader]
        expected = expected or batches
        assert batches == expected


def test_import_is_quick_and_loads_little():
    code = "import sys, radarllm; print([m for m in ('pyarrow', 'torch', 'pandas', 'asyncio') if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120)
    assert done.stdout.strip() == "[]", done.stderr
