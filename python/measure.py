"""Measures what docs/guides/python.md promises in seconds: `python measure.py [DATA_SET]`, with the package installed.

It prints one line for each promise. Run it when nothing else runs on the machine.
"""

from __future__ import annotations

import os
import re
import signal
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

# The installed package is measured, not the sources beside this file.
sys.path = [path for path in sys.path if Path(path).resolve() != Path(__file__).resolve().parent]
ROOT = Path(__file__).parents[1]
PLAN = 'name = "x"\nshard_clips = 8\n[[source]]\nkind = "procedural"\ntrain = 4000\nval = 1\ntest = 1\n'


def run(code: str, *arguments: object) -> str:
    command = [sys.executable, "-c", code, *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout


def importing() -> None:
    code = "import time; a = time.perf_counter(); import {}; print(time.perf_counter() - a)"
    for module in ("numpy", "radarllm"):
        run(code.format(module))
        ms = [1e3 * float(run(code.format(module))) for _ in range(11)]
        print(f"import {module}: median {statistics.median(ms):.0f} ms, {min(ms):.0f} to {max(ms):.0f} ms")


def readme() -> None:
    if not (ROOT / "README.md").exists():
        return
    block = (ROOT / "README.md").read_text().split("```python\n")[1].split("```")[0]
    started = time.monotonic()
    printed = run(block)
    print(f"README's Python block: {time.monotonic() - started:.1f} s, printed {printed.strip()!r}")


def two_threads() -> None:
    import radarllm as rl

    model, walk = rl.Model(), rl.simulate("builtin:walk")

    def describe() -> None:
        for _ in range(40):
            model.describe(walk)

    describe()
    ratios = []
    for _ in range(5):
        started = time.perf_counter()
        describe()
        describe()
        alone = time.perf_counter() - started
        threads = [threading.Thread(target=describe) for _ in range(2)]
        started = time.perf_counter()
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        ratios.append((time.perf_counter() - started) / alone)
    print(
        f"two threads that describe, over one after the other: median {statistics.median(ratios):.2f},"
        f" {min(ratios):.2f} to {max(ratios):.2f}, on {os.cpu_count()} cores"
    )


def interrupting() -> None:
    code = (
        "import sys, radarllm as rl\n"
        "plan = rl.DatasetPlan(sys.argv[1])\nplan.n_shards\nprint('ready', flush=True)\n"
        "try:\n    plan.build(sys.argv[2], threads=2)\nexcept KeyboardInterrupt:\n    print('interrupted')\n"
    )
    with tempfile.TemporaryDirectory() as folder:
        plan = Path(folder) / "plan.toml"
        plan.write_text(PLAN)
        seconds = []
        for _ in range(3):
            child = subprocess.Popen(
                [sys.executable, "-c", code, str(plan), folder + "/out"], stdout=subprocess.PIPE, text=True
            )
            assert child.stdout and child.stdout.readline() == "ready\n"
            time.sleep(3.0)
            started = time.monotonic()
            child.send_signal(signal.SIGINT)
            assert child.communicate()[0] == "interrupted\n"
            seconds.append(time.monotonic() - started)
        n_shards = len(list(Path(folder, "out/data").glob("*.parquet")))
        leftovers = [p.name for p in Path(folder, "out").rglob("*") if p.name.endswith(".tmp")]
        print(
            f"Ctrl-C in a build: {min(seconds):.2f} to {max(seconds):.2f} s, {n_shards} shards kept, leftovers {leftovers}"
        )


ROUNDS = """
import gc, sys
import pyarrow as pa
import radarllm as rl

def resident():
    with open("/proc/self/statm") as statm:
        return int(statm.read().split()[1]) * 4096 / 1e6

table = pa.table(rl.simulate("builtin:walk"))

def a_round():
    points = rl.Points.from_arrow(table)
    shared = pa.table(points)
    view = points["x_m"]
    assert shared["x_m"].chunk(0).buffers()[1].address == view.ctypes.data
    del points
    gc.collect()
    assert shared["x_m"].chunk(0)[0].as_py() == view[0]

for _ in range(100):
    a_round()
before = resident()
for _ in range(1000):
    a_round()
print(f"{before:.1f} MB after 100 rounds, {resident():.1f} MB after 1,100")
"""


def memory() -> None:
    try:
        import pyarrow  # noqa: F401
    except ImportError:
        print("memory of tables: not run, pyarrow is not installed")
        return
    os.environ["PYTHONMALLOC"] = "debug"
    print(f"points to tables and views, PYTHONMALLOC=debug: {run(ROUNDS).strip()}")
    del os.environ["PYTHONMALLOC"]


def batches(folder: str) -> None:
    import radarllm as rl

    for batch in rl.batches(folder, seed=1):
        shape = batch.points.shape
        break
    ms = []
    started = time.perf_counter()
    n_clips = 0
    for batch in rl.batches(folder, seed=1):
        ms.append(1e3 * (time.perf_counter() - started))
        n_clips += len(batch)
        started = time.perf_counter()
    total = sum(ms)
    print(
        f"batches of {shape}: {n_clips} clips in {total:.0f} ms with reading and hashing, {total / n_clips:.2f} ms a clip;"
        f" a batch that is in memory takes {statistics.median(ms):.1f} ms"
    )


if __name__ == "__main__":
    print(re.sub(r"\s+", " ", sys.version), flush=True)
    importing()
    readme()
    two_threads()
    interrupting()
    memory()
    if len(sys.argv) > 1:
        batches(sys.argv[1])
