"""Identification as a library: arrays in, a system out; ``from tis import identify``.

The signals are brought to unit deviation first, so that no result depends on their units, and gaps split trials.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Final, Literal, get_args

import numpy as np

from tis.common.errors import DataError, Fault
from tis.common.order_rules import Order, OrderRule
from tis.patient_side.identification.arx import fit_arx
from tis.patient_side.identification.identified_system import IdentifiedSystem
from tis.patient_side.identification.input_delay import delayed, estimate_delay
from tis.patient_side.identification.linear_model import LinearModel, Signals, as_arrays
from tis.patient_side.identification.order import OrderChoice
from tis.patient_side.identification.output_error import STABLE_BELOW
from tis.patient_side.identification.subspace_methods import METHODS, SUBSPACE_METHODS, fit_subspace
from tis.patient_side.identification.trials import Scaling, Trial, breakdown_as_fault, check_trials, n_first
from tis.patient_side.identification.validation import HELD_BACK, PREDICTED_STEPS
from tis.patient_side.linear_system import NoiseModel

_WHERE: Final = "identify"
_HORIZONS: Final = (15, 12, 10, 8, 6, 5, 4, 3, 2)
_COLUMNS_PER_DIRECTION: Final = 3
_FEWEST_VALIDATED: Final = 10


def identify(
    u: Signals | None,
    y: Signals,
    *,
    dt: float = 1.0,
    method: str = "moesp",
    order: Order = "auto",
    horizon: int | Literal["auto"] = "auto",
    stable: bool = False,
    delay: int | Sequence[int] | Literal["auto"] = 0,
) -> IdentifiedSystem:
    """Identify a linear system from its inputs and outputs.

    Parameters
    ----------
    u, y
        Inputs (N, m) and outputs (N, p) about an operating point, one array for each of several trials; (N,) is one
        channel. ``u`` may be None: outputs alone. Rows with NaN are gaps, which end a stretch.
    dt
        Time between two rows, in s.
    method
        `moesp`, `pi_moesp`, `n4sid`, `cva` or `arx`.
    order
        Number of states (arx: lags), or the rule that chooses it: `auto` predicts held-back rows.
    horizon
        Number of block rows (arx: most lags); `auto`: 15, or what the rows allow.
    stable
        Whether poles outside the unit circle, or on it, are moved inside. Else they are kept as they are found, and a
        filter's errors are minimised instead of a simulation's.
    delay
        Samples by which the inputs act late, one number or one for each; `auto` finds them.

    Returns
    -------
    IdentifiedSystem
        Matrices, noise, simulation, forecasts, filter and tests.

    Raises
    ------
    DataError
        With all faults of the arguments, or of the rows.

    Notes
    -----
    Example: docs/research/identification.md. Oracles in test_system_identification: Markov parameters, known plants.
    """
    _check_options(dt, method, order, horizon, delay, alone=u is None)
    trials, places, each, block_rows = _prepared(_trials(u, y), order, horizon, delay)
    scaling = Scaling.of(trials)
    scaled = scaling.scaled(trials)
    with breakdown_as_fault(method):
        orders = None if not isinstance(order, str) else _orders(scaled, method, block_rows, order, stable)
        chosen = order if orders is None else orders.by_rule(order)
        u_scaled, y_scaled = ([trial[side] for trial in scaled] for side in (0, 1))
        found = METHODS[method](u_scaled, y_scaled, chosen, block_rows, stable=stable)
    return IdentifiedSystem(_in_units(found, scaling), float(dt), each, orders, places)


def _prepared(
    given: Sequence[Trial], order: Order, horizon: int | str, delay: int | Sequence[int] | str
) -> tuple[list[Trial], tuple[tuple[int, int, int], ...], tuple[int, ...], int]:
    """Return checked stretches with inputs as they act, their places, each input's delay, and the block rows."""
    n_inputs = given[0][0].shape[1]
    each = _delays(delay, n_inputs)
    whole, _ = _stretches(given, 2)
    check_trials(whole, 1, fewest_inputs=0)
    block_rows = _block_rows(whole, order) if isinstance(horizon, str) else int(horizon)
    if each is None:
        each = estimate_delay(Scaling.of(whole).scaled(whole), block_rows) if n_inputs else ()
    trials, places = _stretches([(delayed(inputs, each), outputs) for inputs, outputs in given], 2 * block_rows)
    check_trials(trials, block_rows, fewest_inputs=0)
    return trials, places, each, block_rows


def _check_options(dt: object, method: object, order: object, horizon: object, delay: object, *, alone: bool) -> None:
    faults = []
    if not isinstance(dt, float | int | np.number) or not 0 < dt < np.inf:
        faults.append(Fault(_WHERE, "dt", "must be a time in s above 0", dt))
    if method not in METHODS:
        faults.append(Fault(_WHERE, "method", f"must be one of {', '.join(METHODS)}", method))
    elif method == "pi_moesp" and alone:
        faults.append(Fault(_WHERE, "method", "must be another one without inputs, which pi_moesp explains all by"))
    rules = get_args(OrderRule)
    if order not in rules if isinstance(order, str) else not _whole(order, 0):
        faults.append(Fault(_WHERE, "order", f"must be an integer >= 0 or one of {', '.join(rules)}", order))
    if horizon != "auto" and not _whole(horizon, 1 if method == "arx" else 2):
        faults.append(Fault(_WHERE, "horizon", "must be an integer, 2 or more (arx: 1), or auto", horizon))
    each = [delay] if isinstance(delay, str) or not isinstance(delay, Sequence | np.ndarray) else list(delay)
    if delay != "auto" and not all(_whole(one, 0) for one in each):
        faults.append(
            Fault(_WHERE, "delay", "must be samples >= 0, one number or one for each input, or auto", delay)
        )
    if faults:
        raise DataError(faults)


