"""A recording of your own (CSV) as a trial that `tis` reads: resampled to 30 Hz, in metres, in JIGSAWS' 76 columns.

Usage: python examples/own_recordings.py RECORDING.csv FOLDER

`own_recording.csv` was drawn for this example: smooth reaches of one hand, sampled at 50 Hz. Its columns are the time
in s and, in mm, the positions of a master and of the arm that it drives.
"""

import argparse
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

RATE_HZ = 30.0  # the rate of JIGSAWS trials
COLUMNS_OF_A_DEVICE = 19  # position 3, rotation matrix 9, velocity 3, angular velocity 3, gripper angle 1
MASTER_LEFT, MASTER_RIGHT, ARM_PSM1, ARM_PSM2 = (number * COLUMNS_OF_A_DEVICE for number in range(4))


def resampled(times_s: NDArray[np.float64], values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return `values`, shape (n, 3), linearly interpolated at 30 Hz from the first to the last of `times_s`."""
    grid_s = np.arange(times_s[0], times_s[-1], 1 / RATE_HZ)
    return np.column_stack([np.interp(grid_s, times_s, axis) for axis in values.T])


def trial(master_m: NDArray[np.float64], arm_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the rows of a trial, shape (n, 76), with one master and one arm; the other two devices stay at 0."""
    rows = np.zeros((len(master_m), 4 * COLUMNS_OF_A_DEVICE))
    for first in (MASTER_LEFT, MASTER_RIGHT, ARM_PSM1, ARM_PSM2):
        rows[:, first + 3 : first + 12] = np.eye(3).ravel()  # no orientation was recorded
    rows[:, MASTER_LEFT : MASTER_LEFT + 3] = master_m
    rows[:, ARM_PSM2 : ARM_PSM2 + 3] = arm_m
    return rows


def main() -> None:
    """Convert the recording that the command line names."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("recording", type=Path)
    parser.add_argument("folder", type=Path)
    given = parser.parse_args()

    table = np.loadtxt(given.recording, delimiter=",", skiprows=1)
    times_s, positions_m = table[:, 0], table[:, 1:] / 1000.0
    rows = trial(resampled(times_s, positions_m[:, :3]), resampled(times_s, positions_m[:, 3:]))

    # TASK is one of JIGSAWS' three; the trial is a letter for the person and three digits.
    path = given.folder / "Suturing" / "kinematics" / "AllGestures" / "Suturing_A001.txt"
    path.parent.mkdir(parents=True, exist_ok=True)
    np.savetxt(path, rows, fmt="%.9f")
    print(f"{path}: {len(rows)} rows, {len(rows) / RATE_HZ:.1f} s")


if __name__ == "__main__":
    main()
