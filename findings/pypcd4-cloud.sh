#!/usr/bin/env bash
# pypcd4 takes two valid PointCloud2 messages for other points than they hold.
#
# Guess: a reader of PointCloud2 honours `is_bigendian` and `row_step`, or refuses what it does not support.
# What happens: `PointCloud.from_msg` ignores both. Big-endian coordinates become numbers like 4.6e-41, so the whole
# cloud lies at the radar; bytes between rows become further points, at the origin if they are zero.
# Why it matters: points at the origin look like leakage between transmitter and receiver, which real firmware reports
# there, and they pass every filter on range of a few metres.
# What to do: check `is_bigendian` and `row_step == width * point_step` first. Here: bags are read with both
# (crates/formats/src/recordings/bag.rs).
source "$(dirname "$0")/lib.sh"
install numpy==2.4.6 rosbags==0.11.9 pypcd4==1.5.1
observe <<'PYTHON'
import struct

import numpy as np
from pypcd4 import PointCloud
from rosbags.typesys import Stores, get_typestore

from finding import report

types = get_typestore(Stores.ROS2_HUMBLE).types
Cloud, Field = types["sensor_msgs/msg/PointCloud2"], types["sensor_msgs/msg/PointField"]
Header, Time = types["std_msgs/msg/Header"], types["builtin_interfaces/msg/Time"]
names = ("x", "y", "z", "velocity")
points = [(1.0, 2.0, 0.5, -0.25), (1.5, 2.5, 0.75, 0.5)]


def message(order, height, gap):
    """Both points in `height` rows with `gap` bytes after each."""
    width = len(points) // height
    packed = [struct.pack(order + "4f", *p) for p in points]
    rows = [b"".join(packed[r * width : (r + 1) * width]) + bytes(gap) for r in range(height)]
    return Cloud(
        header=Header(stamp=Time(sec=1, nanosec=0), frame_id="radar"),
        height=height,
        width=width,
        fields=[Field(name=n, offset=4 * i, datatype=7, count=1) for i, n in enumerate(names)],
        is_bigendian=order == ">",
        point_step=16,
        row_step=16 * width + gap,
        data=np.frombuffer(b"".join(rows), np.uint8),
        is_dense=True,
    )


observed = []
for name, cloud in (
    ("little-endian, one row", message("<", 1, 0)),
    ("big-endian, one row", message(">", 1, 0)),
    ("little-endian, two rows with 16 bytes between", message("<", 2, 16)),
):
    read = PointCloud.from_msg(cloud).numpy(names)
    same = read.shape == (2, 4) and np.array_equal(read, np.array(points, np.float32))
    origin = int((np.linalg.norm(read[:, :3], axis=1) < 1e-6).sum())
    observed.append(f"{name}: {'as written' if same else 'changed'}, {len(read)} points, {origin} within 1 um of the origin")
report(
    "as written, 2 points, in all three (or an error)",
    observed,
    [
        "little-endian, one row: as written, 2 points, 0 within 1 um of the origin",
        "big-endian, one row: changed, 2 points, 2 within 1 um of the origin",
        "little-endian, two rows with 16 bytes between: changed, 4 points, 2 within 1 um of the origin",
    ],
)
PYTHON
