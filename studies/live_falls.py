"""Counts the falls that `radarllm live` suspects and confirms in recordings, by their activity.

`eval boards` counts what `describe` states of whole recordings. A running radar sees six seconds at a time and suspects a
fall before it knows what follows, so that it is measured by itself.

    python3 studies/live_falls.py target/release/radarllm DIR [-- OPTIONS OF LIVE]

DIR has a folder for each activity. Options after `--`, such as `--frame-rate 10`, are given to `live`.

With `--held`, the recordings are tables of which each has many short ones, numbered by the columns Session_ID and
Recording_Number at 10 frames/s, such as the falls of TI's IWRL6432. Each is replayed by itself, after 6 s of its first
row and before 28 s of its last one, because a running radar needs the time before and after a fall.
"""

import argparse
import collections
import csv
import json
import pathlib
import subprocess
import tempfile

BEFORE, AFTER = 60, 280


def states_of_falls(command, recording, options):
    """Counts the messages of falls by their states while a recording is replayed."""
    arguments = [command, "live", str(recording), "--speed", "max", "--json", "--no-http", *options]
    run = subprocess.run(arguments, capture_output=True, text=True, check=False)
    if run.returncode != 0:
        raise SystemExit(f"{recording}: {run.stderr.strip().splitlines()[-1]}")
    states = collections.Counter()
    for line in run.stdout.splitlines():
        message = json.loads(line)
        if message.get("type") == "fall":
            states[message["state"]] += 1
    return states


def held(recordings, folder):
    """Writes each recording of these tables as a table, with its first and last row held. Returns the paths."""
    paths = []
    for table in recordings:
        with open(table, newline="", encoding="utf-8") as file:
            reader = csv.DictReader(file)
            parts = collections.defaultdict(list)
            for row in reader:
                parts[row.get("Session_ID"), row.get("Recording_Number")].append(row)
        if (None, None) in parts:
            continue
        for at, rows in enumerate(parts.values()):
            rows = [rows[0]] * BEFORE + rows + [rows[-1]] * AFTER
            path = pathlib.Path(folder) / f"{table.stem}-{at}.csv"
            with open(path, "w", newline="", encoding="utf-8") as file:
                writer = csv.DictWriter(file, reader.fieldnames)
                writer.writeheader()
                writer.writerows({**row, "Frame_count": frame} for frame, row in enumerate(rows))
            paths.append(path)
    return paths


def main():
    """Prints a row for each activity."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("command", help="the command radarllm")
    parser.add_argument("folder", type=pathlib.Path, help="folder with a folder for each activity")
    parser.add_argument("--held", action="store_true", help="replay each short recording of a table by itself")
    parser.add_argument("options", nargs="*", help="options of live, after --")
    args = parser.parse_args()
    print("| activity | recordings | falls suspected | in recordings | confirmed |")
    print("|---|---|---|---|---|")
    for activity in sorted(p for p in args.folder.iterdir() if p.is_dir()):
        recordings = sorted(p for p in activity.iterdir() if p.is_file())
        with tempfile.TemporaryDirectory() as folder:
            recordings = held(recordings, folder) if args.held else recordings
            all_states = [states_of_falls(args.command, one, args.options) for one in recordings]
        suspected = [states["suspected"] for states in all_states]
        n_with = sum(n > 0 for n in suspected)
        confirmed = sum(states["confirmed"] for states in all_states)
        print(f"| {activity.name} | {len(recordings)} | {sum(suspected)} | {n_with} | {confirmed} |")


if __name__ == "__main__":
    main()
