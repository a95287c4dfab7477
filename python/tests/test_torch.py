"""`radarllm.torch`: workers by fork and spawn, epochs, and the training loop of `examples/`. Needs torch."""

from __future__ import annotations

import itertools
import multiprocessing
import os
from pathlib import Path

import numpy as np
import pytest

import radarllm as rl

torch = pytest.importorskip("torch", reason="torch is not installed")

EXAMPLE = Path(__file__).parents[2] / "examples/train_torch.py"
PLAN = """
name = "loading"
shard_clips = 2
max_frames = 10
facet_edge_m = 0.05
[[source]]
kind = "procedural"
train = 24
val = 1
test = 4
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("torch")
    (folder / "plan.toml").write_text(PLAN)
    rl.DatasetPlan(folder / "plan.toml").build(folder / "data")
    return folder / "data"


def loader(data, **keywords):
    return torch.utils.data.DataLoader(data, batch_size=None, **keywords)


def test_tensors_are_those_of_batches(folder):
    from radarllm.torch import RadarText

    data = RadarText(folder, batch=5, max_points=16)
    assert data.n_clips == 24
    for ours, theirs in itertools.zip_longest(loader(data), rl.batches(folder, batch=5, max_points=16)):
        assert ours["points"].dtype == torch.float32 and ours["mask"].dtype == torch.bool
        np.testing.assert_array_equal(ours["points"].numpy(), theirs.points)
        np.testing.assert_array_equal(ours["mask"].numpy(), theirs.mask)
        np.testing.assert_array_equal(ours["lengths"].numpy(), theirs.lengths)
        assert (ours["captions"], ours["actions"], ours["ids"]) == (theirs.captions, theirs.actions, theirs.ids)


def test_two_hundred_batches_by_fork_and_spawn(folder):
    """The same batches by seed, whether the workers are forked (after this process has used its threads) or spawned."""
    from radarllm.torch import RadarText

    rl.Model().describe([rl.simulate("builtin:walk")] * 2)
    found = {}
    for method in ("fork", "spawn"):
        if method not in multiprocessing.get_all_start_methods():
            pytest.skip(f"this system cannot {method}")
        data = RadarText(folder, batch=1, seed=3)
        ids = []
        # Eight epochs of 24 clips and more.
        for epoch in itertools.count():
            data.set_epoch(epoch)
            workers = loader(data, num_workers=2, multiprocessing_context=method, timeout=120)
            for batch in workers:
                assert batch["points"].shape[0] == 1
                ids += batch["ids"]
            if len(ids) >= 200:
                break
        found[method] = ids
    assert found["fork"] == found["spawn"] and len(found["fork"]) >= 200
    epochs = [tuple(found["fork"][i : i + 24]) for i in range(0, len(found["fork"]), 24)]
    assert all(len(set(epoch)) == 24 for epoch in epochs) and len(set(epochs)) == len(epochs)


def test_persistent_workers_see_the_epoch(folder):
    from radarllm.torch import RadarText

    data = RadarText(folder, batch=4, seed=3)
    kept = loader(data, num_workers=2, persistent_workers=True, timeout=120)

    def ids(epoch):
        data.set_epoch(epoch)
        return [id for batch in kept for id in batch["ids"]]

    first, second, again = ids(0), ids(1), ids(0)
    assert first == again != second and sorted(first) == sorted(second)


def test_wrong_arguments_are_refused_before_workers_start(folder):
    from radarllm.torch import RadarText

    with pytest.raises(rl.Error, match="`batch` 0"):
        RadarText(folder, batch=0)
    with pytest.raises(FileNotFoundError):
        RadarText(folder / "none")


@pytest.mark.skipif(not EXAMPLE.exists(), reason="no examples beside the tests")
def test_the_training_loop_runs(folder, monkeypatch, capsys):
    code = EXAMPLE.read_text()
    loop = code.split("# The training loop.")[1].split("# What it says")[0]
    assert len([line for line in loop.splitlines() if line.strip()]) <= 40
    monkeypatch.setattr("sys.argv", [str(EXAMPLE), os.fspath(folder), "2"])
    torch.manual_seed(0)
    exec(compile(code, str(EXAMPLE), "exec"), {"__name__": "__main__"})
    assert "BLEU-4" in capsys.readouterr().out
