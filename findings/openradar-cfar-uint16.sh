#!/usr/bin/env bash
# OpenRadar's CFAR detects every cell of a heat map of 16-bit integers.
#
# Guess: a detector gives the same detections for the same numbers, whatever their type.
# What happens: CASO and CAGO sum the noise cells in the type of the input. Eight cells of 9000 are 72000, which is
# 6464 in uint16, so the noise is estimated as 808 instead of 9000 and every cell exceeds the threshold. CA divides
# before it sums and is right; int64 and float32 are right. Nothing warns.
# Why it matters: range-Doppler heat maps of TI's UART stream are uint16 (TLV 5), and so is the detection matrix that
# OpenRadar's own documents describe.
# What to do: convert to float first. Here: CFAR runs on f32 powers (crates/radar-dsp/src/detect.rs).
source "$(dirname "$0")/lib.sh"
install numpy==1.26.4 scipy==1.13.1 scikit-learn==1.5.2 openradar==1.0.1
observe <<'PYTHON'
import numpy as np
from mmwave import dsp

from finding import report

# 64 cells of even noise and one target.
observed = []
for kind in (np.uint16, np.int64, np.float32):
    cells = np.full(64, 9000, kind)
    cells[32] = 20000
    options = dict(guard_len=2, noise_len=8, l_bound=3000)
    counts = ", ".join(f"{f.__name__} {int(f(cells, **options).sum())}" for f in (dsp.ca, dsp.caso, dsp.cago))
    observed.append(f"{kind.__name__}: detections {counts}; noise of CASO {dsp.caso_(cells, **options)[1][8]:.0f}")
report(
    "one detection and noise 9000 in all",
    observed,
    [
        "uint16: detections ca 1, caso 64, cago 64; noise of CASO 808",
        "int64: detections ca 1, caso 1, cago 1; noise of CASO 9000",
        "float32: detections ca 1, caso 1, cago 1; noise of CASO 9000",
    ],
)
PYTHON
