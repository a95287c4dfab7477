#!/usr/bin/env python3
"""Fits the probability that a sentence about a recording is right to the confidence of a model.

    pip install scikit-learn
    radarllm eval recordings CONFIG --recordings DIR --model MODEL --json > report.json
    scripts/fit_confidence.py report.json [report.json ...]

MODEL is without confidence.toml, so that the reports have the model's own confidences. Every report, and so every board,
has the same weight. Prints `slope` and `offset` for confidence.toml (crates/radarllm/src/confidence.rs), and the expected
calibration error of each report before and after.
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


def sentences(path):
    """Confidences of the sentences of a report, and whether they are right."""
    with open(path, encoding="utf-8") as file:
        report = json.load(file)
    if report["role"] != "tuning":
        sys.exit(f"{path}: not recordings for tuning")
    segments = [segment for row in report["rows"] for segment in row["segments"] if segment["taught"] is None]
    if not segments:
        sys.exit(f"{path}: no sentences")
    return np.array([s["confidence"] for s in segments]), np.array([s["right"] for s in segments])


def log_odds(confidence):
    limited = np.clip(confidence, NEAREST, 1 - NEAREST)
    return np.log(limited / (1 - limited))[:, None]


def main(paths):
    reports = [sentences(path) for path in paths]
    confidence, right = (np.concatenate(columns) for columns in zip(*reports))
    weight = np.concatenate([np.full(len(r), len(right) / len(reports) / len(r)) for _, r in reports])
    fitted = LogisticRegression(C=10.0).fit(log_odds(confidence), right, sample_weight=weight)
    print(f"slope = {fitted.coef_[0, 0]:.2f}\noffset = {fitted.intercept_[0]:.2f}")
    for path, (own, is_right) in zip(paths, reports):
        before, after = (expected_error(p, is_right) for p in (own, fitted.predict_proba(log_odds(own))[:, 1]))
        print(f"# {path}: {len(own)} sentences, expected calibration error {before:.3f} before, {after:.3f} after")


if __name__ == "__main__":
    if len(sys.argv) < 2:
        sys.exit(__doc__)
    main(sys.argv[1:])
