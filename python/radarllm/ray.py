"""Data sets on a Ray cluster: build them, and describe the clips of one.

>>> import radarllm.ray as rr
>>> rr.build("data.toml", out="/shared/data")  # doctest: +SKIP
>>> rr.describe("/shared/data", split="test", out="/shared/captions.jsonl")  # doctest: +SKIP

Both run on Ray Data, give the bytes that one machine gives, and go on where they were when they are called again.
The folders must be on a file system that all nodes share and that has locks and renames (NFS, CephFS, Lustre), and all
nodes need the same version of this package and processors with the same instructions.

This package does not install Ray: ``pip install "ray[data]"``.
"""

from __future__ import annotations

import functools
import hashlib
import json
import os
import secrets
import shutil
import time
from collections.abc import Callable
from itertools import islice
from pathlib import Path
from typing import Any, Literal, TypeVar

try:
    import ray.data
except ImportError as error:
    raise ImportError("radarllm.ray needs Ray Data, which can be installed by: pip install 'ray[data]'") from error

from ._errors import Error, ExistsError
from ._native import Dataset, DatasetPlan, Model, __version__

__all__ = ["build", "describe"]

StrPath = str | os.PathLike[str]
_Row = dict[str, Any]
_T = TypeVar("_T")

# Time for workers of a killed driver, and for late attempts of tasks, to end.
_WAIT_S = 60.0
_WHAT_STAYS = "what is complete is kept; call this again with the same arguments"


def build(
    plan: DatasetPlan | StrPath,
    *,
    out: StrPath,
    max_retries: int = 3,
    overwrite: bool = False,
) -> dict[str, Any]:
    """Build a data set on the cluster, or go on with a build that was interrupted.

    One task for each shard; ``shard_clips`` in the plan decides how many can run at the same time. Each uses one CPU.
    Sources that are files must be at the same place on all nodes; the text of the plan travels with the tasks.

    A task whose worker was killed runs again. A shard that fails ``max_retries`` times more ends the build with its number,
    when the others are complete. Clips that cannot be simulated are listed in the manifest instead.

    Returns clips, failed, skipped, shards, shards_made and seconds, as ``DatasetPlan.build`` does.

    :param plan: the plan or its TOML file
    :param out: folder of the data set, which all nodes share
    :param max_retries: how often a shard is tried again
    :param overwrite: replace another data set in the folder
    """
    started = time.monotonic()
    opened = plan if isinstance(plan, DatasetPlan) else DatasetPlan(plan)
    # Before the path is made absolute: an address such as s3://bucket is refused here.
    opened.prepare(out, overwrite=overwrite, wait_s=_WAIT_S)
    folder = os.path.abspath(out)
    task = _BuildShard(opened, folder, _retries(max_retries))
    rows = _each(task, list(range(opened.n_shards)), max_retries, f"{folder}: shard")
    numbers = opened.finish(folder, wait_s=_WAIT_S)
    made = sum(row["made"] for row in rows)
    return {**numbers, "shards_made": made, "seconds": time.monotonic() - started}


def describe(
    dataset: StrPath,
    *,
    out: StrPath,
    split: str = "test",
    model: StrPath | None = None,
    precision: Literal["f32", "int8"] = "f32",
    beam: int | None = None,
    batch: int = 64,
    max_retries: int = 3,
    overwrite: bool = False,
) -> dict[str, Any]:
    """Describe every clip of a split on the cluster and write the sentences as lines of JSON, in the order of the clips.

    A line is what ``Sentence.to_dict()`` gives, without the times that it took, with the ``id`` of the clip. One task for
    at most ``batch`` clips of a shard; each uses one CPU, and each worker loads the model once.

    What is described is kept in the folder ``OUT.parts`` until everything is there; then ``out`` appears at once. A call
    with other arguments than those of the interrupted one is refused, unless ``overwrite`` is true.

    Returns clips, parts, parts_made and seconds.

    :param dataset: folder of a finished data set, which all nodes share
    :param out: the file, in a folder that all nodes share
    :param split: "train", "val" or "test"
    :param model: folder of a model, which all nodes share; the one in this package if None
    :param precision: "f32" or "int8"
    :param beam: beams of a search for the most probable sentence, 1 being greedy; None: a vote among drawn sentences
    :param batch: most clips of a task
    :param max_retries: how often a part is tried again
    :param overwrite: replace the file, or parts of another call
    """
    started = time.monotonic()
    if batch < 1:
        raise Error(f"`batch` {batch}: must be at least 1")
    folder, target = os.path.abspath(dataset), Path(_local(out)).absolute()
    model_folder = None if model is None else os.path.abspath(model)
    parts = target.with_name(target.name + ".parts")
    shards = Dataset(folder).split(split)._shards
    job = {
        "version": __version__,
        "split": split,
        "shards": [hash for _, hash in shards],
        "model": _model_hash(model_folder),
        "precision": precision,
        "beam": beam,
        "batch": batch,
    }
    if target.exists() and not overwrite:
        raise ExistsError(f"{target}: already exists", hint="`overwrite=True` replaces it", path=str(target))
    _begin(parts, job, overwrite)
    pieces = [(s, a, min(a + batch, n)) for s, (n, _) in enumerate(shards) for a in range(0, n, batch)]
    task = _DescribePart(folder, split, str(parts), pieces, job, model_folder, precision, beam, _retries(max_retries))
    missing = [i for i, piece in enumerate(pieces) if _read_part(parts, i, piece) is None]
    _each(task, missing, max_retries, f"{target}: part")
    content = b"".join(_read_part(parts, i, piece) or b"" for i, piece in enumerate(pieces))
    whole = parts / "whole"
    _write(whole, content)
    os.replace(whole, target)
    _sync(target.parent)
    shutil.rmtree(parts)
    return {
        "clips": content.count(b"\n"),
        "parts": len(pieces),
        "parts_made": len(missing),
        "seconds": time.monotonic() - started,
    }


