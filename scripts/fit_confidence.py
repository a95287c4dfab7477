#!/usr/bin/env python3
"""Fits the probability that a sentence about a recording is right to the confidence of a model.

    pip install scikit-learn
    radarllm eval-recordings CONFIG --recordings DIR --model MODEL --json > report.json
    scripts/fit_confidence.py report.json

MODEL is without confidence.toml, so that the report has the model's own confidences. Prints `slope` and `offset` for
confidence.toml (crates/radarllm/src/confidence.rs), and the expected calibration error before and after.
"""

import json
import sys

import numpy as np
from sklearn.linear_model import LogisticRegression

N_BINS = 10
# NEAREST of crates/radarllm/src/confidence.rs.
NEAREST = 0.01


def expected_error(probability, right):
    bins = np.minimum((probability * N_BINS).astype(int), N_BINS - 1)
    return sum(abs(probability[bins == b].mean() - right[bins == b].mean()) * (bins == b).mean() for b in set(bins))


def main(path):
    with open(path, encoding="utf-8") as file:
        report = json.load(file)
    if report["role"] != "tuning":
        sys.exit(f"{path}: not recordings for tuning")
    segments = [segment for row in report["rows"] for segment in row["segments"] if segment["taught"] is None]
    confidence = np.array([s["confidence"] for s in segments])
    right = np.array([s["right"] for s in segments])
    limited = np.clip(confidence, NEAREST, 1 - NEAREST)
    log_odds = np.log(limited / (1 - limited))[:, None]
    fitted = LogisticRegression(C=10.0).fit(log_odds, right)
    print(f"slope = {fitted.coef_[0, 0]:.2f}\noffset = {fitted.intercept_[0]:.2f}")
    before, after = (expected_error(p, right) for p in (confidence, fitted.predict_proba(log_odds)[:, 1]))
    print(f"# {len(segments)} sentences, expected calibration error {before:.3f} before, {after:.3f} after")


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    main(sys.argv[1])
