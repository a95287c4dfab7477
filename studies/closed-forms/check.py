"""Closed forms against raw samples of the virtual radar, in NumPy alone.

    python3 studies/closed-forms/check.py target/release/radarllm

simulates the scenes beside this file with `--emit adc`, measures, and prints the table of
docs/concepts/validation.md. Ends with 1 if a row is outside its tolerance. Nothing of the radar is taken from
the program: the constants below are those of the AWR1843BOOST and its chirp.
"""

import functools
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

C = 299_792_458.0
START_HZ, SLOPE, RATE, N = 77e9, 60.012e12, 4.4e6, 256
CHIRP_S, LOOP_S, RAMP_S, ADC_S = 72e-6, 216e-6, 7e-6, 6e-6
HALF_M = 0.5 * C / START_HZ  # antenna grid
MIDDLE = N // 2  # the sample at which the radar's wavelength holds
WAVELENGTH = C / (START_HZ + SLOPE * (ADC_S + MIDDLE / RATE))
K = 2 * np.pi / WAVELENGTH
POWER_W, GAIN = 10 ** (12.0 / 10 - 3), 10 ** (10.5 / 10)
ONE_M2_AT_1M_W = POWER_W * GAIN**2 * WAVELENGTH**2 / (4 * np.pi) ** 3
BOLTZMANN, T0_K = 1.380649e-23, 290.0
V_MAX = WAVELENGTH / (4 * LOOP_S)

HERE = Path(__file__).parent


def db(ratio):
    return 10 * np.log10(ratio)


def ripple(edge, radius):
    """Most that facets of this edge change the field of a surface of this radius of curvature."""
    psi = 2 * K * edge**2 / (8 * radius)
    return 6 * 2 * psi / np.pi**2


def null_fill(length, range_m):
    """What a spherical wave front leaves in the nulls of an aperture, relative to its peak field."""
    return 2 / np.pi**2 * K * length**2 / (4 * range_m)


def field_db(error):
    return 20 * np.log10(1 + error)


