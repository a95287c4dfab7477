#!/usr/bin/env bash
# The nuScenes devkit returns some of the points of a radar file, and which ones is a setting of the class.
#
# Guess: `RadarPointCloud.from_file` returns the points that the file holds, with the states of each among its rows, and what one
# caller asks for does not change what another gets.
# What happens: points whose Doppler is ambiguous, whose state is not 0 or whose dynamic property is 7 are left out, and nothing
# says so. `disable_filters` changes this for every later call of the program.
# Why it matters: counts, densities and clusters of points are those of the filter and not of the radar, and two parts of a program
# read the same file differently depending on who ran first.
# What to do: pass all three lists of states with every call. Here: readers of points drop nothing but values that are not
# finite or beyond belief, and count them.
source "$(dirname "$0")/lib.sh"
install nuscenes-devkit==1.2.0
observe <<'PYTHON'
import struct

from nuscenes.utils.data_classes import RadarPointCloud

from finding import report

# Fields of the radar files of nuScenes: name, size in bytes, type.
FIELDS = (
    "x 4 F,y 4 F,z 4 F,dyn_prop 1 I,id 2 I,rcs 4 F,vx 4 F,vy 4 F,vx_comp 4 F,vy_comp 4 F,is_quality_valid 1 I,"
    "ambig_state 1 I,x_rms 1 I,y_rms 1 I,invalid_state 1 I,pdh0 1 I,vx_rms 1 I,vy_rms 1 I"
)
fields = [field.split() for field in FIELDS.split(",")]
CODES = {"4F": "f", "1I": "b", "2I": "h"}
layout = "<" + "".join(CODES[size + kind] for _, size, kind in fields)

# Dynamic property, state of the Doppler ambiguity (3: none) and state of the point (0: valid).
states = [(0, 3, 0), (1, 3, 0), (7, 3, 0), (0, 1, 0), (0, 4, 0), (0, 3, 4), (0, 3, 17), (6, 3, 0)]
points = b""
for number, (dynamic, ambiguity, state) in enumerate(states):
    values = {"x": 1.0 + number, "y": 0.5, "dyn_prop": dynamic, "id": number, "ambig_state": ambiguity, "invalid_state": state, "is_quality_valid": 1}
    points += struct.pack(layout, *(values.get(name, 0) for name, _, _ in fields))
columns = list(zip(*fields))
header = [
    "# .PCD v0.7 - Point Cloud Data file format",
    "VERSION 0.7",
    "FIELDS " + " ".join(columns[0]),
    "SIZE " + " ".join(columns[1]),
    "TYPE " + " ".join(columns[2]),
    "COUNT " + " ".join("1" for _ in fields),
    f"WIDTH {len(states)}",
    "HEIGHT 1",
    "VIEWPOINT 0 0 0 1 0 0 0",
    f"POINTS {len(states)}",
    "DATA binary",
]
with open("radar.pcd", "wb") as file:
    # The devkit asks for a byte behind the last point.
    file.write("\n".join(header).encode() + b"\n" + points + b"\n")


def read():
    cloud = RadarPointCloud.from_file("radar.pcd")
    return [int(x) - 1 for x in cloud.points[0]]


observed = [f"file of {len(states)} points, from_file returns points {read()}"]
RadarPointCloud.disable_filters()
observed.append(f"after disable_filters, the same call returns points {read()}")
report(
    "from_file returns the 8 points of the file",
    observed,
    [
        "file of 8 points, from_file returns points [0, 1, 7]",
        "after disable_filters, the same call returns points [0, 1, 2, 3, 4, 5, 6, 7]",
    ],
)
PYTHON
