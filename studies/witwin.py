"""One equal scene by RadarLLM and by witwin-radar: time a frame, and spectra side by side.

    pip install numpy "witwin-radar[channel]==0.4.1"
    python3 studies/witwin.py radarllm [--frames 8] [--points 500]

Needs NumPy. witwin-radar needs Python 3.11 and an NVIDIA GPU; without them only the other part runs, and it says so.

witwin-radar simulates point scatterers that its user names; a mesh reflects and hides there, but has no echo of its own
(its `targets.py`). The equal scene is therefore points on the walking body: random places on the facets that face the
radar, all of the same cross section, which move with the mesh and, in a frame, straight on. RadarLLM simulates the same
points, and also the mesh. The first frame is compared with a plain sum of the textbook's phases, too, so that the
comparison itself is checked where there is no GPU.
"""

import argparse
import importlib.metadata
import json
import os
import platform
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

# Their package has the name of this file, whose folder Python searches first.
sys.path = [folder for folder in sys.path if Path(folder).resolve() != Path(__file__).resolve().parent]

# The reference radar, as `RadarConfig::awr1843boost` has it; `check_radar` compares what the command prints of it.
START_HZ, SLOPE_HZ_PER_S, SAMPLE_RATE_HZ = 77e9, 60.012e12, 4.4e6
IDLE_S, ADC_START_S, RAMP_END_S, FRAME_S = 7e-6, 6e-6, 65e-6, 0.1
N_SAMPLES, N_LOOPS = 256, 128
# In half wavelengths at 77 GHz, to the right and upwards, in the order of the slots.
TX, RX = [(0, 0), (4, 0), (2, 1)], [(0, 0), (1, 0), (2, 0), (3, 0)]
TX_POWER_DBM, ANTENNA_GAIN_DBI = 12.0, 10.5
HALF_WIDTHS_DEG = 28.0, 14.0

LIGHT_MPS = 299_792_458.0
HALF_WAVE_M = LIGHT_MPS / START_HZ / 2
CHIRP_S = IDLE_S + RAMP_END_S
ACTIVE_S = N_LOOPS * len(TX) * CHIRP_S
CARRIER_HZ = START_HZ + SLOPE_HZ_PER_S * (ADC_START_S + N_SAMPLES / SAMPLE_RATE_HZ / 2)
RANGE_BIN_M = LIGHT_MPS * SAMPLE_RATE_HZ / (2 * SLOPE_HZ_PER_S * N_SAMPLES)
SPEED_BIN_MPS = LIGHT_MPS / CARRIER_HZ / (2 * ACTIVE_S)

MOTION = "builtin:walk"
FLOOR_M = np.array([0.0, 4.0, -1.0])
FIRST_S = 1.0
TOTAL_RCS_M2 = 1.0
# Frames by which a long run exceeds a short one, and runs of each.
MORE_FRAMES, REPEATS = 30, 7


def run(program, *arguments):
    done = subprocess.run([program, *map(str, arguments)], capture_output=True, text=True, check=False)
    if done.returncode:
        raise SystemExit(f"{program} {' '.join(map(str, arguments))}\n{done.stderr}")
    return done.stdout


def cpu_s():
    """Of all children that ended."""
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime


def check_radar(program):
    shown = json.loads(run(program, "radar", "show", "awr1843boost", "--json"))
    ours = {
        "range_resolution_m": RANGE_BIN_M,
        "velocity_resolution_mps": SPEED_BIN_MPS,
        "carrier_hz": CARRIER_HZ,
        "frame_rate_hz": 1 / FRAME_S,
        "n_samples": N_SAMPLES,
        "n_loops": N_LOOPS,
        "n_tx": len(TX),
        "n_rx": len(RX),
    }
    for name, value in ours.items():
        if abs(shown[name] / value - 1) > 1e-9:
            raise SystemExit(f"{name} is {shown[name]} in the command and {value} here")


