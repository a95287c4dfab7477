#!/usr/bin/env python3
"""What survives when `radarllm` is killed, has few file descriptors, or a disk is full?

    python3 studies/kill.py RADARLLM [--work FOLDER] [--seed 1] [--kills 50] [--only kill,files,disk,stdout,clock]

RADARLLM is a program with the feature `train`. Needs Linux, Python 3.11 or later and no package. The part `disk`
mounts a tmpfs of 2 MB, or one and a half times the output where that is larger, for which it must run as root. The
campaign takes about 20 minutes on two cores. It prints one line a row:

    what | tried | survived | lost | remark

`survived` counts the tries after which everything held that is checked, `lost` the others, whose commands and
evidence are printed below the table. The exit code is 1 if something was lost. What cannot be run here is printed as
"not run".

kill    `kill -9` at moments drawn uniformly over the time of an undisturbed run, then the command that resumes. At
        every second moment, the first resumption of a data set or of a training is killed, too. Every file under its
        final name must be whole; what was finished or announced must be there; the resumed result must have the bytes
        of the undisturbed one, except for files that differ between two undisturbed runs, because they have times in
        them. Leftovers are temporary files. Those that the next run leaves are made an hour older, and it runs again.
files   At most 32, and at most 8, open files: success with the undisturbed result, or exit code 1 and a reason.
disk    A full disk as the folder of the output, with 0, 25, 50 and 90 % of the space that the output needs. It must
        be told with the path, and nothing be left. Then there is space again, and the command that resumes must give
        the undisturbed result.
stdout  /dev/full as standard output: exit code 1, and a message that names standard output.
clock   The clock of the computer jumps while `live` reads a serial port (a pseudo-terminal): by seconds to 400 days,
        ahead or back, at a random moment, once a try. Its steady clock goes on, as when a computer sets its time. What
        was announced before and after must be in the memory under the time that was announced, nothing that was stored
        may be deleted, no row may span the jump, and times after it must be those of the new clock. Needs libfaketime
        (`pip install libfaketime`, or the package of the distribution), named by LIBFAKETIME if it is not found.
"""

import argparse
import collections
import concurrent.futures
import datetime
import gzip
import hashlib
import importlib.util
import json
import os
import pathlib
import pty
import random
import resource
import shlex
import shutil
import signal
import sqlite3
import statistics
import struct
import subprocess
import sys
import tempfile
import threading
import time
import tomllib
import tty

LIMIT_S = 120
RADAR = "iwrl6432"
DISK_BYTES = 2 << 20
MOTIONS = ["walk", "squat", "punch", "jumping_jack", "sit_down", "kick"]

DATA = """name = "kill"
seed = 7
max_frames = 32
facet_edge_m = 0.05
shard_clips = 2
[[source]]
kind = "procedural"
train = 14
val = 2
test = 2
"""

TRAINING = """data = "{data}"
out = "{out}"
[motion]
batch_size = 4
codebook = {{ init_after = 1, init_inputs_per_code = 1 }}
model = {{ width = 16, codebook_size = 8 }}
loop = {{ epochs = 0, max_steps = 12, checkpoint_every_steps = 3 }}
[tokenizer]
batch_size = 4
codebook = {{ init_after = 1, init_inputs_per_code = 1 }}
model = {{ width = 16, heads = 2, layers = 1, code_dim = 16, codebook_size = 8 }}
loop = {{ epochs = 0, max_steps = 8, checkpoint_every_steps = 2 }}
[pretrain]
preset = "tiny"
batch = 8
bypass = false
loop = {{ epochs = 0, max_steps = 20, checkpoint_every_steps = 4 }}
[instruct]
batch = 8
loop = {{ epochs = 0, max_steps = 6, checkpoint_every_steps = 2 }}
[pose]
batch_size = 4
crop_frames = 8
model = {{ neighbours = 2, relative_translation = true, centred = true }}
loop = {{ epochs = 0, max_steps = 6, checkpoint_every_steps = 2 }}
"""


# ---- Files: whole or not, alike or not ----


def safetensors_problem(path):
    """Says what is wrong with a file of tensors: its header must parse, and its size must be what the header says."""
    data = path.read_bytes()
    length = struct.unpack("<Q", data[:8])[0]
    header = json.loads(data[8 : 8 + length])
    ends = [value["data_offsets"][1] for name, value in header.items() if name != "__metadata__"]
    expected = 8 + length + max(ends, default=0)
    return None if len(data) == expected else f"{len(data)} bytes instead of {expected}"


def parquet_problem(path):
    """Says what is wrong with the frame of a Parquet file: magic at both ends, and a footer that fits between them."""
    data = path.read_bytes()
    if len(data) < 12 or data[:4] != b"PAR1" or data[-4:] != b"PAR1":
        return f"no Parquet file, {len(data)} bytes"
    return None if struct.unpack("<I", data[-8:-4])[0] <= len(data) - 12 else "the footer is longer than the file"


def npy_problem(path):
    """Says what is wrong with an array of complex numbers of 8 bytes: its size must be what its header says."""
    with open(path, "rb") as file:
        head = file.read(10)
        if head[:6] != b"\x93NUMPY":
            return "no NumPy array"
        length = struct.unpack("<H", head[8:10])[0]
        shape = file.read(length).decode().split("(")[1].split(")")[0]
    expected = 8
    for edge in shape.split(","):
        expected *= int(edge) if edge.strip() else 1
    expected += 10 + length
    return None if path.stat().st_size == expected else f"{path.stat().st_size} bytes instead of {expected}"


def text_problem(path):
    """Says what is wrong with a text by its kind: JSON, lines of JSON, TOML, pages and pictures."""
    text = path.read_text()
    if path.suffix == ".json":
        json.loads(text)
    elif path.suffix == ".jsonl":
        for line in text.splitlines():
            json.loads(line)
        return None if not text or text.endswith("\n") else "the last line has no end"
    elif path.suffix == ".toml":
        tomllib.loads(text)
    else:
        end = {".html": "</html>", ".svg": "</svg>"}.get(path.suffix, "")
        return None if text.strip() and text.rstrip().endswith(end) else "it does not end as its kind does"
    return None


def problem_of(path):
    """Says what is wrong with a file under its final name, or returns None. Kinds that are not known count as whole."""
    kinds = {".safetensors": safetensors_problem, ".parquet": parquet_problem, ".npy": npy_problem}
    kinds |= dict.fromkeys([".json", ".jsonl", ".toml", ".html", ".svg", ".md"], text_problem)
    check = kinds.get(path.suffix)
    try:
        return check(path) if check else None
    except (ValueError, struct.error, IndexError, KeyError, TypeError) as error:
        return f"cannot be parsed: {error}"


