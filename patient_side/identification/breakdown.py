"""Breakdown of linear algebra on unsuitable training rows, as a fault with a remedy."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Final

import numpy as np

from tis.common.errors import DataError, Fault
from tis.patient_side.statespace import Array

_MIN_REPEATED_SHARE: Final = 0.5


@contextmanager
def breakdown_as_fault(method: str) -> Iterator[None]:
    """Raise `DataError` where linear algebra fails inside, for example on values that overflow.

    Each method handles rank deficiency and unstable poles itself; this covers the remaining cases. Oracle:
    staircases of any step and noise give a model or a fault, test_staircase.
    """
    try:
        yield
    except np.linalg.LinAlgError as error:
        rule = f"{method} breaks down on them ({error}): choose another method, fewer block rows or more rows"
        raise DataError(Fault("identification", "training rows", rule)) from error


@contextmanager
def explain_repeats(commands_m: Sequence[Array]) -> Iterator[None]:
    """Add a hint to a `DataError` from inside where most rows of the commands (N, 3) repeat the row before.

    A recorder slower than the rows causes such staircases; a smooth movement, also of weak excitation, has none.
    """
    try:
        yield
    except DataError as error:
        same = [(np.diff(positions, axis=0) == 0.0).all(axis=1) for positions in commands_m]
        share = float(np.mean(np.concatenate([np.zeros(1), *same])))
        if share < _MIN_REPEATED_SHARE:
            raise
        rule = (
            f"{share:.0%} of them repeat the row before, as with a recorder slower than the rows: a synthetic source"
            " gives each row its own instant with source.recorder_hz=null"
        )
        raise DataError([*error.faults, Fault("identification", "training rows", rule)]) from error
