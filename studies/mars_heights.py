"""How high the radar points of MARS lie above the Kinect joints that were recorded with them.

    python mars_heights.py DIR      # DIR/subjectN/timesplit/{radar,kinect}_data_{validate,test}.csv

Both are in the axes of the radar. For each frame, the median height of the points is compared with the mean height of
the joints. Only subject 1 is read: subject 3 is for testing, and subject 2 has no radar files of this form.
"""

import csv
import pathlib
import statistics
import sys

N_JOINTS = 25


def radar_frames(path):
    frames, last = [], None
    with path.open() as file:
        for row in list(csv.reader(file))[1:]:
            if row[0] != last:
                frames.append([])
                last = row[0]
            frames[-1].append(float(row[4]))
    return frames


def joint_heights(path):
    with path.open() as file:
        for row in list(csv.reader(file))[1:]:
            yield [float(value) for value in row[-N_JOINTS:]]


def main(folder):
    for part in ("validate", "test"):
        split = pathlib.Path(folder) / "subject1" / "timesplit"
        frames = radar_frames(split / f"radar_data_{part}.csv")
        joints = list(joint_heights(split / f"kinect_data_{part}.csv"))
        pairs = zip(frames, joints, strict=True)
        above_m = [statistics.median(points) - statistics.mean(heights) for points, heights in pairs]
        print(f"{part}: {len(above_m)} frames, points {statistics.median(above_m):.2f} m above the joints")


if __name__ == "__main__":
    main(*sys.argv[1:])