def is_leftover(path, root):
    """Whether a path below a folder is, or is in, something temporary or a checkpoint that is being replaced."""
    return any(part.endswith((".tmp", ".old")) for part in path.relative_to(root).parts)


def survey(folder):
    """Returns what is wrong with the files under their final names below a folder, and the temporary files."""
    broken, leftovers = [], []
    for path in sorted(p for p in folder.rglob("*") if p.is_file()):
        if is_leftover(path, folder):
            leftovers.append(path)
        elif problem := problem_of(path):
            broken.append(f"{path.relative_to(folder)}: {problem}")
    return broken, leftovers


def tree(folder):
    """The hash of every file below a folder by its path, without temporary files."""
    files = (p for p in folder.rglob("*") if p.is_file() and not is_leftover(p, folder))
    return {str(p.relative_to(folder)): hashlib.sha256(p.read_bytes()).hexdigest() for p in files}


def differences(found, reference):
    """Names the files in which a folder differs from an undisturbed result: (hashes, names that may differ)."""
    expected, varying = reference
    names = sorted(set(found) | set(expected))
    return [n for n in names if (n in found) != (n in expected) or (n not in varying and found[n] != expected[n])]


# ---- The campaign: running, and counting ----


class Row:
    """A line of the table, with the failures that are printed below it."""

    def __init__(self, what):
        self.what, self.tried, self.failures, self.remarks = what, 0, [], []

    def count(self, command, problems):
        """Counts a try, and keeps the evidence if it failed."""
        self.tried += 1
        if problems:
            self.failures.append((command, "; ".join(" ".join(problem.split()) for problem in problems)))


class Campaign:
    """Runs the program, and collects the rows of the table."""

    def __init__(self, options):
        self.binary = str(pathlib.Path(options.radarllm).resolve())
        self.work = pathlib.Path(options.work or tempfile.mkdtemp(prefix="kill-")).resolve()
        self.random, self.kills, self.rows = random.Random(options.seed), options.kills, []
        self.temporary = self.work / "tmp"
        self.inputs = self.work / "inputs"
        for folder in (self.temporary, self.inputs, self.work / "home"):
            folder.mkdir(parents=True, exist_ok=True)
        self.environment = {k: v for k, v in os.environ.items() if not k.startswith("XDG_")}
        self.environment |= {"HOME": str(self.work / "home"), "TMPDIR": str(self.temporary)}

    def run(self, args, stdout=subprocess.PIPE, files=None):
        """Runs a command to its end; `files` limits the number of open files."""
        limit = (lambda: resource.setrlimit(resource.RLIMIT_NOFILE, (files, files))) if files else None
        command = [self.binary, *map(str, args)]
        try:
            return subprocess.run(command, stdout=stdout, stderr=subprocess.PIPE, stdin=subprocess.DEVNULL,
                                  env=self.environment, timeout=LIMIT_S, preexec_fn=limit)
        except subprocess.TimeoutExpired as late:
            return subprocess.CompletedProcess(command, -1, b"", (late.stderr or b"") + b"(did not end)")

    def need(self, args):
        """Runs a command that must succeed, because the campaign depends on it."""
        done = self.run(args)
        if done.returncode != 0:
            sys.exit(f"{self.text(args)}\n{done.stderr.decode(errors='replace')}")
        return done

    def start(self, args, stdout, stderr=subprocess.DEVNULL):
        """Starts a command and returns its process."""
        return subprocess.Popen([self.binary, *map(str, args)], stdout=stdout, stderr=stderr,
                                stdin=subprocess.DEVNULL, env=self.environment)

    def text(self, args):
        """The command as one would type it."""
        return shlex.join(["radarllm", *map(str, args)])

    def fresh(self, name):
        """An empty folder of a name in the folder of the campaign."""
        folder = self.work / name
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir()
        return folder

    def print(self, row):
        """Prints a row, and keeps it for the end."""
        self.rows.append(row)
        lost = len(row.failures)
        cells = [row.what, row.tried, row.tried - lost, lost, "; ".join(row.remarks)] if row.tried else \
            [row.what, "not run", "", "", "; ".join(row.remarks)]
        print("| " + " | ".join(map(str, cells)) + " |", flush=True)

    def not_run(self, what, reason):
        """Prints a row of something that cannot be run here."""
        row = Row(what)
        row.remarks.append(reason)
        self.print(row)


def prepare(campaign):
    """Makes the inputs that the commands read: motions as points and raw samples, a data set, a model, a memory."""
    folder = campaign.inputs
    (folder / "data.toml").write_text(DATA)
    names = [m for m in MOTIONS if not (folder / f"{m}.parquet").exists()]
    for name in names:
        campaign.need(["simulate", f"builtin:{name}", "--out", folder / f"{name}.parquet"])
    memory, db = folder / "memory.json", folder / "live.db"
    steps = {
        "room.parquet": ["simulate", "builtin:pace+then+squat+then+fall", "--out", folder / "room.parquet"],
        "raw.npy": ["simulate", "builtin:walk", "--radar", RADAR, "--emit", "adc", "--out", folder / "raw.npy"],
        "data": ["dataset", "build", folder / "data.toml", "--out", folder / "data"],
        "memory.json": ["teach", "first", "--says", "a person walks", folder / "walk.parquet", "--memory", memory],
        "training/model": ["train", "all", training(campaign, folder / "training")],
        "live.db": ["live", folder / "room.parquet", "--speed", "max", "--no-http", "--quiet", "--db", db],
    }
    for name, step in steps.items():
        if not (folder / name).exists():
            campaign.need(step)
    with open(folder / "walk.parquet", "rb") as plain, gzip.open(folder / "walk.parquet.gz", "wb") as packed:
        shutil.copyfileobj(plain, packed)
    (folder / "candidates.jsonl").write_text('{"id": "a", "text": "a person walks"}\n')
    (folder / "references.jsonl").write_text('{"id": "a", "texts": ["a person walks"]}\n')


def training(campaign, out):
    """Writes a training configuration whose results go to a folder, and returns its path."""
    path = campaign.work / f"training-{hashlib.sha256(str(out).encode()).hexdigest()[:12]}.toml"
    path.write_text(TRAINING.format(data=campaign.inputs / "data", out=out))
    return path


# ---- Kills ----


