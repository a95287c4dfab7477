#!/usr/bin/env python3
"""The mean of the weights of two language models, of which one was trained further from the other.

    pip install numpy safetensors blake3
    scripts/mean_weights.py START/lm FURTHER/lm OUT/lm --share 0.5

`--share` is the weight of FURTHER. OUT gets the configuration and the vocabulary of START; it must not exist.
"""

import argparse
import json
import pathlib
import shutil

import numpy as np
from blake3 import blake3
from safetensors.numpy import load_file, save_file

WEIGHTS = "average.safetensors"
KEPT = ["config.json", "tokenizer.json"]


def main(start, further, out, share):
    before, after = load_file(start / WEIGHTS), load_file(further / WEIGHTS)
    shapes = [{name: array.shape for name, array in weights.items()} for weights in (before, after)]
    if shapes[0] != shapes[1]:
        raise SystemExit(f"{start} and {further} are networks of different shapes")
    if (start / "tokenizer.json").read_bytes() != (further / "tokenizer.json").read_bytes():
        raise SystemExit(f"{start} and {further} have different words")
    mean = {}
    for name, array in before.items():
        exact = (1.0 - share) * array.astype(np.float64) + share * after[name].astype(np.float64)
        mean[name] = exact.astype(array.dtype)
    # Everything appears under its final name at once.
    new = out.with_name(out.name + ".tmp")
    out.parent.mkdir(parents=True, exist_ok=True)
    new.mkdir()
    for name in KEPT:
        shutil.copy(start / name, new / name)
    save_file(mean, new / WEIGHTS)
    checksums = {}
    for name in sorted([WEIGHTS, *KEPT]):
        content = (new / name).read_bytes()
        checksums[name] = {"bytes": len(content), "blake3": blake3(content).hexdigest()}
    (new / "checksums.json").write_text(json.dumps(checksums, indent=2), encoding="utf-8")
    new.rename(out)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    for name in ("start", "further", "out"):
        parser.add_argument(name, type=pathlib.Path)
    parser.add_argument("--share", type=float, default=0.5)
    arguments = parser.parse_args()
    if arguments.out.exists():
        raise SystemExit(f"{arguments.out} exists already")
    if not 0.0 <= arguments.share <= 1.0:
        raise SystemExit("--share must be in 0 to 1")
    main(arguments.start, arguments.further, arguments.out, arguments.share)
