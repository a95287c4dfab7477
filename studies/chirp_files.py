#!/usr/bin/env python3
"""Are the figures of `radarllm radar show` those of the numbers in a chirp file?

Usage: python3 studies/chirp_files.py RADARLLM FOLDER...

Needs Python 3.9 or later and no package. Every .cfg below the folders is read by a parser of its own, which
shares no code with the program, and its frame rate, bandwidth, resolutions and maxima are computed:

    sampled bandwidth   B = slope * samples / rate
    range resolution    c / (2 B), over as many bins as samples, or half as many if these are real
    maximum velocity    c / (4 f T), with f in the middle of the ADC window and T from loop to loop
    velocity resolution twice the maximum over the number of loops
    frame period        frameCfg; with advFrameCfg the sum of the sub-frames

Rate and loops of the low-power SDK follow TI's demo: 100 MHz / decimation (xWRL6844: 200 MHz), a burst is a loop, or
the chirps of a single burst are. The program prints a line for each file and counts the verdicts: `equal`, `refused` with
the reason, `WRONG` with the figures. It exits with 1 if a figure is wrong.
"""

import collections
import json
import pathlib
import subprocess
import sys

C = 299792458.0
TOLERANCE = 3e-3


def commands(text):
    for line in text.lstrip("\ufeff").splitlines():
        words = line.split("%")[0].split()
        if words:
            yield words[0], words[1:]


def numbers(words):
    out = []
    for word in words:
        try:
            out.append(float(word))
        except ValueError:
            break
    return out


def figures(text):
    """The figures of a file, or None where it has no frame."""
    one, profiles, chirps, subframes = {}, {}, {}, {}
    for name, words in commands(text):
        values = numbers(words)
        if name == "flushCfg":
            one, profiles, chirps, subframes = {}, {}, {}, {}
        elif name == "profileCfg":
            profiles[values[0]] = values
        elif name == "chirpCfg":
            for index in range(int(values[0]), int(values[1]) + 1):
                chirps[index] = values
        elif name == "subFrameCfg":
            subframes[int(values[0])] = values
        elif name == "antGeometryBoard":
            one[name] = words
        else:
            one[name] = values
    if "chirpComnCfg" in one:
        return low_power(one)
    if "advFrameCfg" in one:
        parts = [subframes[i] for i in range(int(one["advFrameCfg"][0]))]
        period = sum(part[9] for part in parts)
        loops = [(range(int(p[2]), int(p[2] + p[3])), p[4]) for p in parts]
    elif "frameCfg" in one:
        frame = one["frameCfg"]
        is_mcu_plus = len(frame) >= 8 and frame[6] in (1, 2) and frame[5] not in (1, 2)
        period = frame[5] if is_mcu_plus else frame[4]
        loops = [(range(int(frame[0]), int(frame[1]) + 1), frame[2])]
    else:
        return None
    out = {"frame_rate_hz": 1e3 / period}
    found = []
    is_real = one.get("adcCfg", [2, 1])[1] not in (1, 2) or (
        "frameCfg" in one and "advFrameCfg" not in one and is_mcu_plus and "adcCfg" not in one
    )
    for indices, n_loops in loops:
        ramps = set()
        duration_us = 0.0
        for index in indices:
            if index not in chirps or chirps[index][2] not in profiles:
                return out
            chirp = chirps[index]
            p = profiles[chirp[2]]
            ramps.add((p[1] * 1e9 + chirp[3], (p[7] + chirp[4] * 1e-3) * 1e12, p[3] + chirp[6], p[9], p[10] * 1e3))
            duration_us += p[2] + chirp[5] + p[4]
        found.append((tuple(ramps), duration_us * 1e-6, n_loops))
    ramps = {ramp for f in found for ramp in f[0]}
    if len(ramps) == 1:
        start, slope, adc_start_us, n, rate = ramps.pop()
        carrier = add_range(out, start, slope, adc_start_us * 1e-6, n, rate, is_real)
        is_mcu_plus = "advFrameCfg" not in one and is_mcu_plus
        if len({f[1:] for f in found}) == 1 and not is_mcu_plus:
            add_velocity(out, carrier, *found[0][1:])
    return out