class Killed:
    """A command that is killed at random moments and then resumed. Its output goes to a folder of its own."""

    name = ""
    rounds = 1

    def __init__(self, campaign):
        self.campaign, self.inputs = campaign, campaign.inputs
        self.row = Row(f"kill: {self.name}")
        self.finished = self.left = self.left_again = self.left_aged = self.lines = 0

    def command(self, folder):
        """The command that is killed."""
        raise NotImplementedError

    def again(self, folder):
        """The command that resumes, or None where nothing is left to do."""
        return self.command(folder)

    def aged(self, folder):
        """A command that writes the same output again, and so may remove what is temporary and old."""
        return [*self.command(folder), "--force"]

    def begin(self, folder):
        """Fills the folder with what is there before the command."""

    def output(self, folder):
        """Where standard output goes."""
        return folder.with_suffix(".out")

    def places(self, folder):
        """The folders in which temporary files are counted."""
        return [folder, self.campaign.temporary]

    def facts(self, folder):
        """What is wrong after a kill, besides files that are not whole."""
        return []

    def facts_again(self, folder):
        """What is wrong after the command that resumed, besides bytes that differ."""
        return []

    def reference(self):
        """The result of undisturbed runs, the names that differ between two of them, and how long one takes."""
        trees, times = [], []
        for _ in range(3):
            folder = self.campaign.fresh("undisturbed")
            self.begin(folder)
            begun = time.monotonic()
            with open(self.output(folder), "wb") as stdout:
                code = self.campaign.start(self.command(folder), stdout).wait(LIMIT_S)
            times.append(time.monotonic() - begun)
            if code != 0:
                sys.exit(f"{self.campaign.text(self.command(folder))}: exit code {code}")
            self.printed = self.output(folder).read_bytes()
            trees.append(tree(folder))
        varying = {n for t in trees for n in t if t[n] != trees[0].get(n)}
        return (trees[0], varying), statistics.median(times)

    def kill(self, folder, command, seconds):
        """Starts a command and kills it at a random moment."""
        with open(self.output(folder), "ab") as stdout:
            process = self.campaign.start(command, stdout)
            time.sleep(self.campaign.random.uniform(0.0, seconds))
            self.finished += process.poll() is not None
            process.kill()
            process.wait()

    def leftovers(self, folder):
        """The temporary files of all places."""
        return [path for place in self.places(folder) for path in survey(place)[1]]

    def try_once(self, index):
        """One kill, or two, and what follows. Returns the problems."""
        folder, problems = self.campaign.fresh("killed"), []
        self.output(folder).unlink(missing_ok=True)
        self.begin(folder)
        command = self.command(folder)
        for _ in range(1 + index % self.rounds):
            self.kill(folder, command, self.seconds)
            problems += survey(folder)[0] + self.facts(folder)
            command = self.again(folder)
        self.left += len(self.leftovers(folder))
        if command:
            done = self.campaign.run(command)
            if done.returncode != 0:
                problems.append(f"{self.campaign.text(command)}: {done.stderr.decode(errors='replace').strip()[-300:]}")
        problems += survey(folder)[0] + self.facts_again(folder)
        problems += [f"resumed, it differs: {n}" for n in differences(tree(folder), self.expected)[:5]]
        self.age(folder)
        return problems

    def age(self, folder):
        """Counts what the resumed run left, makes it old, and counts what the next one leaves."""
        left = self.leftovers(folder)
        self.left_again += len(left)
        if left:
            roots = self.places(folder)
            above = {p for path in left for p in path.parents if any(root in p.parents for root in roots)}
            for path in [*left, *above]:
                os.utime(path, (time.time() - 3600,) * 2)
            self.campaign.run(self.aged(folder))
            left = self.leftovers(folder)
            self.left_aged += len(left)
            for path in left:
                path.unlink()

    def all(self):
        """Runs all kills and prints the row."""
        self.expected, self.seconds = self.reference()
        for index in range(self.campaign.kills):
            problems = self.try_once(index)
            self.row.count(self.campaign.text(self.command(self.campaign.work / "killed")), problems)
        kept = f"leftovers: {self.left} after the kills"
        kept += f", {self.left_again} after the next run, {self.left_aged} once older" if self.left else ""
        self.row.remarks += [f"undisturbed {self.seconds:.2f} s", f"{self.finished} had ended before the kill", kept]
        self.row.remarks += self.remarks()
        self.campaign.print(self.row)

    def remarks(self):
        """What else the row should say."""
        varying = {pathlib.Path(n).name for n in self.expected[1]}
        return [f"not compared, because two undisturbed runs differ: {', '.join(sorted(varying))}"] if varying else []


class Simulate(Killed):
    """`simulate` of three motions into a folder."""

    name = "simulate"

    def command(self, folder):
        """Three motions, and a file for each."""
        return ["simulate", "builtin:walk", "builtin:squat", "builtin:sit_down", "--out", folder / "points"]

    def again(self, folder):
        """Inputs whose output exists are skipped."""
        return [*self.command(folder), "--resume"]


class SimulateRaw(Killed):
    """`simulate --emit adc`, which writes while it simulates."""

    name = "simulate --emit adc"

    def command(self, folder):
        """One motion as raw samples."""
        return ["simulate", "builtin:walk", "--radar", RADAR, "--emit", "adc", "--out", folder / "raw.npy"]

    def again(self, folder):
        """The command itself, if there is no file yet."""
        return None if (folder / "raw.npy").exists() else self.command(folder)


class Process(Killed):
    """`process` of raw samples."""

    name = "process"

    def command(self, folder):
        """Raw samples to points, with all pictures, which take most of the time."""
        return ["process", self.inputs / "raw.npy", "--radar", RADAR, "--out", folder / "points.parquet",
                "--all-pictures", folder / "pictures"]

    def again(self, folder):
        """Replaces what is there."""
        return [*self.command(folder), "--force"]


class Describe(Killed):
    """`describe --json` of several files, whose output is redirected to a file."""

    name = "describe --json > FILE"

    def command(self, folder):
        """All motions twice, and a compressed one, which is unpacked into a temporary file."""
        files = [self.inputs / f"{name}.parquet" for name in MOTIONS]
        return ["describe", *files, self.inputs / "walk.parquet.gz", *files, self.inputs / "walk.parquet.gz", "--json"]

    def aged(self, folder):
        """The command itself."""
        return self.command(folder)

    def facts(self, folder):
        """What was printed must be whole lines, and the first lines of the undisturbed output."""
        printed = self.output(folder).read_bytes()
        self.lines += printed.count(b"\n")
        if printed and not printed.endswith(b"\n"):
            return [f"the output is cut: ...{printed[-100:]!r}"]
        is_begin = untimed(self.printed)[: printed.count(b"\n")] == untimed(printed)
        return [] if is_begin else ["the lines are not the first ones of the undisturbed output"]

    def facts_again(self, folder):
        """A new run must print what the undisturbed one printed."""
        printed = self.campaign.run(self.command(folder)).stdout
        return [] if untimed(printed) == untimed(self.printed) else ["the output of the next run differs"]

    def again(self, folder):
        """The next run is in `facts_again`."""
        return None

    def remarks(self):
        """How many lines were there."""
        return [f"{self.lines} whole lines were in the files of the killed runs"]


