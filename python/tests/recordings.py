"""Small recordings and motion files of several formats, made up."""

from __future__ import annotations

import math
import struct

import numpy as np

# A person in centimetres: name, parent, offset (y up, facing z, left at positive x).
PERSON = [
    ("Hips", -1, (0, 95, 0)),
    ("LeftUpLeg", 0, (9, -5, 0)),
    ("LeftLeg", 1, (0, -42, 0)),
    ("LeftFoot", 2, (0, -40, 0)),
    ("LeftToeBase", 3, (0, -5, 13)),
    ("RightUpLeg", 0, (-9, -5, 0)),
    ("RightLeg", 5, (0, -42, 0)),
    ("RightFoot", 6, (0, -40, 0)),
    ("RightToeBase", 7, (0, -5, 13)),
    ("Spine", 0, (0, 12, 0)),
    ("Spine1", 9, (0, 25, 0)),
    ("Head", 10, (0, 25, 2)),
    ("LeftArm", 10, (17, 12, 0)),
    ("LeftForeArm", 12, (27, 0, 0)),
    ("LeftHand", 13, (25, 0, 0)),
    ("RightArm", 10, (-17, 12, 0)),
    ("RightForeArm", 15, (-27, 0, 0)),
    ("RightHand", 16, (-25, 0, 0)),
]


def bvh(n_frames: int = 75) -> str:
    """Somebody who strides forward at 0.8 m/s with hanging arms, at 30 Hz."""
    lines = ["HIERARCHY"]
    open_joints: list[int] = []
    for i, (name, parent, (x, y, z)) in enumerate(PERSON):
        while open_joints and open_joints[-1] != parent:
            lines.append("}")
            open_joints.pop()
        kind, channels = ("JOINT", "3") if open_joints else ("ROOT", "6 Xposition Yposition Zposition")
        lines += [f"{kind} {name}", "{", f"OFFSET {x} {y} {z}", f"CHANNELS {channels} Zrotation Xrotation Yrotation"]
        if i not in [p for _, p, _ in PERSON]:
            lines += ["End Site", "{", "OFFSET 0 0 1", "}"]
        open_joints.append(i)
    lines += ["}"] * len(open_joints) + ["MOTION", f"Frames: {n_frames}", "Frame Time: 0.0333333"]
    for frame in range(n_frames):
        stride = math.sin(2 * math.pi * 0.9 * frame / 30)
        x_deg = {1: -25 * stride, 5: 25 * stride, 2: 20 + 20 * stride, 6: 20 - 20 * stride}
        z_deg = {12: -70, 15: 70}
        angles = [f"{z_deg.get(j, 0)} {x_deg.get(j, 0):.3f} 0" for j in range(len(PERSON))]
        lines.append(f"0 95 {80 * frame / 30:.3f} " + " ".join(angles))
    return "\n".join(lines) + "\n"


def radhar(frames: list[np.ndarray], frame_rate_hz: float = 30.0) -> str:
    """Points as RadHAR stores them: x forward, y to the left."""
    out = []
    for number, points in enumerate(frames):
        nanoseconds = round(number / frame_rate_hz * 1e9)
        for index, (x, y, z, _range, velocity, intensity) in enumerate(points.tolist()):
            out.append(
                f"header:\n  seq: {number}\n  stamp:\n    secs: {1_500_000_000 + nanoseconds // 1_000_000_000}\n"
                f"    nsecs: {nanoseconds % 1_000_000_000}\npoint_id: {index}\nx: {y}\ny: {-x}\nz: {z}\n"
                f"velocity: {velocity}\nintensity: {intensity}\n---\n"
            )
    return "".join(out)


def mars(frames: list[np.ndarray]) -> str:
    """Points as the tables of MARS store them, with the amplitude of the peak."""
    out = ["Frame #,# Obj,X,Y,Z,Doppler,Intensity,Abs Time"]
    for number, points in enumerate(frames):
        for x, y, z, _range, velocity, intensity in points.tolist():
            out.append(f"{number},{len(points)},{x},{y},{z},{velocity},{10 ** (intensity / 20)},1")
    return "\n".join(out) + "\n"


def bag(frames: list[np.ndarray], frame_rate_hz: float = 10.0) -> bytes:
    """A ROS 1 bag 2.0 with one `sensor_msgs/PointCloud2` for each frame: x forward, y to the left."""

    def block(data: bytes) -> bytes:
        return struct.pack("<I", len(data)) + data

    def record(fields: dict[str, bytes], data: bytes) -> bytes:
        header = b"".join(block(name.encode() + b"=" + value) for name, value in fields.items())
        return block(header) + block(data)

    connection = {"op": b"\x07", "conn": bytes(4), "topic": b"/radar"}
    described = b"".join(block(f) for f in (b"topic=/radar", b"type=sensor_msgs/PointCloud2"))
    records = [record(connection, described)]
    fields = b"".join(
        block(name.encode()) + struct.pack("<IBI", 4 * i, 7, 1)
        for i, name in enumerate(["x", "y", "z", "intensity", "velocity"])
    )
    for number, points in enumerate(frames):
        values = points[:, [1, 0, 2, 5, 4]].astype("<f4")
        values[:, 1] *= -1
        nanoseconds = round(number / frame_rate_hz * 1e9)
        stamp = struct.pack("<II", 100 + nanoseconds // 1_000_000_000, nanoseconds % 1_000_000_000)
        message = struct.pack("<I", number) + stamp + block(b"radar") + struct.pack("<III", 1, len(values), 5) + fields
        message += struct.pack("<BII", 0, 20, 20 * len(values)) + block(values.tobytes()) + b"\x01"
        records.append(record({"op": b"\x02", "conn": bytes(4), "time": bytes(8)}, message))
    data = b"".join(records)
    chunk = record({"op": b"\x05", "compression": b"none", "size": struct.pack("<I", len(data))}, data)
    return b"#ROSBAG V2.0\n" + record({"op": b"\x03", "index_pos": bytes(8)}, b" " * 64) + chunk


def pcap(stream: bytes, payload: int = 1456) -> bytes:
    """The words of a capture card as UDP datagrams to port 4098 in a pcap file."""
    out = struct.pack("<IHHiIII", 0xA1B2C3D4, 2, 4, 0, 0, 65535, 1)
    for number, at in enumerate(range(0, len(stream), payload)):
        content = struct.pack("<I", number + 1) + struct.pack("<Q", at)[:6] + stream[at : at + payload]
        udp = struct.pack(">HHHH", 4098, 4098, 8 + len(content), 0) + content
        ip = struct.pack(">BBHHHBBH", 0x45, 0, 20 + len(udp), 0, 0x4000, 64, 17, 0)
        packet = bytes([2] * 12) + b"\x08\x00" + ip + bytes([192, 168, 33, 180, 192, 168, 33, 30]) + udp
        out += struct.pack("<IIII", 7, 9, len(packet), len(packet)) + packet
    return out
