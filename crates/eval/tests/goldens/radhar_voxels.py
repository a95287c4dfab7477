"""Goldens of RadHAR's voxels: python3 radhar_voxels.py (NumPy 2.4.6), in this folder.

Writes radhar_points.csv (made frames: frame, forward, left, up in m, as 32-bit numbers) and radhar_voxels.csv (frame,
forward, left, up, count). The rule, as described for RadHAR's preprocessing: 10 x 32 x 32 intervals between the minimum
and the maximum of each coordinate of the frame. A point of interval k, counted from 0, is in cell k + 1; cell 0 is empty,
and the points of the last interval are dropped. An interval contains its lower edge and not its upper one.
"""

import numpy as np

GRID = (10, 32, 32)
rng = np.random.default_rng(49)
frames = [
    # Sizes of frames of RadHAR's recordings, at places and scales of a room.
    rng.normal([1.8, 0.1, 0.0], [0.6, 0.5, 0.4], (24, 3)),
    rng.uniform([0.2, -2.0, -1.0], [5.0, 2.0, 1.4], (16, 3)),
    # Steps of 1/512 m, as the firmware sends them.
    np.round(rng.normal([2.0, 0.0, 0.3], 0.3, (20, 3)) * 512) / 512,
    # Points exactly on edges: eighths of an extent of one.
    np.array([[i / 8, i / 8, i / 8] for i in range(9)]),
    # No extent in one direction, so that every point is dropped; a single point.
    np.array([[1.0, 0.0, 0.5], [1.0, 1.0, 0.7], [1.0, 2.0, 0.1]]),
    np.array([[1.0, 0.0, 0.5]]),
    # Many points in few cells.
    np.concatenate([rng.normal(0.5, 0.02, (40, 3)), [[0, 0, 0], [1, 1, 1]]]),
]
with open("radhar_points.csv", "w") as points, open("radhar_voxels.csv", "w") as voxels:
    for number, frame in enumerate(frames):
        frame = frame.astype(np.float32)
        for row in frame:
            print(number, *(repr(float(v)) for v in row), sep=",", file=points)
        frame = frame.astype(np.float64)
        low, high = frame.min(axis=0), frame.max(axis=0)
        cells = np.empty(frame.shape, int)
        kept = np.ones(len(frame), bool)
        for axis, n in enumerate(GRID):
            steps = np.full(n - 1, (high[axis] - low[axis]) / n)
            edges = np.cumsum(np.concatenate([[low[axis]], steps]))
            cells[:, axis] = np.searchsorted(edges, frame[:, axis], side="right")
            kept &= cells[:, axis] < n
        counts = np.zeros(GRID, int)
        np.add.at(counts, tuple(cells[kept].T), 1)
        for cell in np.argwhere(counts):
            print(number, *cell, counts[tuple(cell)], sep=",", file=voxels)
