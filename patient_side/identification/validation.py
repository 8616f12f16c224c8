"""Validation: errors of a model's simulations and predictions on rows that it was not fitted to."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from tis.patient_side.identification.trials import Trial, n_first
from tis.patient_side.linear_system import Array, StateSpace

HELD_BACK = 0.3
"""Share of each trial's rows, its last ones, that models are compared on."""

PREDICTED_STEPS = 5
"""Samples ahead at which predictions are compared: 170 ms at 30 Hz, the age of a delayed sample."""

_MAX_SHARE = 1e6
"""Upper bound of SSE/SST: an unstable model's simulation can overflow, and JSON has no infinity."""


@dataclass(frozen=True)
class SimulationFit:
    """``fit_pct`` (p,): variance accounted for, 100 (1 - SSE/SST). ``error``: rms error / rms deviation."""

    fit_pct: tuple[float, ...]
    error: float


def fit_text(fit_pct: float, decimals: int) -> str:
    """Return a fit in % as text; below -1000 %, as of an unstable model, as a power of ten.

    A fit below 100 % never rounds to 100.
    """
    if fit_pct <= -1000:
        return f"{fit_pct:.0e}"
    if fit_pct < 100 <= round(fit_pct, decimals):
        fit_pct = 100 - 10.0**-decimals
    return f"{fit_pct:.{decimals}f}"


def split_trials(trials: Sequence[Trial]) -> tuple[list[Trial], list[Trial]]:
    """Return the first rows of every trial, to fit on, and its last 30 %, to validate on."""
    cuts = [n_first(len(u), HELD_BACK) for u, _ in trials]
    fit_on = [(u[:cut], y[:cut]) for (u, y), cut in zip(trials, cuts, strict=True)]
    validate_on = [(u[cut:], y[cut:]) for (u, y), cut in zip(trials, cuts, strict=True)]
    return fit_on, validate_on


def fewest_rows(block_rows: int) -> int:
    """Return the rows of the shortest trial that is simulated beyond the start of its held-back rows.

    Shorter parts of a trial are not worth their initial state. The start has twice the ``block_rows``.
    """
    n_rows = 2 * block_rows + 1
    while n_rows - n_first(n_rows, HELD_BACK) <= 2 * block_rows:
        n_rows += 1
    return n_rows


def simulation_fit(space: StateSpace, trials: Sequence[Trial], n_start: int) -> SimulationFit:
    """Simulate each trial from a state fitted to its first ``n_start`` rows, and score the rows after them.

    SSE and SST are pooled over trials, SST about each trial's own mean. An axis that does not move scores 0.
    Trials of at most ``n_start`` rows are omitted; without any other trial every axis scores 0. A simulation
    that diverges, as an unstable model's does, scores -1e8 % at worst.
    """
    return scored(lambda u, y: simulate_on(space, u, y, n_start), space.n_outputs, trials, n_start)


def scored(
    simulate: Callable[[Array, Array], Array], n_outputs: int, trials: Sequence[Trial], n_start: int
) -> SimulationFit:
    """Score ``simulate``, which may use the first ``n_start`` outputs, as `simulation_fit` does."""
    sse, sst = np.zeros(n_outputs), np.zeros(n_outputs)
    for u, y in trials:
        if len(u) <= n_start:
            continue
        with np.errstate(over="ignore", invalid="ignore"):
            simulated = simulate(u, y)
            sse += np.square(y[n_start:] - simulated[n_start:]).sum(axis=0)
        sst += np.square(y[n_start:] - y[n_start:].mean(axis=0)).sum(axis=0)
    share = _share(sse, sst)
    return SimulationFit(tuple(float(f) for f in 100 * (1 - share)), float(np.sqrt(np.mean(share))))


def prediction_error(space: StateSpace, gain: Array, trials: Sequence[Trial], n_start: int) -> float:
    """Return the rms error of predicting the outputs 5 samples ahead, with known inputs, over that of hold.

    The predictor has the constant ``gain`` (n, p), and starts on each trial as `simulation_fit` does; both errors
    are pooled over trials axis by axis, and the result is the root of the mean square ratio over the axes.
    Oracle: a plain loop.
    """
    A, p, h = space.A, space.n_outputs, PREDICTED_STEPS
    observer = StateSpace(
        A - gain @ space.C,
        np.hstack([space.B - gain @ space.D, gain]),
        np.eye(space.order),
        np.zeros((space.order, space.n_inputs + p)),
    )
    sse, sst = np.zeros(p), np.zeros(p)
    for u, y in trials:
        n_rows = len(u) - n_start - h
        if n_rows < 1:
            continue
        with np.errstate(over="ignore", invalid="ignore"):
            start = initial_state(space, u[:n_start], y[:n_start])
            # The state after row k, for k = n_start .. N - 1 - h.
            state = observer.simulate(np.hstack([u, y]), start)[n_start + 1 : n_start + 1 + n_rows]
            for step in range(1, h):
                state = state @ A.T + u[n_start + step : n_start + step + n_rows] @ space.B.T
            predicted = state @ space.C.T + u[n_start + h :] @ space.D.T
            sse += np.square(y[n_start + h :] - predicted).sum(axis=0)
        sst += np.square(y[n_start + h :] - y[n_start : n_start + n_rows]).sum(axis=0)
    return float(np.sqrt(np.mean(_share(sse, sst))))


def _share(sse: Array, sst: Array) -> Array:
    """Return sse / sst (p,), bounded, and 1 for an axis that does not move."""
    share = np.divide(sse, sst, out=np.ones_like(sse), where=sst > 0)
    return np.asarray(np.minimum(np.nan_to_num(share, nan=np.inf), _MAX_SHARE))


def simulate_on(space: StateSpace, u: Array, y: Array, n_start: int) -> Array:
    """Return the outputs (N, p) simulated from a state fitted to the first ``n_start`` rows."""
    return space.simulate(u, initial_state(space, u[:n_start], y[:n_start]))


def initial_state(space: StateSpace, u: Array, y: Array) -> Array:
    """Return the state (n,) at the first row whose simulation fits these rows best, by least squares."""
    observed = np.empty((len(u), space.n_outputs, space.order))
    block = space.C
    for k in range(len(u)):
        observed[k] = block
        block = block @ space.A
    rest = (y - space.simulate(u)).reshape(-1)
    return np.asarray(np.linalg.lstsq(observed.reshape(len(rest), -1), rest)[0])
