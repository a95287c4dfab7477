"""Millimetre-wave radar to language: open recordings, simulate, track people, describe.

>>> import radarllm as rl
>>> points = rl.simulate("builtin:walk?direction=backward", radar="awr1843boost", seed=1)
>>> points["x_m"].dtype
dtype('float32')
>>> rl.Model().describe(points).segments[0].actions
['walk']

Columns and frames are NumPy arrays, tables go to any Arrow library without a copy. Everything after the first argument
is a keyword. Errors are ``Error`` (a ``ValueError``) with ``hint`` and ``path``; missing files also are
``FileNotFoundError``, existing outputs ``FileExistsError``.
"""

from ._batches import Batch, batches
from ._capture import open_capture
from ._errors import Bug, Error, ExistsError, NotFoundError
from ._native import (
    Capture,
    Clip,
    Clips,
    Cubes,
    Dataset,
    DatasetPlan,
    Memory,
    Model,
    Person,
    Points,
    Radar,
    Segment,
    Sentence,
    Split,
    __version__,
    people,
    process,
    score,
    simulate,
)

__all__ = [
    "Batch",
    "Bug",
    "Capture",
    "Clip",
    "Clips",
    "Cubes",
    "Dataset",
    "DatasetPlan",
    "Error",
    "ExistsError",
    "Memory",
    "Model",
    "NotFoundError",
    "Person",
    "Points",
    "Radar",
    "Segment",
    "Sentence",
    "Split",
    "__version__",
    "batches",
    "open_capture",
    "people",
    "process",
    "score",
    "simulate",
]
