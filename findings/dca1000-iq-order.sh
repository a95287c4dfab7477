#!/usr/bin/env bash
# Two readers of DCA1000 captures mirror each other's range axis.
#
# Guess: the two-lane layout of the DCA1000 is one format, so two libraries make the same complex samples of a file.
# What happens: OpenRadar takes the first two words for I, xwr takes them for Q, because xwr's own firmware setting
# writes Q first. The samples are each other's conjugate times j: a target in range bin 20 of 128 appears in bin 108,
# and Doppler and angle change sign with it. Neither library notices, and nothing in the file says which it is.
# Why it matters: a file recorded with one program and read with the other still shows a sharp target, at a wrong place.
# What to do: keep the order with the recording (`sample_swap=True` in xwr for mmWave Studio's I first). Here: `--iq` is
# required and checked against the leakage near range zero (docs/guides/captures.md, "I/Q order").
source "$(dirname "$0")/lib.sh"
install numpy==1.26.4 scipy==1.13.1 scikit-learn==1.5.2 openradar==1.0.1 xwr==0.5.1
observe <<'PYTHON'
import numpy as np
from mmwave.dataloader import DCA1000
from xwr.rsp import iq_from_iiqq

from finding import report

# One chirp of one receiver, one target in bin 20, in the layout of the two-lane xWR devices with I first: I0 I1 Q0 Q1.
samples = 1000 * np.exp(2j * np.pi * 20 * np.arange(128) / 128)
words = np.empty(256, np.int16)
words[0::4], words[1::4] = samples[0::2].real, samples[1::2].real
words[2::4], words[3::4] = samples[0::2].imag, samples[1::2].imag


def bin_of(x):
    return int(np.argmax(abs(np.fft.fft(np.ravel(x)))))


observed = [
    f"OpenRadar: target in range bin {bin_of(DCA1000.organize(words, 1, 1, 128))}",
    f"xwr: target in range bin {bin_of(iq_from_iiqq(words))}",
    f"xwr with sample_swap=True: target in range bin {bin_of(iq_from_iiqq(words, sample_swap=True))}",
]
report(
    "range bin 20 in both",
    observed,
    [
        "OpenRadar: target in range bin 20",
        "xwr: target in range bin 108",
        "xwr with sample_swap=True: target in range bin 20",
    ],
)
PYTHON
