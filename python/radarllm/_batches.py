"""Batches for training."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ._errors import Error
from ._native import Dataset, Split, _ClipPoints

# Shards whose clips are shuffled together: more mix better and need more memory.
_SHARDS_TOGETHER = 8


@dataclass(frozen=True, eq=False)
class Batch:
    """Clips of a data set, padded to one shape. B clips, T frames of the longest one, N points of a frame at most.

    A frame with more than N points keeps the N strongest ones. Where ``mask`` is False, ``points`` is 0.
    """

    points: NDArray[np.float32]
    """x, y, z, range in m, radial velocity in m/s (positive when receding), intensity in dB: (B, T, N, 6)."""
    mask: NDArray[np.bool_]
    """Which points there are: (B, T, N)."""
    lengths: NDArray[np.int64]
    """Frames of each clip: (B,)."""
    captions: list[list[str]]
    """The sentences about each clip, at least one for each."""
    actions: list[str]
    """Action label of each clip."""
    ids: list[str]
    """Id of each clip."""

    def __len__(self) -> int:
        return len(self.ids)


def batches(
    dataset: Dataset | str | os.PathLike[str],
    *,
    split: str = "train",
    batch: int = 16,
    max_points: int = 128,
    max_frames: int | None = None,
    seed: int | None = None,
    part: tuple[int, int] = (0, 1),
    drop_last: bool = False,
) -> Iterator[Batch]:
    """Read a split of a data set once, in batches of padded arrays.

    Points are gathered from the columns of the file without building clips, so that a batch takes milliseconds. The hash
    of every shard is compared with the manifest.

    >>> import tempfile, pathlib, radarllm as rl
    >>> folder = pathlib.Path(tempfile.mkdtemp())
    >>> _ = (folder / "plan.toml").write_text('''
    ... max_frames = 5
    ... facet_edge_m = 0.05
    ... [[source]]
    ... kind = "procedural"
    ... train = 2
    ... val = 1
    ... test = 1
    ... ''')
    >>> _ = rl.DatasetPlan(folder / "plan.toml").build(folder / "data")
    >>> (b,) = rl.batches(folder / "data", batch=2, max_points=32)
    >>> b.points.shape, b.mask.shape, b.lengths.tolist(), len(b.captions)
    ((2, 5, 32, 6), (2, 5, 32), [5, 5], 2)

    :param dataset: a finished data set or its folder
    :param split: "train", "val" or "test"
    :param batch: clips of a batch; the last one may have fewer
    :param max_points: points of a frame, N
    :param max_frames: keep the first frames of longer clips
    :param seed: shuffle the clips, differently for each seed: give another one each epoch; in file order if None
    :param part: ``(i, n)`` reads every n-th shard from the i-th on, for process i of n
    :param drop_last: leave out the last batch if it has fewer clips
    """
    for name, value in (("batch", batch), ("max_points", max_points), ("max_frames", max_frames)):
        if value is not None and not 1 <= value <= 1_000_000:
            raise Error(f"`{name}` {value}: must be 1 to 1000000")
    index, of = part
    if not 0 <= index < of:
        raise Error(f"`part` {part}: must be (i, n) with 0 <= i < n")
    if seed is not None and seed < 0:
        raise Error(f"`seed` {seed}: must not be negative")
    opened = dataset if isinstance(dataset, Dataset) else Dataset(dataset)
    rows = opened.split(split)
    # Checked here and not at the first batch, which may be far away.
    return _batches(rows, batch, max_points, max_frames, seed, part, drop_last)


class _Piece:
    """Clips that lie one after the other in a file."""

    def __init__(self, clips: _ClipPoints) -> None:
        self.points = clips.points
        self.frame_offsets = clips.frame_offsets
        self.clip_offsets = clips.clip_offsets
        self.captions = clips.captions
        self.actions = clips.actions
        self.ids = clips.ids


def _batches(
    rows: Split,
    batch: int,
    max_points: int,
    max_frames: int | None,
    seed: int | None,
    part: tuple[int, int],
    drop_last: bool,
) -> Iterator[Batch]:
    index, of = part
    n_shards = len(rows._shards)
    shards = np.arange(n_shards) if seed is None else np.random.default_rng(seed).permutation(n_shards)
    shards = shards[index::of]
    together = 1 if seed is None else _SHARDS_TOGETHER
    ready: list[tuple[_Piece, int]] = []
    for first in range(0, len(shards), together):
        clips: list[tuple[_Piece, int]] = []
        for shard in shards[first : first + together]:
            for read in rows._shard_points(int(shard)):
                piece = _Piece(read)
                clips += [(piece, i) for i in range(len(read))]
        if seed is not None:
            order = np.random.default_rng((seed, index, first)).permutation(len(clips))
            clips = [clips[i] for i in order]
        ready += clips
        while len(ready) >= batch:
            yield _padded(ready[:batch], max_points, max_frames)
            ready = ready[batch:]
    if ready and not drop_last:
        yield _padded(ready, max_points, max_frames)


def _padded(clips: list[tuple[_Piece, int]], max_points: int, max_frames: int | None) -> Batch:
    lengths = np.array([p.clip_offsets[i + 1] - p.clip_offsets[i] for p, i in clips], np.int64)
    if max_frames is not None:
        lengths = np.minimum(lengths, max_frames)
    shape = (len(clips), int(lengths.max(initial=0)), max_points)
    points = np.zeros((*shape, 6), np.float32)
    mask = np.zeros(shape, np.bool_)
    slots = np.arange(max_points)
    for row, (p, i) in enumerate(clips):
        first, length = p.clip_offsets[i], lengths[row]
        offsets = p.frame_offsets[first : first + length + 1]
        # The points of a frame are stored with the strongest first.
        there = slots < np.diff(offsets)[:, None]
        mask[row, :length] = there
        points[row, :length][there] = p.points[(offsets[:-1, None] + slots)[there]]
    return Batch(
        points=points,
        mask=mask,
        lengths=lengths,
        captions=[p.captions[i] for p, i in clips],
        actions=[p.actions[i] for p, i in clips],
        ids=[p.ids[i] for p, i in clips],
    )
