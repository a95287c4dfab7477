#!/usr/bin/env python3
"""Sentences for the walks, runs and jumps of the CMU motion capture database, for data sets with `kind = "files"`.

    scripts/cmu_gaits.py cmu-index.csv files.csv OUT/captions.jsonl

`cmu-index.csv` has the columns `trial` and `description`, the database's own index; `files.csv` has `trial`, `file`,
`kind`, `true_fps` and `skip_first_frames`. OUT holds the files that `files.csv` names. Only descriptions that say one
thing get a sentence; of these, the part before a comma is the gait, and the part after it a turn. Turns are also
mirrored, and straight walks and runs are bent to either side, because the database has few turns; a slight bend is
still called straight.
"""

import csv
import json
import random
import re
import sys

GAITS = {
    "walk": ["walks forward", "walks straight ahead", "walks ahead", "walks"],
    "slow walk": ["slowly walks forward", "walks straight ahead slowly", "walks forward at a slow pace"],
    "run": ["runs forward", "runs straight ahead", "jogs forward"],
    "run/jog": ["runs forward", "jogs forward", "runs straight ahead"],
    "forward jump": ["jumps forward", "leaps forward"],
}
# Angles of bent paths, degrees, and of paths that are called straight all the same.
BENDS_DEG = (50, 140)
STRAIGHT_DEG = (4, 20)
TURN = re.compile(r"(?:veer|90-degree) (left|right)(?: turn)?")


def with_turn(ways, turn):
    """Sentences for a gait that turns to a side."""
    ends = [f", then turns {turn}", f" and then turns to the {turn}", f", then turns to the {turn}"]
    return [way.replace(" straight", "") + end for way, end in zip(ways, ends)]


def parts(description):
    """Sentences for a gait and the side to which it turns, if any; no sentences if it says anything else."""
    gait, *rest = (part.strip() for part in description.lower().split(","))
    ways = GAITS.get(gait)
    turn = TURN.fullmatch(rest[0]) if rest else None
    if ways is None or len(rest) > 1 or (rest and turn is None):
        return [], None
    return [f"a person {way}" for way in ways], turn and turn[1]


def clips(trial, description):
    """What is made of a trial: sentences with the fields that say how."""
    ways, turn = parts(description)
    if not ways:
        return
    if turn:
        other = {"left": "right", "right": "left"}[turn]
        yield {"captions": with_turn(ways, turn)}
        yield {"captions": with_turn(ways, other), "id": f"{trial}-mirrored", "mirror": True}
        return
    yield {"captions": ways}
    if "jump" in description.lower():
        return
    draw = random.Random(trial)
    bends = [("left", 1), ("right", -1)]
    for turn, sign in bends:
        bend_deg = sign * draw.randint(*BENDS_DEG)
        yield {"captions": with_turn(ways, turn), "id": f"{trial}-{turn}", "bend_deg": bend_deg}
    _, sign = draw.choice(bends)
    yield {"captions": ways, "id": f"{trial}-straight", "bend_deg": sign * draw.randint(*STRAIGHT_DEG)}


def main(index, files, out):
    with open(index, newline="", encoding="utf-8") as file:
        descriptions = {row["trial"]: row["description"] for row in csv.DictReader(file)}
    n = 0
    with open(files, newline="", encoding="utf-8") as table, open(out, "w", encoding="utf-8") as lines:
        for row in csv.DictReader(table):
            if row["kind"] != "amc":
                continue
            for clip in clips(row["trial"], descriptions.get(row["trial"], "")):
                clip |= {
                    "file": row["file"],
                    "split": "train",
                    "fps": float(row["true_fps"]),
                    "skip_frames": int(row["skip_first_frames"]),
                }
                lines.write(json.dumps(clip) + "\n")
                n += 1
    print(out, n, "clips")


if __name__ == "__main__":
    main(*sys.argv[1:])
