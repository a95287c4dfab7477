"""Raw samples to points by RadarLLM, xwr and OpenRadar, timed and compared with a known target.

    pip install dist/radarllm-*.whl xwr==0.5.1 numpy==1.26.4 scipy==1.13.1 scikit-learn==1.5.2
    pip install --no-deps openradar==1.0.1
    python studies/side_by_side.py

docs/results/side-by-side.md has what it prints. The programs between the marks are what is counted there.
"""

import ast
import inspect
import tempfile
import time
from pathlib import Path

import mmwave.dsp as dsp
import numpy as np
from mmwave.dataloader import DCA1000
from xwr.rsp.numpy import CACFAR, AWR1843Boost, PointCloud

import radarllm as rl

RADAR = rl.Radar("awr1843boost")
CHIRP_S = RADAR.to_dict()["idle_s"] + RADAR.to_dict()["ramp_end_s"]
N_FRAMES = 20
# Figures of the radar, as a user of xwr writes them down: `radarllm radar show awr1843boost --json` prints them.
RANGE_M, SPEED_MPS, CARRIER_HZ, ANTENNAS_HZ = 0.042930437844722724, 0.06853591957905959, 79.1058756e9, 77e9


def ours(capture: Path) -> list[np.ndarray]:
    """x right, y away, z up, range, velocity, intensity of the points of each frame."""
    points = rl.open_capture(capture, radar="awr1843boost", iq="i-first").points()
    return [points.frame(i) for i in range(len(points))]


def xwr(capture: Path) -> list[np.ndarray]:
    """x away, y left, z up, velocity of the points of each frame."""
    words = np.fromfile(capture, "<i2").reshape(-1, 128, 3, 4, 512)
    # The slots of a loop are TX1, TX3, TX2.
    words = np.ascontiguousarray(words[:, :, [0, 2, 1]])
    process = AWR1843Boost(window=True, size={"azimuth": 64, "elevation": 16}, sample_swap=True)
    detect = CACFAR(snr_thresh=5.0)
    locate = PointCloud(range_res=RANGE_M, doppler_res=SPEED_MPS, antenna_spacing=0.5 * CARRIER_HZ / ANTENNAS_HZ)
    found = []
    for frame in words:
        cube = np.abs(process(frame[None]))
        dense = locate(cube, detect(cube).mask)
        found.append(dense.points[dense.mask])
    return found


def openradar(capture: Path) -> list[np.ndarray]:
    """x right, y away, z up of the points of each frame."""
    words = np.fromfile(capture, "<i2").reshape(-1, 128 * 3 * 4 * 512)
    # 2.5 octaves of amplitude, 15 dB, summed over twelve antennas.
    cfar = {"guard_len": 4, "noise_len": 16, "l_bound": 12 * 2.5}
    found = []
    for frame in words:
        chirps = DCA1000.organize(frame, 128 * 3, 4, 256)
        ranges = dsp.range_processing(chirps, window_type_1d=dsp.utils.Window.HANNING)
        # The antennas of TX1, TX3 and TX2 in this order: the azimuth row, then the elevated one.
        power, antennas = dsp.doppler_processing(
            ranges, num_tx_antennas=3, clutter_removal_enabled=True, window_type_2d=dsp.utils.Window.HANNING
        )
        along_doppler, _ = np.apply_along_axis(dsp.ca_, 1, power, **cfar).swapaxes(0, 1)
        along_range, _ = np.apply_along_axis(dsp.ca_, 0, power, **cfar)
        range_bins, doppler_bins = np.nonzero((power > along_doppler) & (power > along_range))
        # `add_doppler_compensation` cannot be called: see findings/openradar-doppler-compensation.sh.
        x, y, z = dsp.naive_xyz(antennas[range_bins, :, doppler_bins].T)
        real = np.isfinite(y)
        found.append((np.stack([x, y, z], axis=-1) * range_bins[:, None] * RANGE_M)[real])
    return found


def n_statements(function) -> int:
    """Statements of a program but for its docstring and its first line."""
    tree = ast.parse(inspect.getsource(function))
    return sum(isinstance(node, ast.stmt) for node in ast.walk(tree)) - 2


def write_words(capture: Path, cubes: list[np.ndarray]) -> None:
    """Samples as mmWave Studio records them from two LVDS lanes: I of two samples, then Q of the two."""
    peak = max(np.abs(cube).max() for cube in cubes)
    with capture.open("wb") as file:
        for cube in cubes:
            counts = np.round(cube * (8000.0 / peak))
            pairs = counts.reshape(*counts.shape[:-1], -1, 2)
            file.write(np.concatenate([pairs.real, pairs.imag], axis=-1).astype("<i2").tobytes())


