#!/usr/bin/env bash
# Fast farthest point sampling of `fpsample` starts elsewhere than it was told.
#
# Guess: the bucket variants are faster, and otherwise equal: the point at `start_idx` is the first of the samples.
# What happens: for most starts that point is not among the samples at all; the index seems to count points in the
# order of the tree. A list of starts, which the documentation allows, raises TypeError outside of `fps_sampling`.
# Without a start, NumPy's global generator chooses one, so two calls give two samples.
# Why it matters: tokenizers of point clouds start at a chosen point (the strongest, the one nearest to the centre) to
# be reproducible; anchors differ silently if the fast function replaces the plain one.
# What to do: `fps_sampling` with a start; clouds of a radar frame are small. Here: farthest
# points start with the strongest echo, and ties are fixed (crates/inference/src/tokenizer/grouping.rs).
source "$(dirname "$0")/lib.sh"
install numpy==2.4.6 fpsample==1.0.2
observe <<'PYTHON'
import fpsample
import numpy as np

from finding import report

cloud = np.random.default_rng(0).normal(size=(500, 3)).astype(np.float32)
observed = []
for name, options in (
    ("fps_sampling", {}),
    ("fps_npdu_kdtree_sampling", {"w": 64}),
    ("bucket_fps_kdtree_sampling", {}),
    ("bucket_fps_kdline_sampling", {"h": 3}),
):
    sample = getattr(fpsample, name)
    absent = sum(start not in set(map(int, sample(cloud, 16, start_idx=start, **options))) for start in range(500))
    share = "never" if absent == 0 else "in more than 80 %" if absent > 400 else f"in {absent / 5:.0f} %"
    observed.append(f"{name}: the start is absent from the 16 samples {share} of 500 starts")
report(
    "never absent",
    observed,
    [
        "fps_sampling: the start is absent from the 16 samples never of 500 starts",
        "fps_npdu_kdtree_sampling: the start is absent from the 16 samples never of 500 starts",
        "bucket_fps_kdtree_sampling: the start is absent from the 16 samples in more than 80 % of 500 starts",
        "bucket_fps_kdline_sampling: the start is absent from the 16 samples in more than 80 % of 500 starts",
    ],
)
PYTHON
