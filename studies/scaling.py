"""Measures how building a data set and describing it scale from one worker to two: `python scaling.py [FOLDER]`.

Needs the package, its command and Ray (`pip install "ray[data]"`). Prints one line for each measurement; docs/results/scaling.md has them.
"""

import filecmp
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import radarllm as rl

os.environ["RAY_USAGE_STATS_ENABLED"] = "0"
COMMAND = Path(sys.executable).with_name("radarllm")
# CPU seconds of the commands that were timed last.
cpu_s = 0.0
# Clips of 6 s at 10 frames/s, as the data of the bundled model are made.
PLAN = """
name = "scaling"
shard_clips = 4
max_frames = 60
facet_edge_m = 0.03
[[source]]
kind = "procedural"
train = {train}
val = 0
test = 0
"""
RAY = """
import json, sys, time
started = time.monotonic()
import ray
import radarllm.ray as rr
ray.init(num_cpus=int(sys.argv[1]), include_dashboard=False, log_to_driver=False, object_store_memory=100 << 20)
ready = time.monotonic()
job = json.loads(sys.argv[2])
report = getattr(rr, job.pop("do"))(job.pop("of"), **job)
print("\\n" + json.dumps({"start": ready - started, "work": time.monotonic() - ready, "report": report}))
"""


def timed(*commands: list[object]) -> tuple[float, str]:
    """Seconds until all of some commands have ended that begin at the same time, and what the first one printed."""
    global cpu_s
    before, started = os.times(), time.monotonic()
    running = [subprocess.Popen([str(w) for w in c], stdout=subprocess.PIPE, text=True) for c in commands]
    printed = [r.communicate()[0] for r in running]
    assert all(r.returncode == 0 for r in running)
    after = os.times()
    cpu_s = after.children_user + after.children_system - before.children_user - before.children_system
    return time.monotonic() - started, printed[0]


def on_ray(workers: int, **job: object) -> dict:
    _, printed = timed([sys.executable, "-c", RAY, workers, json.dumps(job)])
    return json.loads(printed.splitlines()[-1])


def same(a: Path, b: Path) -> bool:
    names = sorted(p.relative_to(a) for p in a.rglob("*") if p.is_file() and p.name != "lock")
    others = sorted(p.relative_to(b) for p in b.rglob("*") if p.is_file() and p.name != "lock")
    return names == others and all(filecmp.cmp(a / n, b / n, shallow=False) for n in names)


def building(work: Path, n_clips: int) -> None:
    plan = work / "plan.toml"
    plan.write_text(PLAN.format(train=n_clips))
    seconds: dict[tuple[str, int], float] = {}
    folders = []
    for workers in (1, 2):
        out = work / f"threads-{workers}"
        seconds["threads", workers], _ = timed([COMMAND, "dataset", "build", plan, "--out", out, "--threads", workers])
        folders.append(out)
        if workers == 1:
            total = rl.Dataset(out).info()["total"]
            print(f"one thread: {total['clips']} clips, {total['frames']} frames, {cpu_s:.1f} s of CPU", flush=True)

        out = work / f"processes-{workers}"
        part = [COMMAND, "dataset", "build", plan, "--out", out, "--threads", 1, "--shard"]
        seconds["processes", workers], _ = timed(*[[*part, f"{i + 1}/{workers}"] for i in range(workers)])
        finish, _ = timed([COMMAND, "dataset", "finish", plan, "--out", out])
        seconds["processes", workers] += finish
        folders.append(out)

        out = work / f"ray-{workers}"
        found = on_ray(workers, do="build", of=str(plan), out=str(out))
        seconds["Ray", workers] = found["work"]
        print(f"Ray with {workers} workers: {found['start']:.1f} s until it is there", flush=True)
        folders.append(out)
    clips = rl.Dataset(folders[0]).info()["total"]["clips"]
    for how in ("threads", "processes", "Ray"):
        one, two = seconds[how, 1], seconds[how, 2]
        print(f"build, {how}: {clips} clips in {one:.1f} s with 1, {two:.1f} s with 2, {one / two:.2f} times as fast")
    print("bytes of all six folders:", "the same" if all(same(folders[0], f) for f in folders[1:]) else "different")


def describing(work: Path, folder: Path) -> None:
    split = rl.Dataset(folder).split("train")
    model = rl.Model()
    clips = [clip.points for clip in split]
    started = time.monotonic()
    model.describe(clips, threads=1)
    alone = time.monotonic() - started
    seconds = {}
    for workers in (1, 2):
        job = {
            "do": "describe",
            "of": str(folder),
            "split": "train",
            "batch": 8,
            "out": str(work / f"c-{workers}.jsonl"),
        }
        seconds[workers] = on_ray(workers, **job)["work"]
    same_bytes = filecmp.cmp(work / "c-1.jsonl", work / "c-2.jsonl", shallow=False)
    print(
        f"describe: {len(clips)} clips in {alone:.1f} s without Ray, with Ray {seconds[1]:.1f} s with 1 worker and"
        f" {seconds[2]:.1f} s with 2; bytes {'the same' if same_bytes else 'different'}"
    )


def overheads(work: Path) -> None:
    for n_clips in (1_000, 10_000):
        plan = work / f"plan-{n_clips}.toml"
        plan.write_text(PLAN.format(train=n_clips).replace("shard_clips = 4", "shard_clips = 64"))
        started = time.monotonic()
        opened = rl.DatasetPlan(plan)
        shards = opened.n_shards
        ready = time.monotonic()
        opened.prepare(work / f"prepared-{n_clips}")
        end = time.monotonic()
        print(
            f"plan of {n_clips} clips, {shards} shards: opened in {ready - started:.2f} s, prepared in {end - ready:.3f} s"
        )


def finishing(work: Path, folder: Path) -> None:
    files = list((folder / "data").glob("*.parquet"))
    n_bytes = sum(f.stat().st_size for f in files)
    plan = rl.DatasetPlan(work / "plan.toml")
    _ = plan.n_shards
    started = time.monotonic()
    plan.finish(folder)
    seconds = time.monotonic() - started
    clips = rl.Dataset(folder).info()["total"]["clips"]
    print(
        f"finish: {len(files)} shards, {n_bytes / 1e6:.1f} MB ({n_bytes / clips / 1e3:.0f} kB a clip) in {seconds:.3f} s"
    )


if __name__ == "__main__":
    n_clips = int(os.environ.get("CLIPS", "40"))
    with tempfile.TemporaryDirectory(dir=sys.argv[1] if len(sys.argv) > 1 else None) as name:
        work = Path(name)
        building(work, n_clips)
        finishing(work, work / "threads-1")
        describing(work, work / "threads-1")
        overheads(work)
