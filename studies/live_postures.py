#!/usr/bin/env python3
"""How much of labelled time does `radarllm live` say the posture of?

    python3 studies/live_postures.py RADARLLM RECORDING LABELS [-- OPTIONS OF LIVE]

LABELS is a table with the columns posture (standing or sitting), start_s and end_s, in seconds of the recording. Options
after `--`, such as `--site FILE`, are given to `live`. Prints the share of the labelled times, each weighing the same, over
which a row of the timeline has the right posture and over which one has another; the rest is not stated. Needs Python 3.11
or later and no package.
"""

import argparse
import csv
import datetime
import json
import subprocess
import sys

POSTURES = {"standing": "stand_still", "sitting": "sit_still", "lying": "lie_still"}


def rows_of(command, recording, options):
    """Rows of the timeline: action, start and end in seconds of the recording."""
    arguments = [command, "live", recording, "--speed", "max", "--json", "--no-http", *options]
    run = subprocess.run(arguments, capture_output=True, text=True, check=False)
    if run.returncode != 0:
        raise SystemExit(f"{recording}: {run.stderr.strip().splitlines()[-1]}")
    rows, first_ms = {}, None
    for line in run.stdout.splitlines():
        message = json.loads(line)
        if message["type"] == "hello":
            continue
        if first_ms is None:
            at = datetime.datetime.fromisoformat(message["utc"].replace("Z", "+00:00"))
            first_ms = 1e3 * (at.timestamp() - message["t_s"])
        if message["type"] == "activity":
            span_s = [(message[key] - first_ms) / 1e3 for key in ("start_ms", "end_ms")]
            rows[message["id"]] = (message["action"], *span_s)
    return list(rows.values())


def main():
    """Prints a row for each labelled time, and their mean."""
    own, options = sys.argv[1:], []
    if "--" in own:
        own, options = own[: own.index("--")], own[own.index("--") + 1 :]
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("command", help="the command radarllm")
    parser.add_argument("recording")
    parser.add_argument("labels")
    args = parser.parse_args(own)
    rows = [row for row in rows_of(args.command, args.recording, options) if row[0] in POSTURES.values()]
    print("| posture | from, s | to, s | right, % | wrong, % |")
    print("|---|---|---|---|---|")
    shares = []
    with open(args.labels, newline="", encoding="utf-8") as file:
        for label in csv.DictReader(file):
            start_s, end_s = float(label["start_s"]), float(label["end_s"])
            stated = {True: 0.0, False: 0.0}
            for action, from_s, to_s in rows:
                both_s = max(0.0, min(end_s, to_s) - max(start_s, from_s))
                stated[action == POSTURES[label["posture"]]] += both_s
            shares.append([100 * stated[is_right] / (end_s - start_s) for is_right in (True, False)])
            right, wrong = shares[-1]
            print(f"| {label['posture']} | {start_s:.0f} | {end_s:.0f} | {right:.0f} | {wrong:.0f} |")
    right, wrong = [sum(column) / len(shares) for column in zip(*shares)]
    print(f"| mean | | | {right:.1f} | {wrong:.1f} |")


if __name__ == "__main__":
    main()
