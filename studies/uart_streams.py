"""Are the points of TI's UART streams read right? Streams of every layout are made with random values by `struct`, and
what the library reads from them is compared with the values that went in.

    cargo build -p radarllm-formats --example uart_points
    python3 studies/uart_streams.py target/debug/examples/uart_points [STREAM...]

Of streams that are named, the points are compared with those of a parser of 20 lines (SDK 3: TLVs 1, 7, 1000, 1020,
3001). Python's standard library is enough. Layouts: `mmw_output.h` of TI's demos and labs, `parseTLVs.py` of the
visualizer of the Radar Toolbox, and the ROS driver of TI for the peak of SDK 1 and 2.
"""

import math
import random
import struct
import subprocess
import sys
import tempfile
from pathlib import Path

MAGIC = bytes([2, 1, 4, 3, 6, 5, 8, 7])
STEP_MPS = 0.25


def place(r, azimuth, elevation):
    return (r * math.cos(elevation) * math.sin(azimuth), r * math.cos(elevation) * math.cos(azimuth), r * math.sin(elevation))


def db(ratio):
    return 10 * math.log10(ratio)


def floats(*values):
    return struct.pack(f"<{len(values)}f", *values)


def random_polar(rng):
    return rng.uniform(0.3, 8), rng.uniform(-1, 1), rng.uniform(-0.5, 0.5), rng.uniform(-3, 3), rng.uniform(2, 900)


