#!/usr/bin/env bash
# RdLib's metres of an LD2450 are ten times too long to the side, and right ahead.
#
# Guess: the board's signed 16-bit millimetres become metres with one factor of 1000.
# What happens: two surprises. The board's bit 15 means "positive", with 15 bits of magnitude, so a reader with two's
# complement sees 1.5 m as -31.268 m. RdLib knows that, but its default unit "m" divides x by 100 and y by 1000.
# Why it matters: the LD2450 and Rd-03D are the radars of home presence; a person at (1.5, 2) m is taken for one at
# (15, 2) m, beyond the board's range of 6 m, and directions turn from 37 to 82 degrees.
# What to do: use the unit "cm", which is right. Here: the LD2450 is not read yet.
source "$(dirname "$0")/lib.sh"
install numpy==2.4.6 matplotlib==3.11.2 pyserial==3.5 rdlib==0.9
observe <<'PYTHON'
import struct

import serial

from finding import report

# One frame of the board: a target at x 1500 mm, y 2000 mm, -20 cm/s, and two empty places.
words = [0x8000 | 1500, 0x8000 | 2000, 20, 320]
frame = bytes.fromhex("aaff0300") + struct.pack("<4H", *words) + bytes(16) + bytes.fromhex("55cc")


class Port:
    """Stands in for the serial port, which RdLib opens when it is imported."""

    in_waiting = len(frame)

    def __init__(self, *_, **__):
        pass

    def flushInput(self):
        pass

    def read(self, _):
        return frame


serial.Serial = Port
from RdLib import RdDriver  # noqa: E402
from RdLib.config import config  # noqa: E402

config.Kalman = False
observed = [f"two's complement: x {struct.unpack('<h', struct.pack('<H', words[0]))[0] / 1000} m"]
for unit in (config.distance_units, "cm", "mm"):
    config.distance_units, RdDriver.buffer_hex = unit, ""
    x, y = RdDriver.ReadRadarData()
    observed.append(f"RdLib: x {x:g} {unit}, y {y:g} {unit}")
report(
    "x 1.5 m, y 2 m",
    observed,
    [
        "two's complement: x -31.268 m",
        "RdLib: x 15 m, y 2 m",
        "RdLib: x 150 cm, y 200 cm",
        "RdLib: x 1500 mm, y 2000 mm",
    ],
)
PYTHON
