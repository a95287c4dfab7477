#!/usr/bin/env python3
"""Does what `radarllm live` says at one moment contradict itself?

    python3 studies/contradictions.py RADARLLM RECORDING... [--site FILE] [--details] [-- OPTION...]

Replays each recording through `live` as fast as it can, with the options after `--`, and keeps the state that a listener
keeps: presence, the newest sentence and label of each person, open falls, rows of the timeline. Needs Python 3.11 or later
and no package. The exit code is 1 if there was a contradiction. Of each recording it prints, and at the end of all,

    now       messages with a sentence about a person
    fallen    s in which a person has fallen and not risen, while the newest sentence or label has the same person walking,
              standing or getting up
    label     messages whose label is another posture than that at the end of the sentence
    empty     s in which nobody is there, while a sentence or a label says what somebody does, or a fall is open
    rows      s in which two rows of one person have two postures, or a row goes on while nobody is there

A posture is lying (also falling), sitting, standing or walking; a change between two of them is no contradiction with
either. Differences of up to 2 s between rows are left out, because windows begin every 2 s.
"""

import argparse
import collections
import datetime
import json
import pathlib
import subprocess
import sys
import tempfile

LYING, SITTING, STANDING, WALKING = "lying", "sitting", "standing", "walking"
ACTIONS = {
    "lie_still": LYING,
    "fall": LYING,
    "sit_still": SITTING,
    "stand_still": STANDING,
    "walk": WALKING,
    "pace": WALKING,
}
WORDS = {
    "lies": LYING,
    "falls": LYING,
    "sits": SITTING,
    "stands": STANDING,
    "walks": WALKING,
}
# Changes end in a posture: their words say which.
CHANGES = {"sits down": SITTING, "lies down": LYING, "stands up": None, "gets up": None}
UP = {STANDING, WALKING}
TOLERANCE_S = 2.0


def posture_of_caption(caption):
    """The posture at the end of a sentence, if it names one."""
    last = caption.rsplit(", then ", 1)[-1]
    for change, posture in CHANGES.items():
        if change in last:
            return posture
    return next((WORDS[word] for word in last.split() if word in WORDS), None)


def time_ms(text):
    return int(datetime.datetime.fromisoformat(text.replace("Z", "+00:00")).timestamp() * 1000)


class Listener:
    """The state of a listener, and what contradicts in it."""

    def __init__(self):
        self.count = collections.Counter()
        self.notes = []
        self.presence = None
        self.nows = {}
        self.falls = {}
        self.rows = {}
        self.absent = []
        self.t_s = None
        self.wrong = set()

    def note(self, kind, amount, text):
        self.count[kind] += amount
        self.notes.append(f"{kind}: {text}")

    def moment(self, t_s):
        """What held from the moment before until this one."""
        if self.t_s is not None and t_s > self.t_s:
            for kind, text in self.wrong:
                self.note(kind, t_s - self.t_s, f"{self.t_s:.1f} to {t_s:.1f} s: {text}")
        if self.t_s is None or t_s > self.t_s:
            self.t_s = t_s

    def judge(self):
        """Contradictions of the present state."""
        self.wrong = set()
        for person, now in self.nows.items():
            said = [posture_of_caption(now["caption"] or ""), ACTIONS.get(now["label"])]
            text = f"{now['caption']!r}, label {now['label']}"
            if self.presence == "absent" and (now["caption"] or now["label"] in ACTIONS):
                self.wrong.add(("empty", text))
            for fall in self.falls.values():
                if fall["person"] == person and any(one in UP for one in said):
                    self.wrong.add(("fallen", f"fall {fall['id']} {fall['state']} and {text}"))
        if self.presence == "absent" and self.falls:
            self.wrong.add(("empty", f"falls {list(self.falls)} are open"))

    def message(self, message):
        kind = message["type"]
        if kind == "hello":
            return
        if kind == "frame":
            return
        self.moment(message["t_s"])
        if kind == "presence":
            was, self.presence = self.presence, message["state"]
            if self.presence == "absent":
                self.absent.append([time_ms(message["utc"]), None])
            elif was == "absent":
                self.absent[-1][1] = time_ms(message["utc"])
        elif kind == "fall":
            if message["state"] in ("suspected", "confirmed"):
                self.falls[message["id"]] = message
            else:
                self.falls.pop(message["id"], None)
        elif kind == "activity":
            self.rows[message["id"]] = message
        elif kind == "now":
            if message["person"] is None:
                self.nows.clear()
            else:
                self.nows[message["person"]] = message
                if message["caption"]:
                    self.count["now"] += 1
                said, label = posture_of_caption(message["caption"] or ""), ACTIONS.get(message["label"])
                if said and label and said != label:
                    self.note("label", 1, f"{message['t_s']:.1f} s: {message['caption']!r}, label {message['label']}")
        self.judge()

    def end(self):
        """Contradictions between rows."""
        rows = [row for row in self.rows.values() if row["action"] in ACTIONS]
        for i, one in enumerate(rows):
            for other in rows[i + 1 :]:
                if one["person"] != other["person"] or ACTIONS[one["action"]] == ACTIONS[other["action"]]:
                    continue
                both_s = (min(one["end_ms"], other["end_ms"]) - max(one["start_ms"], other["start_ms"])) / 1000
                if both_s > TOLERANCE_S:
                    self.note("rows", both_s, f"{both_s:.1f} s: {one['caption']!r} and {other['caption']!r} ({one['action']} and {other['action']})")
            for start_ms, end_ms in self.absent:
                end_ms = end_ms or one["end_ms"]
                both_s = (min(one["end_ms"], end_ms) - max(one["start_ms"], start_ms)) / 1000
                if both_s > TOLERANCE_S:
                    self.note("rows", both_s, f"{both_s:.1f} s: {one['caption']!r} while nobody is there")


def replay(program, recording, options):
    """Messages of a replay."""
    with tempfile.TemporaryDirectory() as folder:
        command = [program, "live", recording, "--speed", "max", "--json", "--no-http", "--db", f"{folder}/live.db", *options]
        done = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    if done.returncode:
        sys.exit(f"{recording}: {done.stderr.strip().splitlines()[-1]}")
    return (json.loads(line) for line in done.stdout.splitlines())


def main():
    own, rest = (sys.argv[1:], [])
    if "--" in own:
        rest = own[own.index("--") + 1 :]
        own = own[: own.index("--")]
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("radarllm")
    parser.add_argument("recordings", nargs="+")
    parser.add_argument("--details", action="store_true", help="print each contradiction")
    args = parser.parse_args(own)
    kinds = ["now", "fallen", "label", "empty", "rows"]
    total = collections.Counter()
    print("recording | " + " | ".join(kinds))
    for recording in args.recordings:
        listener = Listener()
        for message in replay(args.radarllm, recording, rest):
            listener.message(message)
        listener.end()
        total += listener.count
        name = pathlib.Path(recording).name
        print(f"{name} | " + " | ".join(f"{listener.count[kind]:.0f}" for kind in kinds), flush=True)
        if args.details:
            for note in listener.notes:
                print(f"    {note}")
    print("all | " + " | ".join(f"{total[kind]:.0f}" for kind in kinds))
    sys.exit(1 if any(total[kind] for kind in kinds[1:]) else 0)


if __name__ == "__main__":
    main()