def untimed(printed):
    """Lines of JSON as values, without what depends on the computer: times and memory."""
    lines = [json.loads(line) for line in printed.splitlines()]
    return [{k: v for k, v in line.items() if k not in ("seconds", "peak_memory_mb")} for line in lines]


class Teach(Killed):
    """`teach` of a second activity."""

    name = "teach"

    def begin(self, folder):
        """A memory that knows one activity."""
        shutil.copy(self.inputs / "memory.json", folder / "memory.json")

    def command(self, folder):
        """Five recordings of the second activity."""
        files = [self.inputs / f"{name}.parquet" for name in MOTIONS[1:]]
        return ["teach", "second", "--says", "a person exercises", *files, "--memory", folder / "memory.json", "--json"]

    def known(self, folder):
        """The names of the taught activities, by the program."""
        listed = self.campaign.run(["teach", "--list", "--memory", folder / "memory.json", "--json"])
        return [a["name"] for a in json.loads(listed.stdout)] if listed.returncode == 0 else []

    def facts(self, folder):
        """The first activity must stay, and the second be there if it was announced."""
        names, problems = self.known(folder), []
        if "first" not in names:
            problems.append(f"the earlier activity is lost: {names}")
        if self.output(folder).stat().st_size and "second" not in names:
            problems.append(f"announced, but not stored: {names}")
        self.lines += "second" in names
        return problems

    def again(self, folder):
        """The command itself, unless its examples are known."""
        return None if "second" in self.known(folder) else self.command(folder)

    def aged(self, folder):
        """Any change writes the file again."""
        return ["forget", "second", "--memory", folder / "memory.json"]

    def remarks(self):
        """How often the kill was after the file was written."""
        return [f"{self.lines} times the new activity was stored before the kill"]


class DatasetBuild(Killed):
    """`dataset build` of nine shards."""

    name = "dataset build"
    rounds = 2
    shards = 0

    def command(self, folder):
        """The data set of the configuration above."""
        return ["dataset", "build", self.inputs / "data.toml", "--out", folder / "data"]

    def aged(self, folder):
        """The command itself."""
        return self.command(folder)

    def facts(self, folder):
        """Shards that earlier runs finished must not have been touched. Remembers those that are finished now."""
        data = folder / "data"
        states = [p.stem for p in (data / ".shards").glob("*-of-*.json")]
        now = {s: (data / "data" / f"{s}.parquet") for s in states}
        missing = [f"{s} has a state and no shard" for s, p in now.items() if not p.exists()]
        self.stamps = {s: (p.stat().st_ino, p.stat().st_mtime_ns) for s, p in now.items() if p.exists()}
        self.shards += len(now)
        return missing

    def facts_again(self, folder):
        """Finished shards must be the same files as before, and the whole must be valid."""
        problems = []
        for shard, stamp in self.stamps.items():
            path = folder / "data" / "data" / f"{shard}.parquet"
            if (path.stat().st_ino, path.stat().st_mtime_ns) != stamp:
                problems.append(f"{shard} was finished and was built again")
        checked = self.campaign.run(["dataset", "validate", folder / "data"])
        return problems + ([] if checked.returncode == 0 else [f"validate: {checked.stdout.decode()[-200:]}"])

    def remarks(self):
        """How many shards were finished at the kills."""
        return [f"{self.shards} finished shards at the kills", *super().remarks()]


class TrainAll(Killed):
    """`train all` of five stages with a checkpoint at every few updates."""

    name = "train all"
    rounds = 2

    def command(self, folder):
        """The configuration above."""
        return ["train", "all", training(self.campaign, folder / "model")]

    def again(self, folder):
        """From the last checkpoint."""
        return [*self.command(folder), "--resume"]

    def aged(self, folder):
        """Finished stages are kept."""
        return self.again(folder)

    def facts(self, folder):
        """The files of a checkpoint must be there with the sizes that it states."""
        problems = []
        for listed in folder.rglob("checksums.json"):
            if is_leftover(listed, folder):
                continue
            for name, stated in json.loads(listed.read_text()).items():
                path = listed.parent / name
                if not path.exists():
                    newest = max((p.name for p in listed.parent.parent.glob("step-*[0-9]")), default="none")
                    problems.append(f"{path.relative_to(folder)} is missing in its checkpoint; the newest is {newest}")
                elif path.stat().st_size != stated["bytes"]:
                    problems.append(f"{path.relative_to(folder)} has not the size that its checkpoint states")
        return problems

    facts_again = facts


class Export(Killed):
    """`dataset export`."""

    name = "dataset export"

    def command(self, folder):
        """The data set of the inputs."""
        return ["dataset", "export", self.inputs / "data", "--to", folder / "hub"]

    def again(self, folder):
        """Replaces what is there, as the guide says of an interrupted replacement."""
        return [*self.command(folder), "--force"]


class Pack(Killed):
    """`lm pack`, which writes a folder of several files."""

    name = "lm pack"

    def command(self, folder):
        """The model of the inputs."""
        return ["lm", "pack", "--model", self.inputs / "training" / "model", "--out", folder / "packed"]

    def again(self, folder):
        """The command itself, unless all is there."""
        return self.command(folder) if differences(tree(folder), self.expected) else None

    def aged(self, folder):
        """The command itself, which replaces nothing, so that its result is removed first."""
        shutil.rmtree(folder / "packed", ignore_errors=True)
        return self.command(folder)


