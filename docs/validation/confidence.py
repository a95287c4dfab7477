"""Fits the confidence in sentences about recorded radar (`confidence.toml` of a model).

    radarllm eval-recordings CONFIG --recordings DIR --model MODEL --json > report.json     # without confidence.toml
    python confidence.py report.json... > MODEL/confidence.toml

The probability that a sentence is right is a logistic function of the log-odds of the model's confidence (Platt,
"Probabilistic outputs for support vector machines", 1999). Every report has the same weight, every sentence the weight
of its duration. Only recordings for tuning may be used.
"""

import json
import math
import sys

UNSURE_BELOW = 0.25


def pairs(path):
    report = json.load(open(path))
    if report["role"] != "tuning":
        sys.exit(f"{path}: not recordings for tuning")
    found = [
        (math.log(s["confidence"] / (1 - s["confidence"])), s["right"], s["end_s"] - s["start_s"])
        for row in report["rows"]
        for s in row["segments"]
        if 0 < s["confidence"] < 1
    ]
    total = sum(weight for _, _, weight in found)
    return [(x, right, weight / total) for x, right, weight in found]


def fit(data, steps=100):
    """Newton's method on the log-likelihood, with a weak prior that keeps the slope finite."""
    slope, offset = 1.0, 0.0
    for _ in range(steps):
        g = [1e-3 * (slope - 1), 0.0]
        h = [[1e-3, 0.0], [0.0, 1e-9]]
        for x, right, weight in data:
            p = 1 / (1 + math.exp(-(offset + slope * x)))
            for i, a in enumerate((x, 1.0)):
                g[i] += weight * (p - right) * a
                for j, b in enumerate((x, 1.0)):
                    h[i][j] += weight * p * (1 - p) * a * b
        det = h[0][0] * h[1][1] - h[0][1] * h[1][0]
        slope -= (h[1][1] * g[0] - h[0][1] * g[1]) / det
        offset -= (h[0][0] * g[1] - h[1][0] * g[0]) / det
    if slope < 0:
        # A confidence that says nothing: the share of right sentences is all that is known.
        share = sum(weight * right for _, right, weight in data) / sum(weight for _, _, weight in data)
        share = min(max(share, 1e-3), 1 - 1e-3)
        return 0.0, math.log(share / (1 - share))
    return slope, offset


data = [pair for path in sys.argv[1:] for pair in pairs(path)]
slope, offset = fit(data)
print("# Confidence in sentences about recorded radar, fitted by docs/validation/confidence.py on recordings for tuning.")
print(f"slope = {slope:.3f}")
print(f"offset = {offset:.3f}")
print(f"unsure_below = {UNSURE_BELOW}")
