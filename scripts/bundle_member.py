#!/usr/bin/env python3
"""A member of the bundled model from a model and a further training of its language model.

    pip install numpy safetensors blake3
    scripts/bundle_member.py START FURTHER/pretrain/final OUT --share 0.5

START is a model (tokenizer/ and lm/); the second argument is the language model that was trained further from it.
OUT gets the tokenizer of START, and a language model whose weights are the mean of both, with the weight `--share` of
the further one. Rows that only the further one has, those of the tokens of the context, are taken as they are. Weights
are written as F16, half the size of F32. OUT must not exist.
"""

import argparse
import json
import pathlib
import shutil

import numpy as np
from blake3 import blake3
from safetensors.numpy import load_file, save_file

LM_WEIGHTS = "average.safetensors"
TOKENIZER_WEIGHTS = "model.safetensors"


def mean(start, further, share):
    before, after = load_file(start / LM_WEIGHTS), load_file(further / LM_WEIGHTS)
    # A network with tied embeddings has no head.
    for name in before.keys() & after.keys() & {"t5.shared", "t5.head"}:
        before[name] = np.concatenate([before[name], after[name][len(before[name]) :]])
    shapes = [{name: array.shape for name, array in weights.items()} for weights in (before, after)]
    if shapes[0] != shapes[1]:
        raise SystemExit(f"{start} and {further} are networks of different shapes")
    if (start / "tokenizer.json").read_bytes() != (further / "tokenizer.json").read_bytes():
        raise SystemExit(f"{start} and {further} have different words")
    return {
        name: (1.0 - share) * array.astype(np.float64) + share * after[name].astype(np.float64)
        for name, array in before.items()
    }


def halves(weights):
    converted = {name: array.astype(np.float16) for name, array in weights.items()}
    for name, array in converted.items():
        if not np.isfinite(array).all():
            raise SystemExit(f"{name}: a weight is beyond the range of F16")
    return converted


def write(folder, source, kept, weights_name, weights):
    """Writes one of the two folders of a model, with the checksums of its files."""
    folder.mkdir(parents=True)
    for name in kept:
        shutil.copy(source / name, folder / name)
    save_file(halves(weights), folder / weights_name)
    checksums = {}
    for name in sorted([weights_name, *kept]):
        content = (folder / name).read_bytes()
        checksums[name] = {"bytes": len(content), "blake3": blake3(content).hexdigest()}
    (folder / "checksums.json").write_text(json.dumps(checksums, indent=2), encoding="utf-8")


def main(start, further, out, share):
    # Everything appears under its final name at once.
    new = out.with_name(out.name + ".tmp")
    lm = mean(start / "lm", further, share)
    write(new / "lm", further, ["config.json", "tokenizer.json"], LM_WEIGHTS, lm)
    tokenizer = load_file(start / "tokenizer" / TOKENIZER_WEIGHTS)
    write(new / "tokenizer", start / "tokenizer", ["config.json"], TOKENIZER_WEIGHTS, tokenizer)
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
