"""Are the inputs of a folder read as they should be? Each is processed with 10 frames/s where it has no clock of its own, and
frames, points and frame rate, or the message, are compared with what is known of it.

    python3 studies/inputs.py target/release/radarllm FOLDER [OTHER_RADARLLM]

The folder has the inputs that are named below, with invented values; those that are missing are "not run". What they hold was
computed from their bytes by `struct` and NumPy, without this project. A second program, such as an earlier one, is read beside the
first. Needs pyarrow. Ends with 1 if an input that is there is not read right.
"""

import json
import re
import subprocess
import sys
import tempfile
from pathlib import Path

import pyarrow.parquet as parquet

# Frames, points and frames/s; `error` and words of the message; `cfg` and frames/s, with the board where the file names it.
KNOWN = {
    "uart-begins-with-empty-room.bin": (80, 544, 10.0),
    "uart-sdk1-36-byte-header.bin": (60, 500, 10.0),
    "uart-sdk2-out-of-box.bin": (60, 500, 10.0),
    "uart-overhead-3d-counting.bin": (60, 480, 10.0),
    "uart-six-packets-one-byte-short.bin": (60, 480, 10.0),
    "uart-tlv-1000-spherical.bin": (60, 480, 10.0),
    "uart-xwrl6844-44-byte-header.bin": (60, 720, 10.0),
    "csv-frame-numbers-restart.csv": (33, 259, 10.0),
    "csv-one-empty-cell.csv": (25, 198, 10.0),
    "csv-ti-example-script-snr-tenths.csv": (25, 199, 10.0),
    "csv-timestamp-iso.csv": (25, 199, 10.0),
    "csv-timestamp-milliseconds.csv": (25, 199, 10.0),
    "bag-zero-header-stamps.bag": (60, 720, 10.0),
    "visualizer-two-runs": ("error", "2 runs", "--run"),
    "platform-xwr68xx-aop.cfg": ("cfg", 18.18, "iwr6843aop"),
    "two-equal-profiles.cfg": ("cfg", 25.0, None),
    "advanced-frame.cfg": ("cfg", 10.0, None),
    "awr2944-ddm.cfg": ("cfg", 20.0, None),
    "awr2944-tdm-frameCfg-8-values.cfg": ("cfg", 20.0, None),
    "xwrl6432.cfg": ("cfg", 10.0, None),
    "xwrl6844.cfg": ("cfg", 10.0, None),
}
# Inputs whose clock must be found without `--frame-rate`.
HAVE_CLOCK = ("csv-timestamp", "bag-", "visualizer-")
# The SNR of TI's example script is in tenths of dB: 15 to 22 dB.
MAX_SNR_DB = {"csv-ti-example-script-snr-tenths.csv": 22.0}


def run(*command):
    done = subprocess.run(command, capture_output=True, text=True, timeout=120)
    return done.returncode, done.stdout, done.stderr


def read(program, path, folder):
    """What the program makes of an input, and whether that is right."""
    known = KNOWN[path.name]
    if known[0] == "cfg":
        code, out, err = run(program, "radar", "show", str(path), "--json")
        if code != 0 and not out:
            return f"refused: {err.splitlines()[0]}", False
        text = json.dumps(json.loads(out))
        rate = re.search(r'"frame_rate_hz": ([0-9.]+)', text)
        found = float(rate[1]) if rate else 0.0
        is_board = known[2] is None or f'"{known[2]}"' in text
        return f"{found:.2f} frames/s" + ("" if is_board else ", another board"), abs(found - known[1]) < 0.005 and is_board
    points = folder / "points.parquet"
    points.unlink(missing_ok=True)
    rate = [] if path.name.startswith(HAVE_CLOCK) else ["--frame-rate", "10"]
    code, _, err = run(program, "process", str(path), "--out", str(points), *rate)
    if code != 0:
        message = " ".join(line for line in err.splitlines() if line.startswith(("error", "hint")))
        is_right = known[0] == "error" and all(word in message for word in known[1:])
        return f"{'error' if is_right else 'refused'}: {message[:120]}", is_right
    table = parquet.read_table(points)
    meta = {key.decode(): value.decode() for key, value in parquet.read_metadata(points).metadata.items()}
    missing = sum(1 + int(b or a) - int(a) for a, _, b in (part.partition("-") for part in meta.get("missing_frames", "").split(",") if part))
    n_frames = int(meta["n_frames"]) - missing
    found = (n_frames, table.num_rows, round(float(meta["frame_rate"]), 2))
    snr = max(table["intensity_db"].to_pylist(), default=0.0)
    is_snr = snr <= MAX_SNR_DB.get(path.name, snr) + 1e-3
    said = f"{found[0]} frames, {found[1]} points, {found[2]} frames/s" + ("" if is_snr else f", {snr:.0f} dB")
    return said, found == known and is_snr


def main():
    program, folder, *others = sys.argv[1:]
    n_wrong = 0
    for name in KNOWN:
        path = Path(folder) / name
        if not path.exists():
            print(f"| {name} | not run |")
            continue
        row = [name]
        with tempfile.TemporaryDirectory() as scratch:
            for i, each in enumerate([program, *others]):
                said, is_right = read(each, path, Path(scratch))
                row.append(f"{'right' if is_right else 'WRONG'}: {said}")
                n_wrong += i == 0 and not is_right
        print("| " + " | ".join(row) + " |")
    sys.exit(n_wrong > 0)


main()
