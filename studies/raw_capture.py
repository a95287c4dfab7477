"""None: it writes a capture of a DCA1000 with two lanes (`adc_data.bin`, I first) of the frames of an array of raw samples, repeated.

    python3 studies/raw_capture.py SAMPLES.npy N_FRAMES CAPTURE
"""

import sys

import numpy as np

FULL_SCALE = 8000


def main():
    samples, n_frames, name = np.load(sys.argv[1]), int(sys.argv[2]), sys.argv[3]
    scale = FULL_SCALE / max(np.abs(samples.real).max(), np.abs(samples.imag).max())
    parts = [np.round(part * scale).astype("<i2") for part in (samples.real, samples.imag)]
    # Two samples at a time: I0 I1 Q0 Q1.
    pairs = [part.reshape(len(samples), -1, 2) for part in parts]
    frames = np.concatenate(pairs, axis=-1).reshape(len(samples), -1)
    with open(name, "wb") as capture:
        for n in range(n_frames):
            capture.write(frames[n % len(frames)].tobytes())


main()
