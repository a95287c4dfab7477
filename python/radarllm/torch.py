"""Data sets for PyTorch, which this package does not install.

>>> from torch.utils.data import DataLoader
>>> from radarllm.torch import RadarText
>>> data = RadarText("work/data", split="train", batch=32, seed=1)  # doctest: +SKIP
>>> for batch in DataLoader(data, batch_size=None, num_workers=2):  # doctest: +SKIP
...     batch["points"], batch["mask"], batch["captions"]
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from typing import Any

import torch
from torch.utils.data import IterableDataset, get_worker_info

from ._batches import batches
from ._native import Dataset

__all__ = ["RadarText"]


class RadarText(IterableDataset[dict[str, Any]]):
    """A split of a data set as batches of tensors: give it to a ``DataLoader`` with ``batch_size=None``.

    A batch is a dict: "points" float32 (B, T, N, 6), "mask" bool (B, T, N), "lengths" int64 (B,), and the lists
    "captions" (the sentences about each clip), "actions" and "ids". ``radarllm.batches`` says what they mean.

    Workers of the loader share the shards among them; a worker needs at least one. The batches and their order depend on
    ``seed``, the epoch and the number of workers alone, whether workers are forked or spawned. Call ``set_epoch``
    before each epoch: it changes the order, also for persistent workers.

    :param dataset: folder of a finished data set
    :param split: "train", "val" or "test"
    :param batch: clips of a batch
    :param max_points: points of a frame, N
    :param max_frames: keep the first frames of longer clips
    :param seed: shuffle the clips; in file order if None
    :param part: ``(i, n)`` reads the shards of process i of n, for training with several processes
    :param drop_last: leave out the last batch of each worker if it has fewer clips
    """

    def __init__(
        self,
        dataset: str | os.PathLike[str],
        *,
        split: str = "train",
        batch: int = 16,
        max_points: int = 128,
        max_frames: int | None = None,
        seed: int | None = None,
        part: tuple[int, int] = (0, 1),
        drop_last: bool = False,
    ) -> None:
        super().__init__()
        self._folder = os.fspath(dataset)
        self._options: dict[str, Any] = {
            "split": split,
            "batch": batch,
            "max_points": max_points,
            "max_frames": max_frames,
            "drop_last": drop_last,
        }
        self._seed = seed
        self._part = part
        # Shared with workers that run already.
        self._epoch: torch.Tensor = torch.zeros((), dtype=torch.int64)
        self._epoch.share_memory_()  # type: ignore[no-untyped-call, unused-ignore]
        # What is wrong with the arguments shows here, not in a worker.
        self.n_clips = len(Dataset(self._folder).split(split))
        batches(self._folder, seed=seed, part=part, **self._options)

    def set_epoch(self, epoch: int) -> None:
        """Choose the order of an epoch, from 0 on."""
        self._epoch.fill_(epoch)

    def __iter__(self) -> Iterator[dict[str, Any]]:
        worker = get_worker_info()
        index, of = self._part
        if worker is not None:
            index, of = index * worker.num_workers + worker.id, of * worker.num_workers
        seed = None
        if self._seed is not None:
            # Far from the seeds that users choose, so that epoch 1 of seed 1 is not epoch 0 of seed 2.
            seed = self._seed + 1_000_003 * int(self._epoch)
        for b in batches(self._folder, seed=seed, part=(index, of), **self._options):
            yield {
                "points": torch.from_numpy(b.points),
                "mask": torch.from_numpy(b.mask),
                "lengths": torch.from_numpy(b.lengths),
                "captions": b.captions,
                "actions": b.actions,
                "ids": b.ids,
            }