def add_range(out, start, slope, adc_start, n, rate, is_real):
    bandwidth = slope * n / rate
    out["sampled_bandwidth_hz"] = bandwidth
    out["range_resolution_m"] = C / (2 * bandwidth)
    out["max_range_m"] = out["range_resolution_m"] * (n // 2 if is_real else n)
    out["carrier_hz"] = start + slope * (adc_start + n / rate / 2)
    return out["carrier_hz"]


def add_velocity(out, carrier, loop, n_loops):
    out["max_velocity_mps"] = C / (4 * carrier * loop)
    out["velocity_resolution_mps"] = 2 * out["max_velocity_mps"] / n_loops


def low_power(one):
    rx, tx = (int(v) for v in one["channelCfg"][:2])
    decimation, _, _, n, _, ramp_us = one["chirpComnCfg"][:6]
    idle_us, skip, _, slope, start_ghz = one["chirpTimingCfg"][:5]
    n_chirps, accumulated, burst_us, bursts, period_ms = one["frameCfg"][:5]
    is_6844 = "6844" in str(one.get("antGeometryBoard")) or (start_ghz < 70 and (rx > 7 or tx > 3))
    rate = (200e6 if is_6844 else 100e6) / decimation
    n_tx = bin(tx).count("1") // (2 if is_6844 else 1)
    out = {"frame_rate_hz": 1e3 / period_ms}
    if slope == 0:
        return out
    carrier = add_range(out, start_ghz * 1e9, slope * 1e12, skip / rate, n, rate, True)
    if bursts == 1:
        loop_us = (idle_us + ramp_us) * n_tx * max(accumulated, 1)
        add_velocity(out, carrier, loop_us * 1e-6, n_chirps // n_tx)
    elif n_chirps == n_tx:
        add_velocity(out, carrier, burst_us * 1e-6, bursts)
    return out


def verdict(radarllm, path):
    run = subprocess.run([radarllm, "radar", "show", path, "--json"], capture_output=True, text=True)
    if run.returncode != 0 and not run.stdout.strip():
        return "refused", run.stderr.strip().splitlines()[0][:150]
    shown = json.loads(run.stdout)
    text = pathlib.Path(path).read_text(encoding="utf-8", errors="replace")
    try:
        expected = figures(text)
    except (KeyError, IndexError, ValueError, ZeroDivisionError) as error:
        expected = {"frame_rate_hz": f"not computed: {error!r}"}
    if expected is None:
        return "WRONG", "shown, though it has no frame"
    wrong = []
    for name in (
        "frame_rate_hz",
        "sampled_bandwidth_hz",
        "range_resolution_m",
        "max_range_m",
        "velocity_resolution_mps",
        "max_velocity_mps",
        "carrier_hz",
    ):
        a, b = shown.get(name), expected.get(name)
        # A file with a mistake has the figures that the mistake leaves.
        if a is None and run.returncode != 0:
            continue
        is_equal = a == b if a is None or b is None else isinstance(b, float) and abs(a / b - 1) < TOLERANCE
        if not is_equal:
            wrong.append(f"{name}: {a} instead of {b}")
    if wrong:
        return "WRONG", "; ".join(wrong)
    dialect = shown.get("dialect") or "cube"
    kind = "equal" if run.returncode == 0 else "equal, with a mistake elsewhere"
    reasons = shown.get("no_cube") or [""]
    return f"{kind}: {dialect}", f"{shown['name']}, {shown['frame_rate_hz']:.2f} frames/s {reasons[0][:110]}"


def main():
    radarllm, folders = sys.argv[1], sys.argv[2:]
    files = sorted(p for folder in folders for p in pathlib.Path(folder).rglob("*.cfg"))
    counts = collections.Counter()
    for path in files:
        kind, detail = verdict(radarllm, str(path))
        counts[kind] += 1
        print(f"{path.name[:48]:<48} {kind}: {detail}")
    print()
    for kind, n in sorted(counts.items()):
        print(f"{n:>5}  {kind}")
    print(f"{len(files):>5}  files")
    return 1 if counts["WRONG"] else 0


if __name__ == "__main__":
    if len(sys.argv) < 3:
        sys.exit(__doc__)
    sys.exit(main())