def main(program, folder):
    @functools.cache
    def cube(scene):
        """[loop, tx, rx, sample] of the scene's first frame, square-root watts."""
        out = folder / f"{scene}.npy"
        command = [program, "simulate", HERE / f"{scene}.toml", "--emit", "adc", "--out", out]
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
        return np.load(out)[0].astype(complex)

    def rcs(scene, range_m):
        """TX1 and RX1 stand in the same place, the origin: monostatic."""
        power = np.abs(cube(scene)[0, 0, 0, MIDDLE]) ** 2
        return power * range_m**4 / ONE_M2_AT_1M_W

    rows = []

    def row(what, formula, expected, measured, tolerance, unit, test, scene, most=False):
        ok = measured < expected if most else abs(measured - expected) <= tolerance
        limit = "at most" if most else f"± {tolerance:.2g}"
        values = [f"{value:.5g} {unit}".strip() for value in (expected, measured)]
        rows.append((what, formula.replace("|", "\\|"), *values, limit, test, scene, ok))

    def section(what, formula, expected, tolerance_db, test, scene, range_m):
        row(what, formula, db(expected), db(rcs(scene, range_m)), tolerance_db, "dBsm", test, scene)

    # Points.
    power_test = "power_falls_with_the_fourth_power_and_follows_the_radar_equation"
    section("radar equation", "P G² λ² σ / ((4π)³ R⁴), σ = 1 m²", 1.0, 0.005, power_test, "point_1m", 1.0)
    fall = db(rcs("point_1m", 1.0) / rcs("point_10m", 1.0))
    row("R⁻⁴ over a decade", "40 dB", 40.0, fall, 0.01, "dB", power_test, "point_10m")

    position, speed = np.array([0.8, 2.3, 0.3]), 4.0
    moving = cube("moving_point")
    start_m = np.linalg.norm(position)
    u = position / start_m
    window = np.hanning(N)

    def phase(a, b):
        return np.angle(np.sum(window * b * a.conj()))

    def beat_range(chirp):
        spectrum = np.abs(np.fft.fft(window * chirp, 64 * N))
        i = int(np.argmax(spectrum))
        a, b, c = np.log(spectrum[[i - 1, i, (i + 1) % (64 * N)]])
        bin_ = i + 0.5 * (a - c) / (a - 2 * b + c)
        return bin_ / (64 * N) * RATE / SLOPE * C / 2

    # The place at the middle of the samples, and the Doppler part of the beat frequency.
    first_s = RAMP_S + ADC_S + MIDDLE / RATE
    coupling_m = speed * C / WAVELENGTH / SLOPE
    found_m = beat_range(moving[0, 0, 0])
    row("range of a point", "beat f = 2 S R / c + 2 v / λ", start_m + speed * first_s + coupling_m, found_m, 2e-4, "m",
        "point_target_range_and_range_walk", "moving_point")
    walk_bins = (beat_range(moving[127, 0, 0]) - found_m) * 2 * SLOPE * N / RATE / C
    row("range walk", "127 v T / (c / 2B)", speed * 127 * LOOP_S * 2 * SLOPE * N / RATE / C, walk_bins, 0.01,
        "bins", "point_target_range_and_range_walk", "moving_point")
    loop_rad = np.mean([phase(moving[i, 0, 0], moving[i + 1, 0, 0]) for i in range(127)])
    row("velocity of a point", "f_D = 2 v / λ", speed, loop_rad * WAVELENGTH / (4 * np.pi * LOOP_S), 1e-3,
        "m/s", "point_target_velocity_and_tdm_phase", "moving_point")
    # Curvature over three elements of 1.95 mm is 0.011 rad, a third of it per element: 0.0012.
    step = np.mean([phase(moving[0, 0, i], moving[0, 0, i + 1]) for i in range(3)])
    u_x = -step * WAVELENGTH / (2 * np.pi * HALF_M)
    row("azimuth: direction cosine", "phase step = -2π d u_x / λ", u[0], u_x, 2e-3, "",
        "handedness_azimuth_and_elevation", "moving_point")
    # TX2 fires third, two chirps later: its motion is taken off.
    raised = phase(moving[0, 0, 2], moving[0, 2, 0]) - loop_rad * 2 * CHIRP_S / LOOP_S
    raised = (raised + np.pi) % (2 * np.pi) - np.pi
    row("elevation: direction cosine", "phase step = -2π d u_z / λ", u[2],
        -raised * WAVELENGTH / (2 * np.pi * HALF_M), 2e-3, "", "handedness_azimuth_and_elevation",
        "moving_point")
    fast = cube("fast_point")
    loop_rad = np.mean([phase(fast[i, 0, 0], fast[i + 1, 0, 0]) for i in range(127)])
    row("beyond the ambiguity", "6 m/s - 2 v_max", 6.0 - 2 * V_MAX, loop_rad * WAVELENGTH / (4 * np.pi * LOOP_S),
        1e-3, "m/s", "speeds_beyond_the_ambiguity_fold_and_turn_the_direction", "fast_point")

    # Smooth surfaces.
    a, range_m = 0.1, 2.9
    section("sphere, near field", "π a² R² / (a + R)²", np.pi * a**2 * (range_m / (a + range_m)) ** 2,
            field_db(ripple(0.002, a)), "specular_points_in_the_near_field", "sphere", range_m)
    beta = 5 * np.pi / 2
    a = beta / (2 * K)
    factor = abs(1 + 1j * (1 - np.exp(-1j * beta)) / beta) ** 2
    section("sphere, edge term", "π a² |1 + j (1 - e^-jβ) / β|², β = 2ka", np.pi * a**2 * factor,
            field_db(ripple(0.05 * a, a) + 5e-3), "small_spheres_show_the_edge_of_their_lit_half",
            "small_sphere", 3.0 - a)
    side, range_m = 0.03, 9.0
    peak = 4 * np.pi * side**4 / WAVELENGTH**2
    test = "plate_at_normal_incidence_and_against_angle"
    section("plate, normal incidence", "4π A² / λ²", peak, 0.02, test, "plate", range_m)
    theta = np.arcsin(4.493409 / (K * side))
    section("plate, first sidelobe", "sinc² cos²: -13.26 dB", peak * (np.sin(4.493409) / 4.493409 * np.cos(theta)) ** 2,
            0.1, test, "plate_first_sidelobe", range_m)
    row("plate, first null", "0; the wave front's curvature fills it", db(peak * (null_fill(side, range_m) + 2e-3) ** 2),
        db(rcs("plate_first_null", range_m)), 0, "dBsm", test, "plate_first_null", most=True)
    section("cylinder, broadside", "k a L²", K * 0.02 * side**2, field_db(ripple(0.0005, 0.02) / 3 + 3.5e-3),
            "cylinder_broadside_and_tilted", "cylinder", range_m - 0.02)
    range_m, a = 0.3, 0.1
    test = "specular_points_in_the_near_field"
    section("tube, near field", "π R1 R² / (R1 + R)", np.pi * a * range_m**2 / (a + range_m),
            field_db(ripple(0.004, 1 / (1 / a + 1 / range_m))), test, "tube", range_m)
    section("wall, flat limit", "π R²", np.pi * range_m**2, field_db(ripple(0.005, range_m)), test, "wall", range_m)

    # Corners.
    side, range_m = 0.04, 9.0
    expected = 8 * np.pi * side**4 / WAVELENGTH**2
    test = "dihedral_needs_the_second_bounce"
    section("dihedral, two bounces", "8π a² b² / λ²", expected, field_db(0.03), test, "dihedral", range_m)
    row("dihedral, one bounce", "fails: the wings' sidelobes", db(expected * 0.021**2),
        db(rcs("dihedral_single_bounce", range_m)), 0, "dBsm", test, "dihedral_single_bounce", most=True)
    expected = 4 * np.pi * 0.06**4 / (3 * WAVELENGTH**2)
    test = "trihedral_needs_the_third_bounce"
    section("trihedral, three bounces", "4π a⁴ / (3 λ²)", expected, 0.5, test, "trihedral", range_m)
    row("trihedral, one bounce", "fails: the faces' edges", db(expected * 0.05**2),
        db(rcs("trihedral_single_bounce", range_m)), 0, "dBsm", test, "trihedral_single_bounce", most=True)

    # Shadow and noise.
    screen, hidden = cube("screen"), cube("hidden")
    row("shadow", "a hidden ball adds 0", 0.0, np.abs(hidden - screen).max() / np.abs(screen).max(), 0.0, "",
        "what_is_hidden_contributes_nothing", "hidden")
    for scene, figure_db in (("noise", 15.0), ("noise_6_db", 6.0)):
        samples = cube(scene)
        expected = BOLTZMANN * T0_K * RATE * 10 ** (figure_db / 10)
        row(f"noise floor, F = {figure_db:.0f} dB", "k T0 B F", db(expected) + 30,
            db(np.mean(np.abs(samples) ** 2)) + 30, db(1 + 5 / np.sqrt(samples.size)), "dBm",
            "noise_floor_is_k_t_b_f", scene)

    print("| closed form | formula | expected | measured | tolerance | test | scene |")
    print("|---|---|---|---|---|---|---|")
    for *cells, test, scene, ok in rows:
        mark = "" if ok else " **outside**"
        print(f"| {' | '.join(cells)}{mark} | `{test}` | `{scene}.toml` |")
    n_bad = sum(not r[-1] for r in rows)
    print(f"\n{len(rows) - n_bad} of {len(rows)} within tolerance", file=sys.stderr)
    return 1 if n_bad else 0


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    with tempfile.TemporaryDirectory() as scratch:
        sys.exit(main(sys.argv[1], Path(scratch)))
