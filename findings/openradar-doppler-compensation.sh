#!/usr/bin/env bash
# OpenRadar's `add_doppler_compensation` cannot be called: it raises a TypeError on every cube of two or three transmitters.
#
# Guess: the call of its docstring rotates the antennas of the second and third transmitter by the phase that the target
# gains between chirps, so that a moving target keeps its direction.
# What happens: the number of antennas is divided with `/`, so that a slice begins at a float. With two transmitters too.
# Why it matters: chirps of transmitters that take turns are apart in time. Without the compensation a target at 1 m/s
# moves in angle, and the directions of everything that walks are wrong. Programs that build on the library either leave
# the step out or have it in a branch that was never run.
# What to do: rotate the antennas of transmitter k by k/n of the Doppler phase. Here: crates/radar-dsp does, and
# studies/side_by_side.py compares the places of a target of known speed.
source "$(dirname "$0")/lib.sh"
install numpy==1.26.4 scipy==1.13.1 scikit-learn==1.5.2 openradar==1.0.1
observe <<'PYTHON'
import numpy as np
from mmwave.dsp import add_doppler_compensation

from finding import report

observed = []
for n_tx in (1, 2, 3):
    # Range bins or detections, antennas, Doppler bins: four receivers, as on every board of this family.
    cube = np.ones((5, 4 * n_tx, 128), complex)
    doppler_bins = np.array([0, 1, 2, 3, 64])
    try:
        result = add_doppler_compensation(cube, n_tx, doppler_bins, 128)
        observed.append(f"{n_tx} transmitters: an array of shape {result.shape}")
    except Exception as problem:
        observed.append(f"{n_tx} transmitters: {type(problem).__name__}: {problem}")
report(
    "arrays of the shapes that went in",
    observed,
    [
        "1 transmitters: an array of shape (5, 4, 128)",
        "2 transmitters: TypeError: slice indices must be integers or None or have an __index__ method",
        "3 transmitters: TypeError: slice indices must be integers or None or have an __index__ method",
    ],
)
PYTHON
