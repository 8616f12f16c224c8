"""The one call shape: ``identify(u, y, order, horizon)`` takes one trial or several."""

from collections.abc import Sequence

import numpy as np

from common.errors import DataError, Fault
from patient_side.identification.trials import Trial
from patient_side.statespace import Array

Signals = Array | Sequence[Array]
"""One trial (N, d), or several of them: a sequence of arrays (N_i, d)."""


def as_trials(u: Signals, y: Signals) -> list[Trial]:
    """Return the trials, input and output side by side; raises `DataError` when there are not as many of both."""
    inputs = [u] if isinstance(u, np.ndarray) else list(u)
    outputs = [y] if isinstance(y, np.ndarray) else list(y)
    if len(inputs) != len(outputs):
        rule = f"must have as many trials as the input, {len(inputs)}"
        raise DataError(Fault("identification", "output", rule, len(outputs)))
    return list(zip(inputs, outputs, strict=True))
