#!/usr/bin/env python3
"""Sentences for the walks, runs and jumps of the CMU motion capture database, for data sets with `kind = "files"`.

    scripts/cmu_gaits.py cmu-index.csv files.csv OUT/captions.jsonl

`cmu-index.csv` has the columns `trial` and `description`, the database's own index; `files.csv` has `trial`, `file`,
`kind`, `true_fps` and `skip_first_frames`. OUT holds the files that `files.csv` names. Only descriptions that say one
thing get a sentence; of these, the part before a comma is the gait, and the part after it a turn.
"""

import csv
import json
import re
import sys

GAITS = {
    "walk": ["walks forward", "walks straight ahead", "walks ahead", "walks"],
    "slow walk": ["slowly walks forward", "walks straight ahead slowly", "walks forward at a slow pace"],
    "run": ["runs forward", "runs straight ahead", "jogs forward"],
    "run/jog": ["runs forward", "jogs forward", "runs straight ahead"],
    "forward jump": ["jumps forward", "leaps forward"],
}
TURN = re.compile(r"(?:veer|90-degree) (left|right)(?: turn)?")


def sentences(description):
    """Sentences for a description; none if it says anything else."""
    gait, *rest = (part.strip() for part in description.lower().split(","))
    ways = GAITS.get(gait)
    turn = TURN.fullmatch(rest[0]) if rest else None
    if ways is None or len(rest) > 1 or (rest and turn is None):
        return []
    if turn:
        ends = [f", then turns {turn[1]}", f" and then turns to the {turn[1]}", f", then turns to the {turn[1]}"]
        ways = [way.replace(" straight", "") + end for way, end in zip(ways, ends)]
    return [f"a person {way}" for way in ways]


def main(index, files, out):
    with open(index, newline="", encoding="utf-8") as file:
        descriptions = {row["trial"]: row["description"] for row in csv.DictReader(file)}
    n = 0
    with open(files, newline="", encoding="utf-8") as table, open(out, "w", encoding="utf-8") as lines:
        for row in csv.DictReader(table):
            captions = sentences(descriptions.get(row["trial"], ""))
            if captions and row["kind"] == "amc":
                clip = {
                    "file": row["file"],
                    "captions": captions,
                    "split": "train",
                    "fps": float(row["true_fps"]),
                    "skip_frames": int(row["skip_first_frames"]),
                }
                lines.write(json.dumps(clip) + "\n")
                n += 1
    print(out, n, "motions")


if __name__ == "__main__":
    main(*sys.argv[1:])
