#!/usr/bin/env bash
# The CFAR detectors of two radar packages do not keep the false-alarm probability that they are given.
#
# Guess: in noise alone, the share of cells above a CFAR threshold is about the stated probability, whatever the length of
# the signal and the kind of averaging.
# What happens: mmWrt's `cfar_1D_convolve` trains on all cells of the signal but the ones near the tested one, and divides by
# a fixed number, so that the threshold grows with the length: at a stated 0.1, seven of ten noise cells are above it in 64
# cells, and one of two thousand in 1024. scikit-radar's CAGO takes the larger of two means with the factor of their
# average, so that it alarms two to four times less often than stated; its CA is right.
# Why it matters: detectors decide which points a simulated radar reports. Points of a data set made with the first depend
# on the number of range bins, and two data sets with the same stated probability are not alike.
# What to do: measure the false alarms of a detector in noise. Here: a test counts those of every detector
# (crates/radar-dsp/tests/it/detection.rs).
source "$(dirname "$0")/lib.sh"
install numpy==2.4.6 scipy==1.17.1 matplotlib==3.11.2 mmwrt==0.0.14 scikit-radar==0.0.2
observe <<'PYTHON'
import numpy as np
from mmWrt.RadarSignalProcessing import cfar_1D_convolve
from skradar.detection.cfar import CFARConfig, CFARMode, cfar_threshold

from finding import report

generator = np.random.default_rng(1)


# Magnitudes of complex noise of power 1.
def noise(n):
    return np.abs(generator.standard_normal(n) + 1j * generator.standard_normal(n)) / np.sqrt(2)


def ratio(share, stated):
    return f"{share / stated:.1f}" if share > 0.05 * stated else f"{share / stated:.0e}"


observed = []
for n in (64, 256, 1024):
    signals = [noise(n) for _ in range(102_400 // n)]
    share = np.mean([np.mean(signal > np.asarray(cfar_1D_convolve(signal))) for signal in signals])
    observed.append(f"mmWrt, stated 0.1, {n} cells: {ratio(share, 0.1)} times as many")
long = noise(4_000_000)
for mode in (CFARMode.CA, CFARMode.CAGO):
    for stated in (1e-2, 1e-4):
        share = np.mean(long > cfar_threshold(long, CFARConfig(mode, 8, 2, stated)))
        observed.append(f"scikit-radar {mode.name}, stated {stated:g}: {ratio(share, stated)} times as many")
report(
    "about as many false alarms as stated in all",
    observed,
    [
        "mmWrt, stated 0.1, 64 cells: 7.1 times as many",
        "mmWrt, stated 0.1, 256 cells: 1.4 times as many",
        "mmWrt, stated 0.1, 1024 cells: 5e-03 times as many",
        "scikit-radar CA, stated 0.01: 1.0 times as many",
        "scikit-radar CA, stated 0.0001: 1.0 times as many",
        "scikit-radar CAGO, stated 0.01: 0.5 times as many",
        "scikit-radar CAGO, stated 0.0001: 0.3 times as many",
    ],
)
PYTHON
