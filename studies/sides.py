#!/usr/bin/env python3
"""What the points say about raised and waving arms: trees that learn simulated clips name left, right and both arms.

    pip install numpy pyarrow scikit-learn
    studies/sides.py work/people-once work/captured-people

The first argument is a data set of procedural motions, from whose training split the trees learn; the second one has the
Bandai-Namco clips, of which those of the validation split are named. Prints how many are named right with the values
of crates/inference/src/tokenizer/layout.rs, without and with its bands of height, and with the motion (raising or waving)
beside the side. The last lines learn from the validation clips themselves, all styles but the one that is named.
"""

import pathlib
import re
import sys

import numpy as np
import pyarrow.parquet as parquet
from sklearn.ensemble import ExtraTreesClassifier

# Columns of a point (crates/dataset/src/shard.rs): x, y, z and range in m, velocity in m/s, intensity in dB.
Z, VELOCITY = 2, 4
MIDDLE_FRAMES = 4
BANDS = [(0.0, 0.3), (0.5, 0.7), (0.7, 0.85), (0.85, 1.0)]
HEIGHTS = [0.03, 0.25, 0.75, 0.9, 0.97]


def placed(frames):
    """Points as offset across and along the line of sight from the middle of the body, height, and speed."""
    frames = [np.array(frame, dtype=float).reshape(-1, 6) for frame in frames]
    rows = []
    for i, frame in enumerate(frames):
        near = np.concatenate(frames[max(0, i - MIDDLE_FRAMES) : i + MIDDLE_FRAMES + 1])
        if not len(frame):
            continue
        middle = np.median(near[:, :2], axis=0)
        ahead = middle / np.hypot(*middle)
        offset = frame[:, :2] - middle
        across = offset @ [ahead[1], -ahead[0]]
        rows.append(np.c_[across, offset @ ahead, frame[:, Z], np.abs(frame[:, VELOCITY])])
    return np.concatenate(rows) if rows else np.zeros((0, 4))


def values(frames):
    """The offsets, then the values of the bands and the heights."""
    points = placed(frames)
    if len(points) < 20:
        return None
    points = points[np.argsort(points[:, 2], kind="stable")]
    across, along, height, speed = points.T
    fast, high = speed >= np.quantile(speed, 0.85), height >= np.quantile(height, 0.9)
    fast_high = high & (speed >= np.quantile(speed, 0.7))
    upper = height > np.median(height)
    mean = lambda chosen: across[chosen].mean() if chosen.any() else 0.0
    offsets = [mean(fast), mean(high), mean(fast_high), np.average(across[upper], weights=speed[upper] ** 2 + 1e-6)]
    offsets += list(np.quantile(across, [0.97, 0.03]))
    bands = []
    for start, end in BANDS:
        of = slice(int(start * len(points)), int(end * len(points)))
        bands += [*np.quantile(across[of], [0.25, 0.75]), along[of].mean(), speed[of].mean()]
    return offsets + bands + list(np.quantile(height, HEIGHTS) - np.median(height))


def side(text):
    """The side that captions state, `None` if it is not clear."""
    left, right = (re.search(rf"\b{word}\b", text) is not None for word in ("left", "right"))
    if left or right:
        return None if left and right else "left" if left else "right"
    return "both" if re.search(r"\b(both|hands|arms)\b", text) else None


def simulated(row):
    named = side(" ".join(row["captions"])) if row["action"] in ("raise_arms", "wave") else None
    return named and (row["action"], named)


def captured(row):
    found = re.search(r"(raise-up|wave)-(both|left|right)", row["id"])
    return found and ({"raise-up": "raise_arms", "wave": "wave"}[found[1]], found[2])


def load(folder, split, label):
    found = []
    for file in sorted((pathlib.Path(folder) / "data").glob(f"{split}-*.parquet")):
        for row in parquet.read_table(file, columns=["id", "action", "captions", "points"]).to_pylist():
            named = label(row)
            measured = named and values(row["points"])
            if measured:
                found.append((row["id"], named, measured))
    ids, names, measured = zip(*found)
    return ids, np.array(names), np.array(measured)


def named(learned, names, asked):
    """Trees name whole clips: motion and side together."""
    trees = ExtraTreesClassifier(500, min_samples_leaf=2, random_state=0)
    joined = trees.fit(learned, ["|".join(name) for name in names]).predict(asked)
    return np.array([name.split("|") for name in joined])


def main(simulated_clips, captured_clips):
    _, learned_names, learned = load(simulated_clips, "train", simulated)
    ids, names, asked = load(captured_clips, "val", captured)
    print(f"{len(learned)} simulated clips, {len(asked)} clips of people")
    for title, columns in (("offsets", slice(0, 6)), ("offsets, bands and heights", slice(None))):
        right = named(learned[:, columns], learned_names, asked[:, columns]) == names
        print(f"{title}: side {right[:, 1].sum()}, motion and side {right.all(axis=1).sum()}")
    styles = np.array([re.search(r"hands?_(\w+?)_\d", clip)[1] for clip in ids])
    right = np.zeros(names.shape, bool)
    for style in sorted(set(styles)):
        others = styles != style
        right[~others] = named(asked[others], names[others], asked[~others]) == names[~others]
    print(f"learned from people's clips of other styles: side {right[:, 1].sum()}, motion and side {right.all(axis=1).sum()}")


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    main(*sys.argv[1:])
