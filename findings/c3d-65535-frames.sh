#!/usr/bin/env bash
# A C3D recording of more than 65535 frames loses its end without a word, and one reader finds nothing at all.
#
# Guess: ezc3d writes 70000 frames (11.7 minutes at 100 Hz) and reads 70000 frames; or it refuses to write them.
# What happens: the file holds all samples, but its counters are 16 bits wide and stop at 65535, so ezc3d itself reads
# 65535. The format has parameters for longer recordings (TRIAL:ACTUAL_START_FIELD and ACTUAL_END_FIELD), which ezc3d
# does not write. The package c3d reads such a file as 65535 frames with NumPy 1 and as 0 with NumPy 2, where its
# 16-bit sum wraps.
# Why it matters: motion capture beside a radar runs for a whole session; the ends of both no longer fit together.
# What to do: compare the number of frames with what was recorded, or split recordings. Here: C3D is not read (BVH, AMC,
# AMASS and HumanML3D are).
source "$(dirname "$0")/lib.sh"
install numpy==2.4.6 ezc3d==1.7.2 c3d==0.6.0
observe <<'PYTHON'
import os

import c3d
import ezc3d
import numpy as np

from finding import report

observed = []
for frames in (65534, 65535, 70000):
    out = ezc3d.c3d()
    out["parameters"]["POINT"]["RATE"]["value"] = [100]
    out["parameters"]["POINT"]["LABELS"]["value"] = ["LWRI"]
    points = np.ones((4, 1, frames))
    points[0, 0] = np.arange(frames)
    out["data"]["points"] = points
    out.write("walk.c3d")
    stored = os.path.getsize("walk.c3d") // 16 >= frames
    again = ezc3d.c3d("walk.c3d")["data"]["points"].shape[2]
    with open("walk.c3d", "rb") as file:
        other = sum(1 for _ in c3d.Reader(file).read_frames())
    observed.append(f"{frames} frames written, all stored: {stored}; read by ezc3d: {again}, by c3d: {other}")
report(
    "as many frames read as written, or an error",
    observed,
    [
        "65534 frames written, all stored: True; read by ezc3d: 65534, by c3d: 65534",
        "65535 frames written, all stored: True; read by ezc3d: 65535, by c3d: 0",
        "70000 frames written, all stored: True; read by ezc3d: 65535, by c3d: 0",
    ],
)
PYTHON
