"""The radar points of MARS by movement, as CSV files that radarllm reads.

    pip install h5py
    python mars_movements.py DIR OUT      # DIR/subjectN/radar_dataK.mat -> OUT/subjectN/radar_dataK.csv

The data set's MATLAB files hold a matrix of 8 x points: frame, points of the frame, x, y, z, Doppler, intensity, time.
These are the columns of its own CSV files.
"""

import csv
import pathlib
import sys

import h5py

HEAD = ["Frame #", "# Obj", "X", "Y", "Z", "Doppler", "Intensity", "Abs Time"]


def main(folder, out):
    for path in sorted(pathlib.Path(folder).glob("subject*/radar_data*.mat")):
        rows = h5py.File(path)["radar_data_cropped"][:].T
        target = pathlib.Path(out) / path.parent.name / f"{path.stem}.csv"
        target.parent.mkdir(parents=True, exist_ok=True)
        with target.open("w", newline="") as file:
            writer = csv.writer(file)
            writer.writerow(HEAD)
            writer.writerows([int(r[0]), int(r[1]), *(f"{v:.6g}" for v in r[2:7]), f"{r[7]:.3f}"] for r in rows)
        print(target, len(rows), "points")


if __name__ == "__main__":
    main(*sys.argv[1:])
