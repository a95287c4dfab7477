"""How much hangs on the limits by which people are measured? Each is made a quarter lower and higher, and the boards are described.

The limits of `crates/measure` were chosen while looking at the recordings that `eval boards` describes. Where a result holds for
limits that are a quarter off, it does not come from fitting them.

    python3 studies/limits.py CLONE DIR

CLONE is a clean checkout in which nobody works: its sources are changed, built and restored. DIR has the recordings, as
docs/results/boards.md describes.
"""

import pathlib
import re
import subprocess
import sys

# File below crates/measure/src, constant, what it is.
LIMITS = [
    ("posture.rs", "SITTING_M", "below a standing person, standing or sitting"),
    ("posture.rs", "LYING_M", "below a standing person, sitting or lying"),
    ("states.rs", "CHANGE_M", "change of height of another posture"),
    ("states.rs", "WALKING_M", "way in two seconds of who walks, by tracks"),
    ("states.rs", "WALKING_BY_POINTS_M", "the same by points"),
    ("falls.rs", "FALLING_MPS", "downward speed of a fall"),
    ("falls.rs", "FALLEN_M", "below a standing person after a fall"),
    ("falls.rs", "POOL_FALL_M", "fall of the middle of all points"),
    ("falls.rs", "VIEW_LEFT", "share of points that are left out of view"),
]
FACTORS = (0.75, 1.25)
BUILD = "cargo build --release --locked --workspace --features radarllm-cli/train --bin radarllm"


def described(clone, recordings):
    """Share of recordings described right, by board, and false falls of each, as the report prints them."""
    command = ["target/release/radarllm", "eval", "boards", "configs/eval/boards.toml", "--data", recordings]
    run = subprocess.run(command, cwd=clone, capture_output=True, text=True, check=True)
    row = re.compile(r"^\| (.+?) \| no \| \d+ \| ([0-9.]+) \| (\d+) of \d+ \|", re.MULTILINE)
    return {board: (float(share), int(falls)) for board, share, falls in row.findall(run.stdout)}


def line(name, boards):
    shares = [share for share, _ in boards.values()]
    cells = [f"{share:.1f} ({falls})" for share, falls in boards.values()]
    print(f"| {name} | {' | '.join(cells)} | {sum(shares) / len(shares):.1f} |", flush=True)


def main():
    clone, recordings = pathlib.Path(sys.argv[1]), str(pathlib.Path(sys.argv[2]).resolve())
    build = lambda: subprocess.run(BUILD.split(), cwd=clone, check=True, capture_output=True)
    if subprocess.run(["git", "status", "--porcelain"], cwd=clone, capture_output=True, check=True).stdout:
        raise SystemExit(f"{clone}: has changes that would be lost")
    build()
    as_it_is = described(clone, recordings)
    print(f"| limit | {' | '.join(as_it_is)} | mean |\n|{'---|' * (len(as_it_is) + 2)}")
    line("as they are", as_it_is)
    for file, name, meaning in LIMITS:
        path = clone / "crates/measure/src" / file
        text = path.read_text()
        declared = re.search(rf"const {name}: f32 = ([0-9.]+);", text)
        for factor in FACTORS:
            value = float(declared[1]) * factor
            changed = f"const {name}: f32 = {value:.4f};"
            path.write_text(text.replace(declared[0], changed))
            try:
                build()
                line(f"{meaning}: {value:.3g}", described(clone, recordings))
            finally:
                path.write_text(text)
    build()


main()