def _whole(value: object, smallest: int) -> bool:
    return isinstance(value, int | np.integer) and not isinstance(value, bool) and int(value) >= smallest


def _trials(u: Signals | None, y: Signals) -> list[Trial]:
    outputs = [rows[:, None] if rows.ndim == 1 else rows for rows in as_arrays("output", y)]
    inputs = [np.empty((len(rows), 0)) for rows in outputs] if u is None else as_arrays("input", u)
    inputs = [rows[:, None] if rows.ndim == 1 else rows for rows in inputs]
    shapes = {(a.shape[1:], b.shape[1:]) for a, b in zip(inputs, outputs, strict=False)}
    faults = []
    if not outputs:
        faults.append(Fault(_WHERE, "output", "needs at least one trial"))
    if len(inputs) != len(outputs):
        faults.append(Fault(_WHERE, "output", f"must have as many trials as the input, {len(inputs)}", len(outputs)))
    if len(shapes) > 1 or any(rows.ndim != 2 for rows in inputs + outputs):
        faults.append(Fault(_WHERE, "trials", "all must have the shape (samples, channels), with the same channels"))
    for number, (a, b) in enumerate(zip(inputs, outputs, strict=False), 1):
        if len(a) != len(b):
            faults.append(
                Fault(f"trial {number}", "output", f"must have as many rows as the input, {len(a)}", len(b))
            )
        if np.isinf(a).any() or np.isinf(b).any():
            faults.append(Fault(f"trial {number}", "rows", "must not be infinite; NaN is a missing value"))
    if faults:
        raise DataError(faults)
    return list(zip(inputs, outputs, strict=True))


def _delays(delay: int | Sequence[int] | str, n_inputs: int) -> tuple[int, ...] | None:
    """Return each input's delay; None where it is to be found."""
    if isinstance(delay, str):
        return None
    each = np.broadcast_to(delay, n_inputs) if np.ndim(delay) == 0 else np.asarray(delay)
    if len(each) != n_inputs:
        raise DataError(Fault(_WHERE, "delay", f"must be one number or {n_inputs}, one for each input", len(each)))
    return tuple(int(one) for one in each)


def _stretches(given: Sequence[Trial], shortest: int) -> tuple[list[Trial], tuple[tuple[int, int, int], ...]]:
    """Return the rows between gaps, and the trial, first row and end of each; shorter ones are left out."""
    trials, places = [], []
    for number, (u, y) in enumerate(given):
        known = np.isfinite(u).all(axis=1) & np.isfinite(y).all(axis=1)
        edges = np.flatnonzero(np.diff(np.concatenate([[0], known.astype(int), [0]])))
        for first, end in edges.reshape(-1, 2).tolist():
            if end - first >= shortest:
                trials.append((u[first:end], y[first:end]))
                places.append((number, first, end))
    if not trials:
        raise DataError(Fault(_WHERE, "rows", f"must contain {shortest} in succession without NaN"))
    return trials, tuple(places)


def _block_rows(trials: Sequence[Trial], order: Order) -> int:
    """Return the most block rows that leave enough Hankel columns and, where needed, rows to judge the order."""
    d, held = trials[0][0].shape[1] + trials[0][1].shape[1], HELD_BACK if isinstance(order, str) else 0.0
    longest = max(len(u) for u, _ in trials)
    judged = longest - n_first(longest, HELD_BACK)
    for s in _HORIZONS:
        columns = sum(max(0, n_first(len(u), held) - 2 * s + 1) for u, _ in trials)
        if columns >= _COLUMNS_PER_DIRECTION * 2 * s * d and (not held or judged >= _judged_rows(s)):
            return s
    return _HORIZONS[-1]


def _judged_rows(block_rows: int) -> int:
    return 2 * block_rows + PREDICTED_STEPS + _FEWEST_VALIDATED


def _orders(trials: Sequence[Trial], method: str, block_rows: int, order: OrderRule, stable: bool) -> OrderChoice:
    longest, needed = max(len(u) for u, _ in trials), _judged_rows(block_rows)
    if longest - n_first(longest, HELD_BACK) < needed:
        rule = (
            f"{needed} rows, {HELD_BACK:.0%} of a stretch without gaps, are needed to choose the order with"
            f" {block_rows} block rows: give the order, or a smaller horizon"
        )
        raise DataError(Fault(_WHERE, "order", rule, order))
    labels = [f"trial {i}" for i in range(1, len(trials) + 1)]
    if method == "arx":
        return fit_arx(trials, labels, block_rows, order, stable=stable).orders
    return fit_subspace(trials, labels, SUBSPACE_METHODS[method], block_rows, order, stable=stable).orders


def _in_units(found: LinearModel, scaling: Scaling) -> LinearModel:
    """Return a model of signals at unit deviation as one of the signals; the state is unchanged."""
    out, warnings = scaling.output, found.warnings
    noise = NoiseModel(found.noise.Q, out[:, None] * found.noise.R * out, found.noise.S * out)
    radius = found.space.spectral_radius()
    if radius >= STABLE_BELOW:
        kept = f"poles reach or leave the unit circle, spectral radius {radius:.6g}: simulations diverge"
        warnings = (*warnings, f"{kept}, forecasts do not")
    return replace(found, space=scaling.unscaled(found.space), noise=noise, scaling=scaling, warnings=warnings)
