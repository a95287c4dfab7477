#!/usr/bin/env bash
# BVH readers disagree about position channels of joints below the root.
#
# Guess: a position channel means the same everywhere: it replaces the OFFSET of its joint, as it does on the root.
# What happens: bvhio and bvhsdk use it, bvh-converter and bvhtoolbox ignore it and keep the OFFSET. All four agree
# about the root and about rotations.
# Why it matters: exporters write six channels for every joint, and the positions differ from the OFFSETs where a
# skeleton stretches (shoulders, spine). The same file then gives bodies of two sizes, silently, and so two radar
# signatures.
# What to do: ask for rotations only, or check bone lengths over time. Here: position channels replace the OFFSET on
# every joint (crates/body/src/loaders/bvh.rs).
source "$(dirname "$0")/lib.sh"
install numpy==2.4.6 bvhio==1.5.4 bvhsdk==0.2.1 bvh-converter==1.0.2 bvhtoolbox==0.1.3 transforms3d==0.4.2
observe <<'PYTHON'
import csv
import subprocess
import sys

import bvhio
import bvhsdk

from finding import report

with open("arm.bvh", "w") as file:
    file.write("""HIERARCHY
ROOT Hips
{
  OFFSET 0 90 0
  CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation
  JOINT Spine
  {
    OFFSET 0 10 0
    CHANNELS 3 Zrotation Xrotation Yrotation
    JOINT Arm
    {
      OFFSET 20 0 0
      CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation
      End Site
      {
        OFFSET 30 0 0
      }
    }
  }
}
MOTION
Frames: 1
Frame Time: 0.01
1 92 3 10 20 30 40 50 60 25 1 0 0 0 90
""")


def run(*command):
    # bvh2csv exits with 1 when it has succeeded, so the tables are what counts.
    subprocess.run([f"{sys.prefix}/bin/{command[0]}", *command[1:]], stdout=subprocess.DEVNULL)


def row(name, axes):
    with open(name) as file:
        return {key.strip().lower(): float(value) for key, value in next(csv.DictReader(file)).items()}


root = bvhio.readAsHierarchy("arm.bvh")
root.loadPose(0)
places = {"bvhio": {joint.Name: tuple(joint.PositionWorld) for joint, _, _ in root.layout()}}
sdk = bvhsdk.ReadFile("arm.bvh")
places["bvhsdk"] = {joint.name: tuple(joint.getPosition(0)) for joint in sdk.getlistofjoints()}
run("bvh-converter", "arm.bvh")
table = row("arm_worldpos.csv", ".")
places["bvh-converter"] = {j: tuple(table[f"{j.lower()}.{a}"] for a in "xyz") for j in ("Hips", "Spine", "Arm")}
run("bvh2csv", "-p", "arm.bvh")
table = row("arm_pos.csv", ".")
places["bvhtoolbox"] = {j: tuple(table[f"{j.lower()}.{a}"] for a in "xyz") for j in ("Hips", "Spine", "Arm")}
observed = [
    f"{name}: " + ", ".join(f"{j} ({', '.join(f'{v:.2f}' for v in joints[j])})" for j in ("Hips", "Spine", "Arm"))
    for name, joints in places.items()
]
report(
    "the same places of all joints in all four",
    observed,
    [
        "bvhio: Hips (1.00, 92.00, 3.00), Spine (-0.63, 101.25, 6.42), Arm (-12.48, 123.12, 3.68)",
        "bvhsdk: Hips (1.00, 92.00, 3.00), Spine (-0.63, 101.25, 6.42), Arm (-12.48, 123.12, 3.68)",
        "bvh-converter: Hips (1.00, 92.00, 3.00), Spine (-0.63, 101.25, 6.42), Arm (-10.11, 118.61, 3.44)",
        "bvhtoolbox: Hips (1.00, 92.00, 3.00), Spine (-0.63, 101.25, 6.42), Arm (-10.11, 118.61, 3.44)",
    ],
)
PYTHON
