"""Trials that the tests make up: rows with known numbers and their text in the data set's format."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# first 0-based column of each device, counted off the data set's own description (1, 20, 39 and 58 there)
FIRST = {"MTML": 0, "MTMR": 19, "PSM1": 38, "PSM2": 57}


def rows_of(n_rows: int, seed: int = 0) -> Array:
    """Return (n_rows, 76) rows: wandering positions, identity rotations, arms that follow crosswise at half gain."""
    rng = np.random.default_rng(seed)
    rows = np.zeros((n_rows, 76))
    for device in ("MTML", "MTMR"):
        first = FIRST[device]
        rows[:, first : first + 3] = np.cumsum(rng.normal(scale=1e-3, size=(n_rows, 3)), axis=0)
    for master, arm in (("MTML", "PSM2"), ("MTMR", "PSM1")):
        driven = slice(FIRST[master], FIRST[master] + 3)
        noise = rng.normal(scale=1e-5, size=(n_rows, 3))
        rows[:, FIRST[arm] : FIRST[arm] + 3] = 0.5 * rows[:, driven] + [0.1, -0.2, 0.3] + noise
    for place, first in enumerate(FIRST.values()):
        rows[:, first + 3 : first + 12] = np.eye(3).ravel()
        rows[:, first + 12 : first + 18] = 1e3  # velocities: whoever reads them stands out
        rows[:, first + 18] = 0.1 * place
    return rows


def text_of(rows: Array) -> str:
    """Return the rows as the data set's files have them: 8 decimals, blanks before each number."""
    return "".join("".join(f"{value:15.8f} " for value in row) + "\n" for row in rows)