class Live(Killed):
    """`live` of a replayed room with a memory, each database killed ten times."""

    name = "live --db"
    speed, last_s = "8", 6.0

    def __init__(self, campaign):
        super().__init__(campaign)
        self.announced = {"activity": 0, "fall": 0, "presence": 0}

    def command(self, folder):
        """A room in which somebody paces, squats and falls, again and again."""
        return ["live", self.inputs / "room.parquet", "--loop", "--speed", self.speed, "--no-http", "--json",
                "--occupancy-hold", "2", "--db", folder / "live.db"]

    def killed(self, folder, kind):
        """Kills `live` when it announces a kind of message, or at a random moment. Returns messages with their ages."""
        process, lines, found = self.campaign.start(self.command(folder), subprocess.PIPE), [], threading.Event()

        def read():
            for line in process.stdout:
                lines.append((time.monotonic(), line))
                if kind and f'"type":"{kind}"'.encode() in line:
                    process.kill()
                    found.set()

        reader = threading.Thread(target=read)
        reader.start()
        found.wait(LIMIT_S if kind else self.campaign.random.uniform(0.0, self.last_s))
        end = time.monotonic()
        process.kill()
        process.wait()
        reader.join()
        return [(end - at, json.loads(line)) for at, line in lines if line.endswith(b"\n")]

    def stored(self, folder, copy):
        """The rows of a copy of the database, and what is wrong with it."""
        for path in copy.glob("live.db*"):
            path.unlink()
        for path in folder.glob("live.db*"):
            shutil.copy(path, copy / path.name)
        if not (copy / "live.db").exists():
            return [], [], []
        with sqlite3.connect(copy / "live.db") as base:
            problems = [r[0] for r in base.execute("PRAGMA integrity_check") if r[0] != "ok"]
            if not base.execute("SELECT 1 FROM sqlite_master WHERE name = 'event'").fetchall():
                return [], [], problems
            activities = base.execute("SELECT id, start_ms, end_ms, caption FROM activity").fetchall()
            events = base.execute("SELECT at_ms, kind FROM event").fetchall()
        base.close()
        return activities, events, problems

    def missing(self, messages, activities, events):
        """Names what was announced and is not in the database, with its age at the kill."""
        rows, known, problems, was_present = {a[0]: a for a in activities}, set(events), [], False
        for age, message in messages:
            kind, wanted = message["type"], None
            if kind == "activity" and message["id"] > 0:
                row = rows.get(message["id"])
                is_there = row and row[1] == message["start_ms"] and row[2] >= message["end_ms"]
            elif kind == "fall":
                wanted = message["state"]
            elif kind == "presence":
                is_present = message["state"] != "absent"
                wanted = ("present" if is_present else "absent") if is_present != was_present else None
                was_present = is_present
            if wanted:
                is_there = (milliseconds(message["utc"]), wanted) in known
            if wanted or kind == "activity":
                self.announced[kind] += 1
                if not is_there:
                    problems.append(f"announced {age * 1e3:.1f} ms before the kill, not stored: {kind} {wanted or ''}")
        return problems

    def check(self, folder, messages):
        """Compares what was announced with the database, then starts `live` again, which must lose nothing."""
        copy = self.campaign.work / "copy"
        copy.mkdir(exist_ok=True)
        activities, events, problems = self.stored(folder, copy)
        problems += self.missing(messages, activities, events)
        again = ["live", self.inputs / "room.parquet", "--speed", "max", "--no-http", "--quiet"]
        again += ["--db", folder / "live.db"]
        ask = ["ask", "how many falls today?", "--db", folder / "live.db"]
        for command in (again, ask):
            done = self.campaign.run(command)
            if done.returncode != 0:
                problems.append(f"{self.campaign.text(command)}: {done.stderr.decode()[-300:]}")
        after = self.stored(folder, copy)
        if set(activities) - set(after[0]) or set(events) - set(after[1]):
            problems.append("rows were lost by the next run")
        return problems + after[2]

    def all(self):
        """Kills at random moments, and as soon as a fall, an activity or a presence is announced."""
        self.series(None, self.campaign.kills)
        for kind in ("fall", "presence", "activity"):
            self.series(kind, max(1, self.campaign.kills // 5))

    def series(self, kind, count):
        """Runs a number of kills and prints their row."""
        suffix = f", as soon as it announces: {kind}" if kind else ""
        self.row, self.announced = Row(f"kill: {self.name}{suffix}"), dict.fromkeys(self.announced, 0)
        for index in range(count):
            folder = self.campaign.work / "killed"
            if index % 10 == 0 or kind:
                folder = self.campaign.fresh("killed")
            problems = self.check(folder, self.killed(folder, kind))
            self.row.count(self.campaign.text(self.command(folder)), problems)
        told = ", ".join(f"{n} of kind {kind}" for kind, n in self.announced.items())
        left = len(survey(self.campaign.work / "killed")[1])
        self.row.remarks += [f"announced: {told}", "integrity_check after each kill and each restart"]
        self.row.remarks += [f"{left} leftovers at the end"] + ([] if kind else [f"kills within {self.last_s:g} s"])
        self.campaign.print(self.row)


def milliseconds(utc):
    """The time of a message, such as 2026-11-20T08:00:18.000Z, in milliseconds since 1970."""
    when = datetime.datetime.strptime(utc, "%Y-%m-%dT%H:%M:%S.%fZ").replace(tzinfo=datetime.timezone.utc)
    return round(when.timestamp() * 1000)


def kills(campaign):
    """All rows of `kill -9`."""
    for kind in (Simulate, SimulateRaw, Process, Describe, Teach, DatasetBuild, Export, Pack, TrainAll, Live):
        kind(campaign).all()


# ---- Few open files, full disks, a full standard output ----


def verbs(campaign, out):
    """Commands by name, which write into the folder `out`, each with the one that resumes; and commands that read."""
    i = campaign.inputs
    memory, db = out / "memory.json", i / "live.db"
    points = ["simulate", "builtin:walk", "--out", out / "points.parquet", "--json"]
    raw = ["simulate", "builtin:walk", "--radar", RADAR, "--emit", "adc", "--out", out / "raw.npy"]
    process = ["process", i / "raw.npy", "--radar", RADAR, "--out", out / "points.parquet"]
    pictures = [*process, "--all-pictures", out / "pictures"]
    build = ["dataset", "build", i / "data.toml", "--out", out / "data", "--json"]
    export = ["dataset", "export", i / "data", "--to", out / "hub", "--json"]
    train = ["train", "all", training(campaign, out / "model")]
    teach = ["teach", "second", "--says", "a person sits", i / "sit_down.parquet", "--memory", memory, "--json"]
    generate = ["generate", "a person walks", "--out", out / "generated.parquet", "--json"]
    page, figure = (["view", i / "walk.parquet", "--out", out / name] for name in ("walk.html", "walk.svg"))
    model = ["--model", i / "training" / "model"]
    evaluate = ["eval", "captions", *model, "--data", i / "data", "--beam", "1", "--out", out / "report", "--json"]
    pack = ["lm", "pack", *model, "--out", out / "packed"]
    mesh = ["motion", "mesh", "builtin:walk", "--out", out / "mesh.npz", "--json"]
    live = ["live", i / "room.parquet", "--speed", "max", "--json"]
    writing = {
        "simulate": (points, points), "simulate --emit adc": (raw, raw),
        "process": ([*process, "--json"], [*process, "--json"]),
        "process --all-pictures": (pictures, [*pictures, "--force"]), "dataset build": (build, build),
        "dataset export": (export, [*export, "--force"]), "train all": (train, [*train, "--resume"]),
        "teach": (teach, teach), "generate": (generate, generate), "view .html": (page, page),
        "view .svg": (figure, figure), "eval captions": (evaluate, [*evaluate, "--force"]), "lm pack": (pack, pack),
        "motion mesh": (mesh, mesh),
    }
    reading = {
        "dataset validate": ["dataset", "validate", i / "data", "--json"],
        "dataset info": ["dataset", "info", i / "data"],
        "describe": ["describe", i / "walk.parquet", i / "sit_down.parquet"],
        "describe --json": ["describe", i / "walk.parquet", i / "walk.parquet.gz", "--json"],
        "live": [*live, "--no-http", "--db", out / "live.db"],
        "live with its page": [*live, "--http", "127.0.0.1:0"],
        "ask": ["ask", "how many falls today?", "--db", db],
        "ask --json": ["ask", "is anybody there?", "--db", db, "--json"],
        "teach --list": ["teach", "--list", "--memory", i / "memory.json"], "demo": ["demo"], "doctor": ["doctor"],
        "motion list": ["motion", "list"], "motion info": ["motion", "info", "builtin:walk"],
        "radar list": ["radar", "list"], "radar show": ["radar", "show", "awr1843boost"],
        "radar lint": ["radar", "lint", "awr1843boost"], "train --print-config": [*train, "--print-config"],
        "score": ["score", "--candidates", i / "candidates.jsonl", "--references", i / "references.jsonl"],
        "completions": ["completions", "bash"], "man": ["man"], "help": ["help"], "help of a verb": ["live", "--help"],
        "--version": ["--version"],
    }
    return writing, reading


def begin(campaign, out):
    """Puts what is there before a verb into the folder of its output."""
    shutil.copy(campaign.inputs / "memory.json", out / "memory.json")


def undisturbed(campaign, name):
    """Two undisturbed runs of a verb: hashes with the names that vary, what was printed, size of the files."""
    trees = []
    for _ in range(2):
        out = campaign.fresh("verb")
        begin(campaign, out)
        writing, reading = verbs(campaign, out)
        done = campaign.need(writing[name][0] if name in writing else reading[name])
        trees.append(tree(out))
    varying = {n for n in trees[0] if trees[0][n] != trees[1].get(n)}
    size = sum(p.stat().st_size for p in out.rglob("*") if p.is_file())
    return (trees[0], varying), done.stdout, size


def last_words(done):
    """The end of what a command said on standard error."""
    return done.stderr.decode(errors="replace").strip().splitlines()[-1:] or ["(nothing on standard error)"]


def few_files(campaign):
    """Every verb with few file descriptors: the undisturbed result, or exit code 1 and a reason."""
    writing, reading = verbs(campaign, campaign.work / "verb")
    for name in [*writing, *reading]:
        row, (reference, _, _) = Row(f"open files: {name}"), undisturbed(campaign, name)
        for files in (32, 8):
            out = campaign.fresh("verb")
            begin(campaign, out)
            command = writing[name][0] if name in writing else reading[name]
            done = campaign.run(command, files=files)
            problems = survey(out)[0]
            if done.returncode == 0:
                problems += [f"{n} differs" for n in differences(tree(out), reference) if "live.db" not in n]
            elif done.returncode != 1 or "open files" not in done.stderr.decode(errors="replace"):
                problems.append(f"exit code {done.returncode}: {last_words(done)[0]}")
            row.count(f"(ulimit -n {files}; {campaign.text(command)})", problems)
            row.remarks.append(f"{files}: " + ("succeeds" if done.returncode == 0 else last_words(done)[0][:100]))
        campaign.print(row)


class Disk:
    """A tmpfs of a few MB, and a file that takes up what should not be free."""

    def __init__(self, campaign, size=DISK_BYTES):
        self.folder, self.size = campaign.work / "disk", size

    def __enter__(self):
        self.folder.mkdir(exist_ok=True)
        subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={self.size}", "none", self.folder], check=True,
                       capture_output=True)
        return self

    def __exit__(self, *_):
        subprocess.run(["umount", self.folder], check=True)

    def leave(self, free):
        """Fills the disk until only so many bytes are free."""
        with open(self.folder / "ballast", "wb") as file:
            stat = os.statvfs(self.folder)
            rest = max(0, stat.f_bavail * stat.f_frsize - free)
            file.write(bytes(rest))

    def empty(self):
        """Gives the space back."""
        (self.folder / "ballast").unlink()


def full_disk(campaign):
    """Every verb that writes, with a part of the space that it needs; `describe` and `live` in ways of their own."""
    try:
        with Disk(campaign):
            pass
    except (OSError, subprocess.CalledProcessError) as error:
        return campaign.not_run("full disk", f"a tmpfs cannot be mounted: {error}")
    writing, _ = verbs(campaign, campaign.work / "disk" / "out")
    for name in writing:
        row, (reference, _, size) = Row(f"full disk: {name}"), undisturbed(campaign, name)
        for share in (0.0, 0.25, 0.5, 0.9):
            is_large = share >= 0.5 and size > DISK_BYTES * 0.9
            with Disk(campaign, size * 3 // 2 if is_large else DISK_BYTES) as disk:
                full_disk_once(campaign, disk, row, name, reference, size, share)
        row.remarks.insert(0, f"the output has {size / 1e6:.2f} MB")
        campaign.print(row)
    full_disk_describe(campaign)
    full_disk_live(campaign)


def full_disk_once(campaign, disk, row, name, reference, size, share):
    """A verb with a share of the space that it needs, and once more with all of it."""
    out = disk.folder / "out"
    out.mkdir()
    begin(campaign, out)
    command, again = verbs(campaign, out)[0][name]
    disk.leave(int(share * min(size, disk.size)))
    done = campaign.run(command)
    said, problems = done.stderr.decode(errors="replace"), []
    if done.returncode == 0:
        row.remarks.append(f"{share:.0%} of the space was enough")
    else:
        broken, left = survey(out)
        problems += broken + [f"left behind: {p.relative_to(out)}" for p in left]
        if "No space left" not in said or str(disk.folder) not in said:
            problems.append(f"with {share:.0%} of the space, exit code {done.returncode}, it says: {said[-300:]}")
    disk.empty()
    if done.returncode != 0 and size < disk.size * 0.9:
        done = campaign.run(again)
        if done.returncode != 0:
            problems.append(f"with space again, {campaign.text(again)}: {done.stderr.decode(errors='replace')[-300:]}")
        else:
            problems += [f"with space again, it differs: {n}" for n in differences(tree(out), reference)]
    row.count(campaign.text(command), problems)


def full_disk_describe(campaign):
    """`describe --json` whose standard output is a file on a full disk."""
    row = Row("full disk: describe --json > FILE")
    command = verbs(campaign, campaign.work / "verb")[1]["describe --json"]
    for free in (0, 4096):
        with Disk(campaign) as disk, open(disk.folder / "out.jsonl", "wb") as stdout:
            disk.leave(free)
            done = campaign.run([*command[:-1], *command[1:-1] * 8, "--json"], stdout=stdout)
            said = done.stderr.decode(errors="replace")
            is_told = done.returncode == 1 and "standard output" in said and "No space left" in said
            row.count(campaign.text(command), [] if is_told else [f"exit code {done.returncode}: {said[-200:]}"])
    row.remarks.append("the last line of the file may be cut, because the file is not the program's")
    campaign.print(row)


def wait_for(seconds, condition):
    """Waits until a condition holds. Returns whether it does."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        if condition():
            return True
        time.sleep(0.2)
    return False


def full_disk_live(campaign):
    """`live --db`: a disk that is full at the start, and one that fills up for ten seconds."""
    row, live = Row("full disk: live --db, full at the start"), Live(campaign)
    with Disk(campaign) as disk:
        disk.leave(0)
        done = campaign.run(["live", live.inputs / "room.parquet", "--speed", "max", "--no-http", "--db",
                             disk.folder / "live.db"])
        said = done.stderr.decode(errors="replace")
        is_told = any(words in said for words in ("No space left", "is full", "disk full")) and "live.db" in said
        problems = [] if is_told else [f"exit code {done.returncode}: {said[-300:]}"]
        row.count(campaign.text(live.command(disk.folder)), problems)
        row.remarks.append(f"exit code {done.returncode}: {last_words(done)[0][-120:]}")
    campaign.print(row)
    row = Row("full disk: live --db, full for 10 s while it runs (a disk of 16 MB)")
    with Disk(campaign, size=16 << 20) as disk:
        row.count(campaign.text(live.command(disk.folder)), full_for_a_while(campaign, disk, live, row))
    campaign.print(row)


def full_for_a_while(campaign, disk, live, row):
    """Fills the disk under a running `live`. It must say so, go on, and write the falls of that time afterwards."""
    heard, errors = campaign.work / "live.jsonl", campaign.work / "live.err"
    with open(heard, "wb") as stdout, open(errors, "wb") as stderr:
        process = campaign.start(live.command(disk.folder), stdout, stderr)
    time.sleep(5)
    disk.leave(0)
    is_told = wait_for(20, lambda: b"cannot be written" in errors.read_bytes())
    time.sleep(10)
    disk.empty()
    freed = time.monotonic()
    messages = [json.loads(line) for line in heard.read_bytes().splitlines(keepends=True) if line.endswith(b"\n")]
    falls = {(milliseconds(m["utc"]), m["state"]) for m in messages if m["type"] == "fall"}
    copy = campaign.work / "copy"
    copy.mkdir(exist_ok=True)
    is_written = wait_for(90, lambda: falls <= set(live.stored(disk.folder, copy)[1]))
    waited = time.monotonic() - freed
    row.remarks.append(f"{len(falls)} messages of falls, waited {waited:.0f} s after there was space")
    process.send_signal(signal.SIGTERM)
    code = process.wait(LIMIT_S)
    said = errors.read_text(errors="replace").strip()
    row.remarks.append(said.splitlines()[-1][-160:] if said else "nothing on standard error")
    problems = [] if is_told else ["standard error does not say that the memory cannot be written"]
    problems += [] if is_written else ["falls of that time are not in the memory 90 s after there was space"]
    problems += [] if code == 0 else [f"exit code {code} after SIGTERM"]
    return problems + live.stored(disk.folder, copy)[2]


def full_stdout(campaign):
    """/dev/full as standard output of every verb that prints."""
    writing, reading = verbs(campaign, campaign.work / "verb")
    for name in [*writing, *reading]:
        if not undisturbed(campaign, name)[1]:
            continue
        out, row = campaign.fresh("verb"), Row(f"stdout full: {name}")
        begin(campaign, out)
        command = writing[name][0] if name in writing else reading[name]
        with open("/dev/full", "wb") as full:
            done = campaign.run(command, stdout=full)
        problems = survey(out)[0]
        said = done.stderr.decode(errors="replace")
        if done.returncode == 0 or "standard output" not in said or "No space left" not in said:
            problems.append(f"exit code {done.returncode}: {last_words(done)[0]}")
        row.count(f"{campaign.text(command)} > /dev/full", problems)
        row.remarks.append(f"exit code {done.returncode}")
        campaign.print(row)


MAGIC = bytes([2, 1, 4, 3, 6, 5, 8, 7])
UART_HZ = 20
# Somebody walks to and fro for 9 s and is away for 4 s, again and again.
THERE_S, AWAY_S, TURN_S = 9.0, 4.0, 3.0


def uart_frame(number, draw):
    """A frame of TI's out-of-box demo (SDK 3): twelve points of somebody who walks at 1 m/s, or none."""
    now_s = number / UART_HZ % (THERE_S + AWAY_S)
    turns, part_s = divmod(now_s, TURN_S)
    y_m, v_mps = (1.5 + part_s, 1.0) if turns % 2 == 0 else (1.5 + TURN_S - part_s, -1.0)
    n = 12 if now_s < THERE_S else 0
    places = [(draw.gauss(0, 0.1), y_m + draw.gauss(0, 0.1), draw.gauss(0, 0.3), v_mps) for _ in range(n)]
    points = b"".join(struct.pack("<4f", *place) for place in places)
    side = struct.pack("<2h", 200, 700) * n
    body = struct.pack("<2I", 1, len(points)) + points + struct.pack("<2I", 7, len(side)) + side
    padding = -(40 + len(body)) % 32
    total = 40 + len(body) + padding
    header = struct.pack("<8I", 0x03050004, total, 0xA6843, number, 0, n, 2, 0)
    return MAGIC + header + body + bytes(padding)


class ClockJumps:
    """`live` on a serial port while the clock of the computer jumps."""

    command = ["live", "PORT", "--frame-rate", UART_HZ, "--no-http", "--json", "--occupancy-hold", "2", "--db", "live.db"]
    jump_s = [-86_400 * 400, -86_400, -3_600, -60, -5, 5, 60, 3_600, 86_400, 86_400 * 400]
    last_s = 40.0

    def __init__(self, campaign, library):
        self.campaign, self.library, self.live = campaign, library, Live(campaign)

    def start(self, folder, port):
        """Starts `live` with a clock whose difference from that of the computer, s, is in a file."""
        environment = {"LD_PRELOAD": str(self.library), "FAKETIME_TIMESTAMP_FILE": str(folder / "offset"),
                       "FAKETIME_NO_CACHE": "1", "FAKETIME_DONT_FAKE_MONOTONIC": "1"}
        command = [self.campaign.binary, *map(str, self.command)]
        command = [port if word == "PORT" else str(folder / word) if word == "live.db" else word for word in command]
        with open(folder / "live.err", "wb") as errors:
            return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=errors, stdin=subprocess.DEVNULL,
                                    env=self.campaign.environment | environment)

    def try_once(self, index, jump_s, at_s):
        """One try with a jump after a time. Returns what went wrong, and how many messages were checked."""
        folder = self.campaign.fresh(f"clock-{index}")
        (folder / "offset").write_text("+0")
        ours, theirs = pty.openpty()
        tty.setraw(theirs)
        process, heard = self.start(folder, os.ttyname(theirs)), []

        def read():
            for line in process.stdout:
                heard.append((time.monotonic(), line))

        reader = threading.Thread(target=read)
        reader.start()
        draw, jumped = random.Random(index), None
        begun, number = time.monotonic(), 0
        while process.poll() is None and number < self.last_s * UART_HZ:
            now_s = number / UART_HZ
            if jumped is None and now_s >= at_s:
                (folder / "offset.new").write_text(f"{jump_s:+d}")
                (folder / "offset.new").replace(folder / "offset")
                jumped = (time.monotonic(), time.time())
            os.write(ours, uart_frame(number, draw))
            number += 1
            time.sleep(max(0.0, begun + number / UART_HZ - time.monotonic()))
        process.send_signal(signal.SIGTERM)
        code = process.wait(LIMIT_S)
        reader.join()
        os.close(ours)
        os.close(theirs)
        problems = [] if code == 0 else [f"exit code {code}: {(folder / 'live.err').read_text(errors='replace')[-300:]}"]
        return problems + self.check(folder, heard, jump_s, jumped)

    def check(self, folder, heard, jump_s, jumped):
        """Compares what was announced with the database and with the two clocks."""
        (folder / "live.jsonl").write_bytes(b"".join(line for _, line in heard))
        copy = self.campaign.fresh(f"{folder.name}-copy")
        activities, events, problems = self.live.stored(folder, copy)
        messages = [(at, json.loads(line)) for at, line in heard if line.endswith(b"\n")]
        end = time.monotonic()
        problems += self.live.missing([(end - at, message) for at, message in messages], activities, events)
        if not any(m["type"] == "presence" for _, m in messages) or not activities:
            problems.append("nothing was announced")
        # A jump ahead is followed when frames have been late for 2 s.
        settled_s, away_s = 4.0, 3.0
        real_ms = lambda at: 1e3 * (jumped[1] + at - jumped[0])
        for at, message in messages:
            if message["type"] != "presence":
                continue
            apart_s = (milliseconds(message["utc"]) - real_ms(at)) / 1e3
            expected = [0] if at < jumped[0] else [jump_s] if at > jumped[0] + settled_s else [0, jump_s]
            if min(abs(apart_s - one) for one in expected) > away_s:
                problems.append(f"a message {at - jumped[0]:+.0f} s from the jump has a time {apart_s:+.0f} s from the clock")
        rows = [row for row in activities if row[2] < row[1] or row[2] - row[1] > 1e3 * self.last_s]
        return problems + [f"a row of {(row[2] - row[1]) / 1e3:.0f} s" for row in rows]

    def all(self):
        """Four tries at a time, so that the campaign does not take the sum of their times."""
        row = Row("clock jumps: live --db on a serial port")
        count = max(1, self.campaign.kills)
        tries = [(i, self.jump_s[i % len(self.jump_s)], self.campaign.random.uniform(6.0, 28.0)) for i in range(count)]
        with concurrent.futures.ThreadPoolExecutor(4) as pool:
            for one, problems in zip(tries, pool.map(lambda one: self.try_once(*one), tries)):
                row.count(f"{self.campaign.text(self.command)} with a jump of {one[1]} s", problems)
        told = ", ".join(f"{n} of kind {kind}" for kind, n in self.live.announced.items())
        row.remarks += [f"jumps of {', '.join(map(str, self.jump_s))} s", f"announced: {told}"]
        self.campaign.print(row)


def clock(campaign):
    """Jumps of the clock, which need libfaketime."""
    named = [pathlib.Path(os.environ["LIBFAKETIME"])] if "LIBFAKETIME" in os.environ else []
    found = named or sorted(pathlib.Path("/usr/lib").glob("**/libfaketime.so.1"))
    if not found:
        spec = importlib.util.find_spec("libfaketime")
        found = sorted(pathlib.Path(spec.origin).parent.glob("**/libfaketime.so.1")) if spec else []
    if not found:
        return campaign.not_run("clock jumps", "libfaketime is not installed")
    ClockJumps(campaign, found[0].resolve()).all()


PARTS = {"kill": kills, "files": few_files, "disk": full_disk, "stdout": full_stdout, "clock": clock}


def main():
    """Runs the parts that were asked for, and prints the table and the failures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("radarllm", help="the program")
    parser.add_argument("--work", help="folder for everything that is written; a new temporary folder if omitted")
    parser.add_argument("--seed", type=int, default=1, help="seed of the random moments")
    parser.add_argument("--kills", type=int, default=50, help="kills of each verb")
    parser.add_argument("--only", default=",".join(PARTS), help="parts, separated by commas")
    options = parser.parse_args()
    campaign, begun = Campaign(options), time.monotonic()
    prepare(campaign)
    print("| what | tried | survived | lost | remark |\n|---|---|---|---|---|", flush=True)
    for part in options.only.split(","):
        PARTS[part](campaign)
    print(f"\n{time.monotonic() - begun:.0f} s, seed {options.seed}, {campaign.binary}, folder {campaign.work}")
    failures = [(row.what, *failure) for row in campaign.rows for failure in row.failures]
    for what, command in dict.fromkeys(failure[:2] for failure in failures):
        print(f"\nFAILED {what}\n  {command}")
        for evidence, times in collections.Counter(f[2] for f in failures if f[:2] == (what, command)).items():
            print(f"  - {evidence}" + (f" ({times} times)" if times > 1 else ""))
    sys.exit(1 if failures else 0)


if __name__ == "__main__":
    main()
