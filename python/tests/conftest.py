"""Inputs that the tests make themselves, and the command to compare with."""

from __future__ import annotations

import json
import os
import shutil
import struct
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import recordings

import radarllm as rl

WALK = "builtin:walk?direction=backward"


def command() -> list[str]:
    """The `radarllm` command: that of RADARLLM_COMMAND (a build of the repository), else the one of this package."""
    named = os.environ.get("RADARLLM_COMMAND")
    if named:
        return [named]
    beside = Path(sys.executable).with_name("radarllm")
    if beside.exists():
        return [str(beside)]
    found = shutil.which("radarllm")
    if found:
        return [found]
    pytest.skip("no radarllm command; RADARLLM_COMMAND names one")


@pytest.fixture(scope="session")
def run():
    """Run the command and return what it printed."""
    program = command()

    def run(*args: object, code: int = 0) -> str:
        done = subprocess.run([*program, *map(str, args)], capture_output=True, text=True, timeout=600)
        assert done.returncode == code, done.stderr
        return done.stdout if code == 0 else done.stderr

    return run


@pytest.fixture(scope="session")
def described(run):
    """Describe an input by the command and return its row."""

    def described(*args: object) -> dict:
        row = json.loads(run("describe", *args, "--json"))
        return row

    return described


@pytest.fixture(scope="session")
def model() -> rl.Model:
    return rl.Model()


@pytest.fixture(scope="session")
def walk() -> rl.Points:
    return rl.simulate(WALK)


@pytest.fixture(scope="session")
def cubes() -> np.ndarray:
    """Three frames of raw samples of a walking person: complex64 [frame, loop, tx, rx, sample]."""
    frames = rl.simulate("builtin:walk", radar="iwr6843isk", emit="cubes")
    return np.stack([cube for cube, _ in zip(frames, range(3))])


def uart(n_frames: int = 60) -> bytes:
    """A stream of TI's out-of-box demo: twelve points a frame that move, about the size of a person."""
    rng = np.random.default_rng(4)
    out = b""
    for number in range(n_frames):
        points = rng.normal((0.2, 2.5, 0.0), (0.2, 0.2, 0.4), (12, 3))
        velocity = rng.normal(0.6, 0.2, (12, 1))
        values = np.hstack([points, velocity]).astype("<f4").tobytes()
        length = -(-(40 + 8 + len(values)) // 32) * 32
        header = bytes([2, 1, 4, 3, 6, 5, 8, 7])
        header += struct.pack("<8I", 0x03060000, length, 0xA6843, number, number * 100, 12, 1, 0)
        packet = header + struct.pack("<2I", 1, len(values)) + values
        out += packet.ljust(length, b"\0")
    return out


@pytest.fixture(scope="session")
def files(tmp_path_factory, cubes, walk) -> dict[str, tuple[Path, dict, list]]:
    """Recordings of several formats: path, keywords of `open_capture`, flags of the command."""
    folder = tmp_path_factory.mktemp("files")
    made: dict[str, tuple[Path, dict, list]] = {}

    path = folder / "uart.dat"
    path.write_bytes(uart())
    made["uart"] = (path, {"radar": "iwr6843isk"}, ["--radar", "iwr6843isk"])

    path = folder / "raw.npy"
    np.save(path, cubes)
    made["npy"] = (path, {"radar": "iwr6843isk"}, ["--radar", "iwr6843isk"])

    path = folder / "other.npy"
    turned = np.ascontiguousarray(cubes.transpose(0, 4, 3, 1, 2))
    np.save(path, turned)
    axes = "frame,sample,rx,loop,tx"
    made["npy axes"] = (
        path,
        {"radar": "iwr6843isk", "axes": axes},
        ["--radar", "iwr6843isk", "--axes", axes],
    )

    # Counts of an ADC: I first, as mmWave Studio writes them, two values of I and then two of Q.
    path = folder / "adc_data.bin"
    scale = 2000.0 / np.abs(cubes).max()
    counts = np.round(cubes * scale)
    pairs = counts.reshape(*counts.shape[:-1], -1, 2)
    words = np.concatenate([pairs.real, pairs.imag], axis=-1).astype("<i2")
    path.write_bytes(words.tobytes())
    made["adc"] = (
        path,
        {"radar": "iwr6843isk", "iq": "i-first", "lanes": 2},
        ["--radar", "iwr6843isk", "--iq", "i-first", "--lanes", "2"],
    )

    path = folder / "adc.pcap"
    path.write_bytes(recordings.pcap(words.tobytes()))
    made["pcap"] = (path, made["adc"][1], made["adc"][2])

    frames = [walk.frame(number) for number in range(len(walk))]
    path = folder / "walk.txt"
    path.write_text(recordings.radhar(frames))
    made["radhar"] = (path, {}, [])

    path = folder / "mars.csv"
    path.write_text(recordings.mars(frames))
    made["mars"] = (path, {}, [])

    path = folder / "walk.bag"
    path.write_bytes(recordings.bag(frames))
    made["bag"] = (path, {}, [])

    path = folder / "walk.parquet"
    walk.write(path)
    made["points"] = (path, {}, [])

    path = folder / "points.csv"
    rows = ["frame,x,y,z,velocity,intensity"]
    for number in range(len(walk)):
        for x, y, z, _range, velocity, intensity in walk.frame(number).tolist():
            rows.append(f"{number},{x},{y},{z},{velocity},{intensity}")
    path.write_text("\n".join(rows) + "\n")
    orientation = "right-forward-up"
    made["csv"] = (
        path,
        {"frame_rate_hz": 10.0, "orientation": orientation},
        ["--frame-rate", "10", "--orientation", orientation],
    )
    return made
