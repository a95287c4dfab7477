#!/usr/bin/env bash
# OpenRadar's `naive_xyz` moves a person 3 m away up or down by up to 1.1 m, depending on azimuth.
#
# Guess: for a noiseless plane wave at elevation 0, z is 0 at every azimuth, up to the FFT's grid of 2/64.
# What happens: the azimuth row is padded to 64 points before its FFT, the elevated row is not: its padded copy is
# made, but the four bare samples are transformed. The phases of the two peaks belong to different frequencies, so
# z is right only where x/R is a multiple of 1/2 (0, 30 and 90 degrees) and off by up to 0.375 R between.
# Why it matters: at 3 m that is 1.1 m of height, enough to turn a sitting person into a fallen or a standing one, and
# height is what falls are read from.
# What to do: transform the padded row. Here: elevation is the phase between rows at one azimuth (CONVENTIONS.md,
# "Elevation sign"), and every built-in radar is tested over its field of view (crates/synth/tests/it/field_of_view.rs).
source "$(dirname "$0")/lib.sh"
install numpy==1.26.4 scipy==1.13.1 scikit-learn==1.5.2 openradar==1.0.1
observe <<'PYTHON'
import numpy as np
from mmwave.dsp import naive_xyz

from finding import report

# xWR1843: eight azimuth antennas half a wavelength apart, four elevated ones above the third to sixth of them.
observed = []
for azimuth_deg in (0, 5, 10, 14, 20, 25, 30):
    x = np.sin(np.radians(azimuth_deg))
    antennas = np.concatenate([np.arange(8), np.arange(2, 6)])
    waves = np.exp(1j * np.pi * x * antennas)[:, None]
    z = round(3 * naive_xyz(waves)[2][0], 2) + 0.0  # no negative zero
    observed.append(f"azimuth {azimuth_deg} degrees, 3 m: z {z:+.2f} m")
report(
    "z +0.00 m at every azimuth",
    observed,
    [
        "azimuth 0 degrees, 3 m: z +0.00 m",
        "azimuth 5 degrees, 3 m: z -0.42 m",
        "azimuth 10 degrees, 3 m: z -0.84 m",
        "azimuth 14 degrees, 3 m: z -1.12 m",
        "azimuth 20 degrees, 3 m: z +0.70 m",
        "azimuth 25 degrees, 3 m: z +0.28 m",
        "azimuth 30 degrees, 3 m: z +0.00 m",
    ],
)
PYTHON
