"""The runs, frames and points of a folder of TI's visualizer, and whether radarllm reads the same.

    python visualizer_folder.py FOLDER              # replay_N.json or pHistBytes_N.bin; the standard library is enough
    python visualizer_folder.py FOLDER RADARLLM     # also compares with `RADARLLM process`; needs pyarrow

Nothing of radarllm is used to read the folder. A run ends where the time stamps of the next JSON file are earlier by more
than a second; in binary pieces, where the frame number falls back or the cycle counter does not go on. The last frame of
each JSON file is not compared, because the visualizer may have stored it before it was turned and raised.
"""

import json
import math
import pathlib
import re
import statistics
import struct
import subprocess
import sys
import tempfile

MAGIC = bytes([2, 1, 4, 3, 6, 5, 8, 7])
# Demos whose SNR is a ratio; in others it is in dB.
RATIO = {"3D People Tracking", "3D People Tracking 6844", "Vital Signs with People Tracking"}


def numbered(folder, pattern):
    found = ((re.fullmatch(pattern, path.name), path) for path in folder.iterdir())
    return sorted((int(match[1]), path) for match, path in found if match)


def points_of(data, height_m, is_ratio):
    """Points of a frame: x, y, z above the radar, velocity, SNR in dB."""
    rows = data.get("pointCloud") or []
    rows = rows + (data.get("pointCloudMinor") or [])
    points = []
    for x, y, z, velocity, snr, *_ in rows:
        if (x, y, velocity, snr) == (0, 0, 0, 0) or not all(map(math.isfinite, (x, y, z, velocity, snr))):
            continue
        db = (10 * math.log10(snr) if snr > 0 else 0.0) if is_ratio else snr
        points.append((x, y, z - height_m, velocity, db))
    return points


def json_runs(files):
    """Runs, the oldest first: names of files, and frames of (number, stamp in s, points, whether it ends its file)."""
    runs, last_s = [], None
    for _, path in files:
        part = json.loads(path.read_text())
        lines = (line.split() for line in part.get("cfg") or [])
        place = [[float(v) for v in words[1:]] for words in lines if words and words[0] == "sensorPosition"]
        # HEIGHT AZIMUTH ELEVATION, or X Y HEIGHT AZIMUTH ELEVATION.
        height_m = place[-1][-3] if place else 0.0
        entries = [e for e in part["data"] if "frameNum" in (e.get("frameData") or {})]
        frames = [
            (e["frameData"]["frameNum"], e["timestamp"] / 1e3, points_of(e["frameData"], height_m, part["demo"] in RATIO), i == len(entries) - 1)
            for i, e in enumerate(entries)
        ]
        if not runs or frames and last_s - frames[0][1] > 1:
            runs.append(([], []))
        runs[-1][0].append(path.name)
        runs[-1][1].extend(frames)
        last_s = frames[-1][1] if frames else last_s
    return sorted(runs, key=lambda run: run[1][0][1])


def packets(data):
    """Frame number and cycle counter of the packets with the header of the SDK."""
    at = data.find(MAGIC)
    while at >= 0 and at + 40 <= len(data):
        _, length, _, number, cycles = struct.unpack_from("<5I", data, at + 8)
        yield number, cycles
        at = data.find(MAGIC, at + max(length, 40))


def binary_runs(files):
    pieces = [(path.name, list(packets(path.read_bytes()))) for _, path in files]
    steps = [(b[1] - a[1]) % 2**32 for _, p in pieces for a, b in zip(p, p[1:]) if b[0] == a[0] + 1]
    step = statistics.median(steps) if steps else 0
    worst = max((abs(s - step) / step for s in steps), default=0) if step else 0
    print(f"cycle counter: a step of {step} cycles, no frame further from it than {worst:.4f} steps")
    runs, last = [], None
    for name, frames in pieces:
        if not frames:
            continue
        is_new = last is None or frames[0][0] < last[0]
        if last and step and not is_new:
            error = (frames[0][1] - last[1] - step * (frames[0][0] - last[0])) % 2**32
            is_new = min(error, 2**32 - error) > step / 2
        if is_new:
            runs.append(([], []))
        runs[-1][0].append(name)
        runs[-1][1].extend((number, None, [], False) for number, _ in frames)
        last = frames[-1]
    return runs[::-1]


def compare(folder, radarllm, index, n_runs, frames):
    import pyarrow.parquet

    with tempfile.TemporaryDirectory() as out:
        out = pathlib.Path(out) / "points.parquet"
        run = ["--run", str(index)] if n_runs > 1 else []
        subprocess.run([radarllm, "process", folder, *run, "--out", out, "--min-speed", "0"], check=True, stderr=subprocess.DEVNULL)
        rows = pyarrow.parquet.read_table(out).to_pylist()
    read = {}
    for row in rows:
        key = ("x_m", "y_m", "z_m", "velocity_mps", "intensity_db")
        read.setdefault(row["frame"], []).append(tuple(row[k] for k in key))
    first = frames[0][0]
    worst, n_same, n_other = 0.0, 0, 0
    for number, _, points, is_last in frames:
        if is_last:
            continue
        same = read.get(number - first, [])
        if len(same) != len(points):
            n_other += 1
            continue
        for a, b in zip(sorted(same), sorted(points)):
            n_same += 1
            worst = max(worst, *(abs(p - q) for p, q in zip(a, b)))
    print(f"    radarllm: {len(rows)} points; {n_same} points differ by at most {worst:.2g}, {n_other} frames have other numbers of points")


def main(folder, radarllm=None):
    folder = pathlib.Path(folder)
    files = numbered(folder, r"replay_(\d+)\.json")
    binary = numbered(folder, r"pHistBytes_(\d+)\.bin")
    runs = json_runs(files) if files else binary_runs(binary)
    for index, (names, frames) in enumerate(runs, 1):
        points = [point for frame in frames for point in frame[2]]
        print(f"run {index} of {len(runs)}: {names[0]} to {names[-1]}, {len(frames)} frames, numbers {frames[0][0]} to {frames[-1][0]}, {len(points)} points")
        if points:
            print(f"    median height above the radar {statistics.median(p[2] for p in points):.3f} m, median SNR {statistics.median(p[4] for p in points):.2f} dB")
        if radarllm and files:
            compare(folder, radarllm, index, len(runs), frames)


if __name__ == "__main__":
    main(*sys.argv[1:])