def walking_points(program, folder, n_points, n_frames):
    """Places at the start of each frame and velocities of points on the body: two arrays [frame, point, xyz]."""
    file = folder / "walk.npz"
    run(program, "motion", "mesh", MOTION, "--out", file)
    with np.load(file) as mesh:
        vertices, faces = mesh["vertices"].astype(float), mesh["faces"]
    rate_hz = 60.0

    def vertices_at(time_s):
        index = min(int(time_s * rate_hz), len(vertices) - 2)
        share = time_s * rate_hz - index
        return (1 - share) * vertices[index] + share * vertices[index + 1] + FLOOR_M

    corners = vertices_at(FIRST_S)[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    facing = np.maximum(-np.einsum("ij,ij->i", normals, corners.mean(axis=1)), 0)
    generator = np.random.default_rng(1)
    chosen = generator.choice(len(faces), n_points, p=facing / facing.sum())
    shares = generator.dirichlet((1, 1, 1), n_points)
    places, velocities = [], []
    for frame in range(n_frames):
        begin = FIRST_S + frame * FRAME_S
        at, later = (np.einsum("ij,ijk->ik", shares, vertices_at(t)[faces[chosen]]) for t in (begin, begin + ACTIVE_S))
        places.append(at)
        velocities.append((later - at) / ACTIVE_S)
    return np.array(places), np.array(velocities)


def scene_of_points(places, velocities, duration_s):
    parts = [f"duration_s = {duration_s:.3f}\nmax_bounces = 1\nnoise = {{ none = true }}\n"]
    for place, velocity in zip(places, velocities):
        parts.append(
            f'[[target]]\nkind = "point"\nposition_m = {place.tolist()}\nvelocity_mps = {velocity.tolist()}\n'
            f"rcs_m2 = {TOTAL_RCS_M2 / len(places)}\n"
        )
    return "".join(parts)


def scene_of_mesh(duration_s):
    return (
        f"duration_s = {duration_s:.3f}\nmax_bounces = 1\nnoise = {{ none = true }}\n"
        f'[[target]]\nkind = "motion"\nfile = "{MOTION}"\nposition_m = {FLOOR_M.tolist()}\n'
    )


def simulate(program, folder, scene, threads, emit):
    """Seconds that the command states and those of its threads together, and the samples if it emits them.

    Samples are [frame, loop, tx, rx, sample].
    """
    file, out = folder / "scene.toml", folder / ("out.npy" if emit == "adc" else "out.parquet")
    file.write_text(scene)
    before_s = cpu_s()
    stated = run(program, "simulate", file, "--radar", "awr1843boost", "--emit", emit, "--out", out, "--threads", threads, "--force", "--json")  # fmt: skip
    seconds = json.loads(stated)["seconds"], cpu_s() - before_s
    return seconds, np.load(out) if emit == "adc" else None


def ms_per_frame(program, folder, scene_of_duration, threads, emit):
    """By which a long run takes longer than one of a frame, each at its fastest, a frame: of a clock and of CPU."""
    taken = {1: [], 1 + MORE_FRAMES: []}
    for _ in range(REPEATS):
        for n_frames, seconds in taken.items():
            seconds.append(simulate(program, folder, scene_of_duration(n_frames * FRAME_S), threads, emit)[0])
    short_s, long_s = (np.min(seconds, axis=0) for seconds in taken.values())
    return 1e3 * (long_s - short_s) / MORE_FRAMES


def power_gain(azimuth_rad, elevation_rad):
    """Of one antenna, relative to boresight."""
    wide, high = np.radians(HALF_WIDTHS_DEG)
    return 2.0 ** -((azimuth_rad / wide) ** 2 + (elevation_rad / high) ** 2)


def distance_m(places, antenna):
    away = places - HALF_WAVE_M * np.array([antenna[0], 0, antenna[1]])
    return np.sqrt(np.einsum("pnk,pnk->pn", away, away))


def textbook(places, velocities):
    """Samples [loop, tx, rx, sample] of a frame: the phase of every sample of every path is that of its delay."""
    power_w = 1e-3 * 10 ** (TX_POWER_DBM / 10) * 10 ** (2 * ANTENNA_GAIN_DBI / 10)
    wave_m = LIGHT_MPS / CARRIER_HZ
    x, y, z = (places + velocities * ACTIVE_S / 2).T
    gain = power_gain(np.arctan2(x, y), np.arctan2(z, np.hypot(x, y)))
    rcs_m2 = TOTAL_RCS_M2 / len(places)
    amplitudes = np.sqrt(power_w * wave_m**2 * rcs_m2 / (4 * np.pi) ** 3) * gain / (x**2 + y**2 + z**2)
    in_ramp_s = ADC_START_S + np.arange(N_SAMPLES) / SAMPLE_RATE_HZ
    cube = np.zeros((N_LOOPS, len(TX), len(RX), N_SAMPLES), complex)
    for loop in range(N_LOOPS):
        for slot, tx in enumerate(TX):
            at_s = (loop * len(TX) + slot) * CHIRP_S + IDLE_S + in_ramp_s
            there = places[:, None] + velocities[:, None] * at_s[None, :, None]
            out_m = distance_m(there, tx)
            for receiver, rx in enumerate(RX):
                delay_s = (out_m + distance_m(there, rx)) / LIGHT_MPS
                turns = START_HZ * delay_s + SLOPE_HZ_PER_S * delay_s * (in_ramp_s - delay_s / 2)
                cube[loop, slot, receiver] = amplitudes @ np.exp(2j * np.pi * turns)
    return cube


def witwin_radar(device):
    from witwin.radar import Fmcw, Pattern, Radar

    degrees = np.arange(-60, 60.25, 0.5)
    across, up = np.meshgrid(np.radians(degrees), np.radians(degrees))
    # Their second angle is that of the projection on the vertical plane, atan(z / y).
    gain = power_gain(across, np.arctan(np.tan(up) * np.cos(across)))
    return Radar(
        carrier=START_HZ,
        waveform=Fmcw(
            slope=SLOPE_HZ_PER_S,
            sample_rate=SAMPLE_RATE_HZ,
            samples_per_chirp=N_SAMPLES,
            chirps_per_frame=N_LOOPS,
            adc_start=ADC_START_S,
            idle=IDLE_S,
            ramp_end=RAMP_END_S,
            output="beat",
        ),
        tx=tuple((float(x), float(z), 0.0) for x, z in TX),
        rx=tuple((float(x), float(z), 0.0) for x, z in RX),
        antenna_unit="half_wavelength",
        power=TX_POWER_DBM + 2 * ANTENNA_GAIN_DBI,
        pattern=Pattern.table(degrees, degrees, gain),
        look_at=(0.0, 1.0, 0.0),
        up=(0.0, 0.0, 1.0),
        device=device,
    )


def theirs(places, velocities):
    """Samples [frame, loop, tx, rx, sample] by their kinds of sampling of motion, with the ms a frame."""
    import torch
    from witwin.core import Scene
    from witwin.radar import Motion, PointTargets

    radar = witwin_radar("cuda")
    at_start = torch.tensor(places, dtype=torch.float64, device="cuda")
    speed = torch.tensor(velocities, dtype=torch.float64, device="cuda")

    def trajectory(time_s):
        frame = min(int(time_s / FRAME_S + 1e-9), len(places) - 1)
        return (at_start[frame] + speed[frame] * (time_s - frame * FRAME_S)).float().contiguous()

    targets = PointTargets(positions=trajectory(0.0), rcs=TOTAL_RCS_M2 / places.shape[1], trajectory=trajectory)
    # Their frame begins with the ramp, ours with the idle time before it.
    times = [frame * FRAME_S + IDLE_S for frame in range(len(places))]
    kinds = {
        "adaptive, 5 nodes": Motion.adaptive(nodes=5),
        "adaptive": Motion.adaptive(),
        "a place for each chirp": Motion.chirp(),
    }
    found = {}
    for name, motion in kinds.items():
        taken = []
        try:
            for _ in range(3):
                torch.cuda.synchronize()
                started = time.perf_counter()
                result = radar.simulate(Scene(), targets, times=times, reflections=0, motion=motion)
                torch.cuda.synchronize()
                taken.append(1e3 * (time.perf_counter() - started) / len(times))
        except (RuntimeError, ValueError, NotImplementedError) as error:
            print(f"witwin-radar, {name}: {type(error).__name__}: {error}")
            continue
        # [frame, tx, rx, loop, sample]
        found[name] = result.cube.permute(0, 3, 1, 2, 4).cpu().numpy(), taken[0], min(taken[1:])
    return found


def spectrum_db(cube):
    """Range-Doppler power summed over the channels, [range, speed], receding to the right."""
    windowed = cube * np.hanning(N_SAMPLES) * np.hanning(N_LOOPS)[:, None, None, None]
    maps = np.fft.fftshift(np.fft.fft2(windowed, axes=(3, 0)), axes=0)
    return 10 * np.log10(np.sum(np.abs(maps) ** 2, axis=(1, 2)).T + 1e-300)


def peak(spectrum):
    at, speed = np.unravel_index(spectrum.argmax(), spectrum.shape)
    return f"{at * RANGE_BIN_M:5.2f} m {(speed - N_LOOPS // 2) * SPEED_BIN_MPS:+5.2f} m/s"


def compare(name, one, other):
    """Prints how samples [frame, loop, tx, rx, sample] of two programs agree."""
    print(f"\n{name}\nframe  peak of one          peak of the other    correlation, dB  coherence  level")
    for frame, (a, b) in enumerate(zip(one, other)):
        spectra = spectrum_db(a), spectrum_db(b)
        floored = [np.maximum(s - s.max(), -60) for s in spectra]
        strong = np.maximum(*floored) > -40
        correlation = np.corrcoef(floored[0][strong], floored[1][strong])[0, 1]
        norms = np.linalg.norm(a), np.linalg.norm(b)
        coherence = abs(np.vdot(a, b)) / (norms[0] * norms[1])
        level_db = 20 * np.log10(norms[1] / norms[0])
        print(f"{frame:5}  {peak(spectra[0])}  {peak(spectra[1])}  {correlation:15.4f}  {coherence:9.4f}  {level_db:+.2f} dB")


def machine():
    with open("/proc/cpuinfo") as file:
        names = [line.split(":")[1].strip() for line in file if line.startswith("model name")]
    return f"{names[0] if names else platform.machine()}, {os.cpu_count()} cores, {platform.system()}"


def load():
    return "load of the last minute " + f"{os.getloadavg()[0]:.2f}"


def version(package):
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return None


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("program")
    parser.add_argument("--frames", type=int, default=8)
    parser.add_argument("--points", type=int, default=500)
    options = parser.parse_args()
    program = str(Path(options.program).resolve()) if os.sep in options.program else options.program

    print(f"{run(program, '--version').strip()}; Python {platform.python_version()}, numpy {np.__version__}")
    print(f"{machine()}; {load()}")
    print(f"radar awr1843boost: {N_LOOPS} loops, {len(TX)} x {len(RX)} channels, {N_SAMPLES} samples")
    check_radar(program)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        places, velocities = walking_points(program, folder, options.points, options.frames)
        first = slice(round(FIRST_S / FRAME_S), round(FIRST_S / FRAME_S) + options.frames)
        mesh = simulate(program, folder, scene_of_mesh(FRAME_S * first.stop), 1, "adc")[1][first]
        ours = [
            simulate(program, folder, scene_of_points(place, velocity, FRAME_S), 1, "adc")[1][0]
            for place, velocity in zip(places, velocities)
        ]

        # Farther away for the longer run, in which the points walk on.
        farther = places[0] + [0, 2.5, 0]
        rows = {
            "mesh to samples": (scene_of_mesh, "adc"),
            "mesh to points of the radar": (scene_of_mesh, "points"),
            f"{options.points} points to samples": (lambda s: scene_of_points(farther, velocities[0], s), "adc"),
        }
        print(f"\nRadarLLM, ms a frame: {MORE_FRAMES} frames more, fastest of {REPEATS} runs each")
        print(f"{'':30} 1 thread: clock     CPU   2 threads: clock     CPU")
        for label, (scene, emit) in rows.items():
            one, two = (ms_per_frame(program, folder, scene, threads, emit) for threads in (1, 2))
            print(f"{label:30} {one[0]:15.2f} {one[1]:7.2f} {two[0]:18.2f} {two[1]:7.2f}")
        print(load())

    compare("RadarLLM's points, and the textbook's sum of them", ours[:1], [textbook(places[0], velocities[0])])
    compare("RadarLLM's points, and RadarLLM's mesh", ours, mesh)

    installed = version("witwin-radar")
    print()
    if installed is None:
        print("witwin-radar: not run (not installed)")
        return
    import torch

    packages = f"witwin-radar {installed}, witwin-channel {version('witwin-channel')}, torch {torch.__version__}"
    places_m = witwin_radar("cpu").tx_pos.numpy(), witwin_radar("cpu").rx_pos.numpy()
    for theirs_m, antennas in zip(places_m, (TX, RX)):
        ours_m = HALF_WAVE_M * np.array([(x, 0, z) for x, z in antennas])
        assert np.abs(theirs_m - ours_m).max() < 1e-8, "their antennas are at other places"
    print(f"{packages}: takes the radar, its antennas are at the same places")
    if not torch.cuda.is_available():
        print("witwin-radar: not run (no CUDA device)")
        return
    print(f"{torch.cuda.get_device_name()}\n{'witwin-radar, ms a frame':30}    first      later")
    for label, (cubes, first_ms, later_ms) in theirs(places, velocities).items():
        print(f"{label:30} {first_ms:8.2f}  {later_ms:9.2f}")
        compare(f"RadarLLM's points, and witwin-radar's ({label})", ours, cubes)


if __name__ == "__main__":
    main()
