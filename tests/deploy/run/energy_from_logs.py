"""The energy that a hand puts into its coupling, from a surgeon's log, by nothing of `tis`.

``python tests/deploy/run/energy_from_logs.py RUN_DIR ...`` prints the least of E(t) for each run.
"""

import json
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from mcap.reader import make_reader
from numpy.typing import NDArray

Array = NDArray[np.float64]


def rows(run_dir: Path, side: str, topic: str) -> Iterator[dict[str, Any]]:
    """Yield a side's messages on a topic."""
    with (run_dir / f"{side}.mcap").open("rb") as file:
        for _, _, message in make_reader(file).iter_messages(topics=[topic]):
            yield json.loads(message.data)


def vectors(of: list[dict[str, Any]], field: str) -> Array:
    """Return a field of the messages (N, 3)."""
    return np.array([[row[field][axis] for axis in "xyz"] for row in of])


def energy_mj(run_dir: Path) -> Array:
    """Return E(t) = sum of F_k (x_{k+1} - x_k), with the force of the hand on the coupling, from 0 on."""
    shown = list(rows(run_dir, "surgeon", "tis/MTML/servo_cf"))
    places, forces = vectors(shown, "position_m"), -vectors(shown, "force_n")
    return np.append(0.0, 1000.0 * np.cumsum((forces[:-1] * np.diff(places, axis=0)).sum(axis=1)))


if __name__ == "__main__":
    for word in sys.argv[1:]:
        energy = energy_mj(Path(word))
        sys.stdout.write(f"{word}: {len(energy)} ticks, least {energy.min():.4f} mJ, last {energy[-1]:.4f} mJ\n")