def _each(task: Callable[[_Row], _Row], numbers: list[int], max_retries: int, what: str) -> list[_Row]:
    """Run a task for each number, on Ray Data. Raises for the first number that failed, when all others are done."""
    if not numbers:
        return []
    context = ray.data.DataContext.get_current()
    allowed = context.max_errored_blocks
    # A task that fails must not end the others.
    context.max_errored_blocks = -1
    try:
        blocks = ray.data.from_items([{"number": n} for n in numbers], override_num_blocks=len(numbers))
        # A function: Ray Data takes objects that can be called for actors.
        rows = blocks.map(lambda row: task(row), num_cpus=1, max_retries=max_retries).take_all()
    finally:
        context.max_errored_blocks = allowed
    done = {row["number"]: row for row in rows}
    for number in numbers:
        if number not in done:
            problem = f"{what} {number}: its worker died {max_retries + 1} times"
            raise Error(problem, hint=f"look for its reason in Ray's log, often it is memory; {_WHAT_STAYS}")
        if done[number]["error"]:
            row = done[number]
            raise Error(f"{what} {number}: {row['error']}", hint=row["hint"] or _WHAT_STAYS)
    return [done[number] for number in numbers]


def _attempts(attempts: int, work: Callable[[], _T]) -> tuple[_T | None, str, str]:
    """Try work several times. Errors are returned: an exception would end the tasks of others."""
    for attempt in range(attempts):
        try:
            return work(), "", ""
        except (Error, OSError, RuntimeError) as error:
            message, hint = str(error.args[0] if error.args else error), getattr(error, "hint", None) or ""
            if isinstance(error, _OtherVersion) or attempt + 1 == attempts:
                times = f" (tried {attempt + 1} times)" if attempt else ""
                return None, message + times, hint
            time.sleep(min(2.0**attempt, 10.0))
    raise AssertionError("no attempt")


class _OtherVersion(Error):
    """A node is not as the coordinator."""


def _check_version(version: str) -> None:
    if version != __version__:
        raise _OtherVersion(
            f"a node has version {__version__} of radarllm, the coordinator {version}",
            hint="install the same version on all nodes",
        )


class _BuildShard:
    """Builds the shard of a row."""

    def __init__(self, plan: DatasetPlan, folder: str, attempts: int) -> None:
        self.plan = plan
        self.folder = folder
        self.attempts = attempts
        self.version = __version__

    def __call__(self, row: _Row) -> _Row:
        number = int(row["number"])
        built, error, hint = _attempts(self.attempts, lambda: self.build(number))
        return {"number": number, "made": bool(built), "error": error, "hint": hint}

    def build(self, number: int) -> bool:
        _check_version(self.version)
        plan = _opened(*self.plan.__reduce__()[1])
        made: bool = plan.build_shard(self.folder, number, threads=1)["made"]
        return made


@functools.lru_cache(maxsize=1)
def _opened(path: str, text: str) -> DatasetPlan:
    """A plan of a worker, which reads the clips of its shards from the index of the folder."""
    return DatasetPlan._restore(path, text)


