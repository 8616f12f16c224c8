"""Benchmark of identification (`tis bench identification`): time and memory, beside other packages.

One call is a complete identification: A, B, C, D, each trial's x0, K and the noise. The other packages (the extra
``peers``) are measured in the same run, on the same data; none accepts several trials. Predictions of plants with
poles near the unit circle follow, see `prediction_accuracy`.
"""

import time
import tracemalloc
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from importlib.util import find_spec
from statistics import median
from typing import Final

import numpy as np
from rich.console import Console

from tis.common.errors import EXIT_OK
from tis.deploy.bench.prediction_accuracy import PLANTS, SIPPY, nfoursid_model, prediction_errors, sippy_model
from tis.deploy.present.table import Table
from tis.patient_side.identification.hankel import triangular_factor
from tis.patient_side.identification.subspace_methods import METHODS
from tis.patient_side.linear_system import Array, StateSpace

BLOCK_ROWS: Final = 10
ORDER: Final = 4
PLANT_ROWS: Final = 1500
ORDER_OF_PLANTS: Final = 2
_MB: Final = 1e6
_MAX_TOTAL_MS: Final = 5000.0

Call = Callable[[Sequence[Array], Sequence[Array]], object]


@dataclass(frozen=True)
class Size:
    """Trials of equal length, as many inputs as outputs; the bounds apply to the methods of the testbed."""

    name: str
    n_trials: int
    n_rows: int
    n_channels: int
    n_repeats: int
    time_max_ms: float
    memory_max_mb: float | None = None
    peers: bool = True


SIZES: Final = (
    Size("1 240 rows, 3 x 3", 1, 1240, 3, 15, 15.0),
    Size("10 000 rows, 2 x 2", 1, 10_000, 2, 9, 60.0),
    Size("90 trials, 200 000 rows, 3 x 3", 90, 2223, 3, 3, 3000.0, 500.0, peers=False),
)


@dataclass(frozen=True)
class Measured:
    """Median time of a call and its peak memory, without its data."""

    who: str
    time_ms: float
    memory_mb: float


def bench_identification(out: Console) -> int:
    """Measure every method and peer at every size, print a table each, and return the exit code."""
    for size in SIZES:
        u, y = simulated_trials(size.n_trials, size.n_rows, size.n_channels, seed=1)
        rows = []
        for who, call in _calls(size).items():
            measured = measure(who, call, u, y, size.n_repeats)
            rows.append((who, f"{measured.time_ms:.1f}", f"{measured.memory_mb:.1f}", _verdict(size, measured)))
        title = f"{size.name}: {BLOCK_ROWS} block rows, order {ORDER}"
        out.print(Table(title, ("", "median, ms", "peak memory, MB", "bound"), rows).terminal())
    for plant in PLANTS:
        found = prediction_errors(*plant.rows(PLANT_ROWS, 1), ORDER_OF_PLANTS)
        errors = [(who, f"{error:.4f}") for who, error in found]
        title = f"{plant.name}: errors 5 samples ahead over the outputs' deviation, poles free unless stable"
        out.print(Table(title, ("", "error"), errors).terminal())
    return EXIT_OK


def simulated_trials(n_trials: int, n_rows: int, n_channels: int, seed: int) -> tuple[list[Array], list[Array]]:
    """Return inputs and outputs (N, d) of a random stable system of 4 states with process and measurement noise."""
    rng = np.random.default_rng(seed)
    A = rng.normal(size=(ORDER, ORDER))
    A *= 0.9 / np.max(np.abs(np.linalg.eigvals(A)))
    # the noises enter as additional inputs
    B = np.hstack([rng.normal(size=(ORDER, n_channels)), 0.1 * np.eye(ORDER), np.zeros((ORDER, n_channels))])
    D = np.hstack(
        [rng.normal(size=(n_channels, n_channels)), np.zeros((n_channels, ORDER)), 0.1 * np.eye(n_channels)]
    )
    system = StateSpace(A, B, rng.normal(size=(n_channels, ORDER)), D)
    driven = [rng.normal(size=(n_rows, B.shape[1])) for _ in range(n_trials)]
    return [signal[:, :n_channels].copy() for signal in driven], [system.simulate(signal) for signal in driven]


def measure(who: str, call: Call, u: Sequence[Array], y: Sequence[Array], n_repeats: int) -> Measured:
    """Call once to warm up, ``n_repeats`` times or for 5 s, and once more under `tracemalloc`."""
    times_ms: list[float] = []
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")  # warnings of the other packages are not of interest here
        call(u, y)
        while len(times_ms) < n_repeats and sum(times_ms) < _MAX_TOTAL_MS:
            begun = time.perf_counter()
            call(u, y)
            times_ms.append(1e3 * (time.perf_counter() - begun))
        tracemalloc.start()  # slows the call, so it is not timed
        try:
            call(u, y)
            peak_bytes = tracemalloc.get_traced_memory()[1]
        finally:
            tracemalloc.stop()
    return Measured(who, median(times_ms), peak_bytes / _MB)


def _calls(size: Size) -> dict[str, Call]:
    calls: dict[str, Call] = {
        name: partial(method, order=ORDER, horizon=BLOCK_ROWS) for name, method in METHODS.items()
    }
    calls["  triangular factor alone"] = lambda u, y: triangular_factor(list(zip(u, y, strict=True)), BLOCK_ROWS)
    if size.peers:
        calls.update(_peers())
    return calls


def _peers() -> dict[str, Call]:
    """Return the calls of the installed other packages, on the first trial."""
    peers: dict[str, Call] = {}
    if find_spec("sippy_unipi"):
        for method in SIPPY:
            peers[f"sippy_unipi {method}"] = lambda u, y, method=method: sippy_model(  # type: ignore[misc]
                method, u[0], y[0], ORDER, BLOCK_ROWS
            )
    if find_spec("nfoursid"):
        peers["nfoursid PO-MOESP"] = lambda u, y: nfoursid_model(u[0], y[0], ORDER, BLOCK_ROWS)
    return peers


def _verdict(size: Size, measured: Measured) -> str:
    if measured.who not in METHODS:
        return ""
    kept = measured.time_ms <= size.time_max_ms
    kept = kept and (size.memory_max_mb is None or measured.memory_mb < size.memory_max_mb)
    memory = "" if size.memory_max_mb is None else f", {size.memory_max_mb:.0f} MB"
    return f"{size.time_max_ms:.0f} ms{memory}: {'kept' if kept else 'MISSED'}"
