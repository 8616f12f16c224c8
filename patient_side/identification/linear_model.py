"""The arguments and the result of every linear method, ``identify(u, y, order, horizon)``: one trial or several."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tis.common.errors import DataError, Fault
from tis.patient_side.identification.trials import Scaling, Trial
from tis.patient_side.linear_system import Array, NoiseModel, StateSpace

Signals = Array | Sequence[Array]
"""One trial (N, d), or several: a sequence of arrays (N_i, d). Nested lists of numbers are accepted as arrays."""


def as_trials(u: Signals, y: Signals) -> list[Trial]:
    """Return the trials as pairs of input and output; raises `DataError` when their numbers differ."""
    inputs, outputs = as_arrays("input", u), as_arrays("output", y)
    if len(inputs) != len(outputs):
        rule = f"must have as many trials as the input, {len(inputs)}"
        raise DataError(Fault("identification", "output", rule, len(outputs)))
    return list(zip(inputs, outputs, strict=True))


def as_arrays(side: str, signals: Signals) -> list[Array]:
    """Return each trial of the ``side`` called input or output as an array of floats; raises `DataError`.

    Masked values become NaN. `check_trials` rejects NaN and wrong shapes.
    """
    try:
        each = [signals] if isinstance(signals, np.ndarray) else list(signals)
        if each and all(not isinstance(rows, np.ndarray) and np.ndim(rows) == 1 for rows in each):
            each = [np.array(each)]  # the rows of one trial
        return [_floats(rows) for rows in each]
    except (TypeError, ValueError):
        rule = "must be an array (samples, channels) of real numbers, or a sequence of them, one for each trial"
        raise DataError(Fault("identification", side, rule)) from None


def _floats(rows: Array) -> Array:
    if np.iscomplexobj(rows):
        raise TypeError
    values = np.ma.filled(np.ma.asarray(rows, dtype=float), np.nan) if np.ma.isMaskedArray(rows) else rows
    return np.asarray(values, dtype=float)


def check_numbers(order: int, horizon: int) -> None:
    """Raise `DataError` where the order, or the number of block rows or lags, is no integer."""
    faults = []
    if not _is_whole(order):
        faults.append(Fault("identification", "order", "must be an integer", order))
    if not _is_whole(horizon) or horizon < 1:
        faults.append(Fault("identification", "horizon", "must be an integer, 1 or more", horizon))
    if faults:
        raise DataError(faults)


def _is_whole(value: object) -> bool:
    return isinstance(value, int | np.integer) and not isinstance(value, bool)


@dataclass(frozen=True)
class Provenance:
    """A model's origin: method, block rows (lags for `arx`), order, and the number of rows and trials.

    ``singular_values`` are those of the method's column space, for outputs at unit deviation; for `cva` they are
    canonical correlations, and `arx` has none.
    """

    method: str
    block_rows: int
    order: int
    n_rows: int
    n_trials: int
    singular_values: Array


@dataclass(frozen=True)
class LinearModel:
    """``x[k+1] = A x + B u + w, y[k] = C x + D u + v``, noise in innovations form, in the units of the data.

    ``x0`` holds each trial's state (n,) at its first row; ``scaling`` the units in which the method computed.
    """

    space: StateSpace
    x0: tuple[Array, ...]
    noise: NoiseModel
    scaling: Scaling
    provenance: Provenance
    warnings: tuple[str, ...]