def target_cube(x_m: float, y_m: float, z_m: float, speed_mps: float) -> np.ndarray:
    """One frame of a point that recedes, by the textbook: the phase of each sample is that of its delay."""
    radar = RADAR.to_dict()
    slope, start_hz, rate = radar["slope_hz_per_s"], radar["start_hz"], radar["sample_rate_hz"]
    tx_m, rx_m = np.array(radar["tx"]), np.array(radar["rx"])
    cube = np.empty((128, 3, 4, 256), np.complex64)
    direction = np.array([x_m, y_m, z_m]) / np.sqrt(x_m**2 + y_m**2 + z_m**2)
    in_ramp_s = radar["adc_start_s"] + np.arange(256) / rate
    for loop in range(128):
        for slot in range(3):
            since_s = (3 * loop + slot) * CHIRP_S + radar["idle_s"] + in_ramp_s
            place = np.array([[x_m], [y_m], [z_m]]) + direction[:, None] * speed_mps * since_s
            out_m = np.linalg.norm(place - np.array([[tx_m[slot, 0]], [0], [tx_m[slot, 1]]]), axis=0)
            for rx in range(4):
                back_m = np.linalg.norm(place - np.array([[rx_m[rx, 0]], [0], [rx_m[rx, 1]]]), axis=0)
                delay_s = (out_m + back_m) / 299_792_458.0
                phase = 2 * np.pi * (start_hz * delay_s + slope * delay_s * in_ramp_s) - np.pi * slope * delay_s**2
                cube[loop, slot, rx] = np.exp(1j * phase)
    noise = np.random.default_rng(1).normal(size=(*cube.shape, 2)).astype("f4") @ np.array([1, 1j], "c8")
    return cube + 0.1 * noise


def errors(folder: Path) -> None:
    print(
        "a point at 3 m, 20 degrees to the right and 5 degrees up that recedes; distance of the nearest point, and of the median one:"
    )
    away, up = np.radians(20), np.radians(5)
    start = 3 * np.array([np.sin(away) * np.cos(up), np.cos(away) * np.cos(up), np.sin(up)])
    for speed_mps in (0.5, 1.0, 2.0, 4.0):
        capture = folder / "target.bin"
        write_words(capture, [target_cube(*start, speed_mps)])
        # The middle of the frame's active time.
        where = start * (1 + speed_mps * 64 * 3 * CHIRP_S / 3)
        (found,) = ours(capture)
        mine = np.linalg.norm(found[:, :3] - where, axis=1)
        (found,) = xwr(capture)
        # Their axes: away from the radar, to the left, up. Whichever side their antennas count from is allowed.
        sides = [np.linalg.norm(found[:, :3] - [where[1], side * where[0], where[2]], axis=1) for side in (-1, 1)]
        theirs = min(sides, key=np.min)
        # Whichever side and height their antennas count from is allowed.
        (found,) = openradar(capture)
        places = [[side * where[0], where[1], height * where[2]] for side in (-1, 1) for height in (-1, 1)]
        other = min((np.linalg.norm(found - place, axis=1) for place in places), key=np.min)
        print(
            f"  {speed_mps} m/s: RadarLLM {mine.min():.3f} m, {np.median(mine):.3f} m of {len(mine)};"
            f" xwr {theirs.min():.3f} m, {np.median(theirs):.3f} m of {len(theirs)};"
            f" OpenRadar {other.min():.3f} m, {np.median(other):.3f} m of {len(other)}"
        )


def times(folder: Path) -> None:
    capture = folder / "walk.bin"
    cubes = rl.simulate("builtin:walk", radar=RADAR, emit="cubes")
    write_words(capture, [cube for _, cube in zip(range(N_FRAMES), cubes)])
    for name, program in (("RadarLLM", ours), ("xwr", xwr), ("OpenRadar", openradar)):
        program(capture)
        seconds = []
        for _ in range(3):
            # Of all threads of the process, so that other work on the machine does not count.
            started = time.process_time()
            found = program(capture)
            seconds.append(time.process_time() - started)
        each = [1e3 * s / len(found) for s in seconds]
        n_points = np.mean([len(f) for f in found])
        print(
            f"{name}: {n_statements(program)} statements, {len(found)} frames of a walking person, {n_points:.0f} points a frame,"
            f" {min(each):.1f} to {max(each):.1f} ms of CPU a frame"
        )


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as folder:
        errors(Path(folder))
        times(Path(folder))