class _DescribePart:
    """Describes the clips of a part and writes its file."""

    def __init__(
        self,
        folder: str,
        split: str,
        parts: str,
        pieces: list[tuple[int, int, int]],
        job: dict[str, Any],
        model: str | None,
        precision: Literal["f32", "int8"],
        beam: int | None,
        attempts: int,
    ) -> None:
        self.folder = folder
        self.split = split
        self.parts = parts
        self.pieces = pieces
        self.job = job
        self.model = model
        self.precision = precision
        self.beam = beam
        self.attempts = attempts

    def __call__(self, row: _Row) -> _Row:
        number = int(row["number"])
        _, error, hint = _attempts(self.attempts, lambda: self.describe(number))
        return {"number": number, "error": error, "hint": hint}

    def describe(self, number: int) -> None:
        _check_version(self.job["version"])
        if _model_hash(self.model) != self.job["model"]:
            raise _OtherVersion(
                f"{self.model}: a node finds another model there than the coordinator",
                hint="the folder of the model must be the same on all nodes",
            )
        rows = Dataset(self.folder).split(self.split)
        if [hash for _, hash in rows._shards] != self.job["shards"]:
            raise _OtherVersion(
                f"{self.folder}: a node finds another data set there than the coordinator",
                hint="the folder of the data set must be the same on all nodes",
            )
        shard, first, end = self.pieces[number]
        clips = list(islice(rows._shard_clips(shard), first, end))
        model = _model(self.model, self.precision)
        sentences = model.describe([clip.points for clip in clips], beam=self.beam, threads=1)
        lines = []
        for clip, sentence in zip(clips, sentences, strict=True):
            said = {"id": clip.id, **sentence.to_dict()}
            for time_or_memory in ("seconds", "peak_memory_mb"):
                said.pop(time_or_memory, None)
            lines.append(json.dumps(said, allow_nan=False) + "\n")
        _write(_part_file(Path(self.parts), number), "".join(lines).encode())


@functools.lru_cache(maxsize=1)
def _model(folder: str | None, precision: Literal["f32", "int8"]) -> Model:
    return Model(folder, precision=precision)


@functools.lru_cache(maxsize=1)
def _model_hash(folder: str | None) -> str:
    """Hash of a model's files; that of this package goes with its version."""
    if folder is None:
        return "bundled"
    # What is wrong with the folder shows before anything is hashed.
    Model(folder)
    hashes = hashlib.sha256()
    for path in sorted(p for p in Path(folder).rglob("*") if p.is_file()):
        digest = hashlib.sha256(path.read_bytes()).hexdigest()
        hashes.update(f"{path.relative_to(folder).as_posix()}\0{digest}\n".encode())
    return hashes.hexdigest()


def _begin(parts: Path, job: dict[str, Any], overwrite: bool) -> None:
    """Make the folder of the parts, or enter that of an interrupted call with the same arguments."""
    record = parts / "job.json"
    text = (json.dumps(job, indent=1) + "\n").encode()
    if record.is_file() and record.read_bytes() == text:
        return
    if parts.exists():
        ours = record.is_file() or not any(parts.iterdir())
        if not ours or (record.is_file() and not overwrite):
            hint = "`overwrite=True` starts over" if ours else "choose another `out`"
            raise ExistsError(f"{parts}: holds parts of another call", hint=hint, path=str(parts))
        shutil.rmtree(parts)
    parts.mkdir()
    _write(record, text)


def _part_file(parts: Path, number: int) -> Path:
    return parts / f"{number:06}.jsonl"


def _read_part(parts: Path, number: int, piece: tuple[int, int, int]) -> bytes | None:
    """The lines of a part, or None where it is missing or is not whole."""
    try:
        content = _part_file(parts, number).read_bytes()
    except FileNotFoundError:
        return None
    _, first, end = piece
    whole = content.endswith(b"\n") and content.count(b"\n") == end - first
    return content if whole else None


def _write(path: Path, content: bytes) -> None:
    """Write a file whole or not at all."""
    # As the files of data sets: host and process tell whose file a crash left behind, containers may agree in both.
    temporary = path.with_name(f".{path.name}.{os.uname().nodename}.{os.getpid()}.{secrets.token_hex(8)}.tmp")
    with temporary.open("wb") as file:
        file.write(content)
        file.flush()
        os.fsync(file.fileno())
    os.replace(temporary, path)
    _sync(path.parent)


def _sync(folder: Path) -> None:
    """Make renames in a folder last."""
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def _local(path: StrPath) -> str:
    text = os.fspath(path)
    scheme = text.split("://")[0]
    if "://" in text and scheme.isalnum():
        raise Error(
            f"{text}: `{scheme}:` is an address and not a file",
            hint="write to a folder that all nodes share, then upload the file",
            path=text,
        )
    return text


def _retries(max_retries: int) -> int:
    if max_retries < 0:
        raise Error(f"`max_retries` {max_retries}: must not be negative")
    return max_retries + 1