def packet(header, tlvs, own=0):
    """`header` makes the header of a total length and a number of TLVs."""
    body = b"".join(struct.pack("<2I", kind, len(payload) + own) + payload for kind, payload in tlvs)
    n_header = len(header(0, 0))
    total = -(-(n_header + len(body)) // 32) * 32
    return (header(total, len(tlvs)) + body).ljust(total, b"\x0f")


def plain_header(version, platform, number, n_objects, more=None, subframe=True):
    def header(total, n_tlvs):
        words = [version, total, platform, number, 7 * number, n_objects]
        words += ([] if more is None else [more]) + [n_tlvs] + ([0] if subframe else [])
        return MAGIC + struct.pack(f"<{len(words)}I", *words)
    return header


def lab_header(number):
    def header(total, n_tlvs):
        start = MAGIC + struct.pack("<10IH", 0x03010102, 0xA6843, 0, total, number, 0, 9, 9, 9, 9, n_tlvs)
        total_of_words = sum(struct.unpack("<25H", start))
        total_of_words = (total_of_words & 0xFFFF) + (total_of_words >> 16)
        return start + struct.pack("<H", ~total_of_words & 0xFFFF)
    return header


def cartesian(rng, n):
    points = [(rng.uniform(-3, 3), rng.uniform(0.3, 8), rng.uniform(-1, 1), rng.uniform(-3, 3), rng.randrange(50, 400)) for _ in range(n)]
    tlvs = [(1, b"".join(floats(*p[:4]) for p in points)), (7, b"".join(struct.pack("<2h", p[4], 300) for p in points))]
    return tlvs, [p[:4] + (0.1 * p[4],) for p in points]


def objects(rng, n):
    rows = [(rng.randrange(256), rng.randrange(-8, 8), rng.randrange(1, 60000), *(rng.randrange(-1500, 1500) for _ in range(3))) for _ in range(n)]
    payload = struct.pack("<2H", n, 8) + b"".join(struct.pack("<HhH3h", *row) for row in rows)
    return [(1, payload), (2, bytes(128))], [tuple(v / 256 for v in row[3:]) + (STEP_MPS * row[1], db(row[2] + 1)) for row in rows]


def spherical(rng, n):
    points = [random_polar(rng) for _ in range(n)]
    return [(1000, b"".join(floats(*p[:4]) for p in points))], [place(*p[:3]) + (p[3], 0) for p in points]


def overhead(rng, n):
    points = [random_polar(rng) for _ in range(n)]
    return [(6, b"".join(floats(*p) for p in points))], [place(*p[:3]) + (p[3], db(p[4])) for p in points]


def compressed(rng, n, kind=1020):
    units = [0.01, 0.01, 0.002, 0.0005, 0.04]
    units = struct.unpack("<5f", struct.pack("<5f", *units))
    rows = [(rng.randrange(-60, 60), rng.randrange(-100, 100), rng.randrange(-1500, 1500), rng.randrange(600, 16000), rng.randrange(50, 20000)) for _ in range(n)]
    expected = [place(row[3] * units[3], row[1] * units[1], row[0] * units[0]) + (row[2] * units[2], db(row[4] * units[4])) for row in rows]
    return [(kind, floats(*units) + b"".join(struct.pack("<2bh2H", *row) for row in rows))], expected


def stream(layout, rng, n_frames=80):
    """A stream that begins with an empty room, and the points of its frames."""
    data, expected = b"", []
    for number in range(n_frames):
        n = 0 if number < 15 else rng.randrange(1, 20)
        more = 0 if n == 0 else rng.randrange(1, 5)
        make = {"sdk1": objects, "sdk2": objects, "sdk3": cartesian, "1000": spherical, "1020": compressed, "overhead": overhead, "6844": compressed}[layout]
        tlvs, points = ([], []) if n == 0 else make(rng, n)
        if layout == "6844" and n:
            minor, minor_points = compressed(rng, more, 3001)
            tlvs, points = tlvs + minor, points + minor_points
        header = {
            "sdk1": plain_header(0x01010004, 0xA1443, number, n, subframe=False),
            "sdk2": plain_header(0x02010004, 0xA1642, number, n),
            "6844": plain_header(0x01000005, 0xA6844, number, n, more),
        }.get(layout, plain_header(0x03060000, 0xA6843, number, n))
        data += packet(lab_header(number), tlvs, 8) if layout == "overhead" else packet(header, tlvs)
        expected.append(points)
    return data, expected


def plain_parser(data):
    """Points of every packet of a whole stream of SDK 3."""
    frames, at = [], data.find(MAGIC)
    while at >= 0:
        total, n_tlvs = struct.unpack_from("<I", data, at + 12)[0], struct.unpack_from("<I", data, at + 32)[0]
        points, side, place_of = [], [], at + 40
        for _ in range(n_tlvs):
            kind, length = struct.unpack_from("<2I", data, place_of)
            payload, place_of = data[place_of + 8:place_of + 8 + length], place_of + 8 + length
            if kind == 1:
                points += [p + (0,) for p in struct.iter_unpack("<4f", payload)]
            elif kind == 1000:
                points += [place(*p[:3]) + (p[3], 0) for p in struct.iter_unpack("<4f", payload)]
            elif kind == 7:
                side = [0.1 * snr for snr, _ in struct.iter_unpack("<2h", payload)]
            elif kind in (1020, 3001):
                u = struct.unpack_from("<5f", payload)
                points += [place(r * u[3], a * u[1], e * u[0]) + (v * u[2], db(s * u[4])) for e, a, v, r, s in struct.iter_unpack("<2bh2H", payload[20:])]
        frames.append([p[:4] + (s,) for p, s in zip(points, side)] if len(side) == len(points) else points)
        at = data.find(MAGIC, at + max(total, 8))
    return frames


def compare(program, name, path, expected):
    run = subprocess.run([program, path, str(STEP_MPS)], capture_output=True, text=True, check=True)
    found = []
    for line in run.stdout.splitlines()[1:]:
        cells = line.split(",")
        if cells[1] == "":
            found.append([])
        else:
            found[-1].append([float(c) for c in cells[1:]])
    counts = [len(points) for points in found]
    if counts != [len(points) for points in expected]:
        sys.exit(f"{name}: {len(found)} frames with {sum(counts)} points, expected {len(expected)} with {sum(map(len, expected))}")
    pairs = [(p, q) for a, b in zip(found, expected) for p, q in zip(a, b)]
    largest = max(abs(x - y) for p, q in pairs for x, y in zip(p, q))
    dialect = run.stderr.split(",")[0]
    print(f"{name:24} {dialect:14} {len(found):5} frames {len(pairs):6} points, largest difference {largest:.1e}")
    if largest > 1e-4:
        sys.exit(f"{name}: differs")


def main():
    program, *streams = sys.argv[1:]
    with tempfile.TemporaryDirectory() as folder:
        for layout in ["sdk1", "sdk2", "sdk3", "1000", "1020", "overhead", "6844"]:
            data, expected = stream(layout, random.Random(layout))
            path = Path(folder) / "stream.bin"
            path.write_bytes(data)
            compare(program, layout, path, expected)
    for path in streams:
        compare(program, Path(path).name[:24], path, plain_parser(Path(path).read_bytes()))


main()
