"""Opening recordings."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import Literal

from ._native import Capture, Radar

StrPath = str | os.PathLike[str]


def open_capture(
    capture: StrPath | Sequence[StrPath],
    *,
    radar: Radar | StrPath | None = None,
    format: str | None = None,
    iq: Literal["i-first", "q-first", "auto"] | None = None,
    lanes: int | None = None,
    real: bool = False,
    axes: str | None = None,
    frame_rate_hz: float | None = None,
    orientation: str | None = None,
    dialect: str | None = None,
    topic: str | None = None,
    run: int | None = None,
    columns: str | None = None,
    baud: int = 921_600,
    seconds: float | None = None,
    tilt_deg: float = 0.0,
    yaw_deg: float = 0.0,
    roll_deg: float = 0.0,
    min_speed_mps: float | None = None,
    accumulate: int = 1,
    motion_compensate: bool = False,
    background: StrPath | None = None,
    background_cell_m: float | None = None,
    background_velocity_mps: float | None = None,
    background_share: float | None = None,
    calibration: StrPath | None = None,
    remove_offset: bool = False,
    remove_leakage_m: float | None = None,
    processing: StrPath | None = None,
    max_frames: int | None = None,
    radar_height_m: float | None = None,
) -> Capture:
    """Open a recording of any radar: raw samples, points of a firmware, or a points file.

    Several paths are parts of one recording of raw samples. The keywords are the flags of ``radarllm process`` and
    ``radarllm describe``.

    :param capture: the file or folder; ``udp:PORT`` listens to a capture card
    :param radar: the radar that made the recording; raw samples need it
    :param format: format of the recording, detected if None
    :param iq: order of I and Q in raw words
    :param lanes: LVDS lanes of the device, 2 or 4; known for boards that have a name
    :param real: samples are real numbers
    :param axes: axes of an npy array, slowest first, as in "frame,chirp,rx,sample"
    :param frame_rate_hz: frame rate of recorded points, where neither the recording nor the radar gives it
    :param orientation: axes of recorded points, "right-forward-up" or "forward-left-up"
    :param dialect: UART dialect, detected if None
    :param topic: topic of a ROS bag with several
    :param run: one of several runs of a visualizer in one folder, counted from 1 for the oldest
    :param columns: names of the columns of a table without a header, or with one that is not known, as in
        "frame,-,x,y,z,velocity,snr"; "-" or "_" skips a column
    :param baud: baud rate of a serial port
    :param seconds: time to record from a serial port, s
    :param tilt_deg: angle of the radar's boresight below the horizon, degrees
    :param yaw_deg: angle by which the radar is turned to its right, degrees
    :param roll_deg: angle by which the radar's right side is lowered, degrees
    :param min_speed_mps: remove points slower than this, m/s
    :param accumulate: number of frames accumulated into each, for radars that report few points
    :param motion_compensate: move accumulated points along their radial velocity to the time of their new frame
    :param background: recording of the same scene without people
    :param background_cell_m: edge of the background's cells in x, y and z, m
    :param background_velocity_mps: edge of the background's cells in velocity, m/s
    :param background_share: share of the empty frames from which on a cell is background
    :param calibration: channel gains, made by ``radarllm radar calibrate``
    :param remove_offset: remove the mean of each receiver of raw samples
    :param remove_leakage_m: remove static echoes of raw samples up to this range, m
    :param processing: TOML file with a table ``[processing]``, for raw samples
    :param max_frames: read only the first frames of raw samples
    :param radar_height_m: height of the radar above the floor, m
    """
    paths = [capture] if isinstance(capture, (str, os.PathLike)) else list(capture)
    keywords = {
        "radar": radar,
        "format": format,
        "iq": iq,
        "lanes": lanes,
        "real": real,
        "axes": axes,
        "frame_rate_hz": frame_rate_hz,
        "orientation": orientation,
        "dialect": dialect,
        "topic": topic,
        "run": run,
        "columns": columns,
        "baud": baud,
        "seconds": seconds,
        "tilt_deg": tilt_deg,
        "yaw_deg": yaw_deg,
        "roll_deg": roll_deg,
        "min_speed_mps": min_speed_mps,
        "accumulate": accumulate,
        "motion_compensate": motion_compensate,
        "background": background,
        "background_cell_m": background_cell_m,
        "background_velocity_mps": background_velocity_mps,
        "background_share": background_share,
        "calibration": calibration,
        "remove_offset": remove_offset,
        "remove_leakage_m": remove_leakage_m,
        "max_frames": max_frames,
        "radar_height_m": radar_height_m,
    }
    return Capture._open(paths, processing, keywords)
