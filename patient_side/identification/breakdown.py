"""A factorisation that breaks down is a fault of the rows it was asked of, and says what to do."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Final

import numpy as np

from common.errors import DataError, Fault
from patient_side.statespace import Array

_MOSTLY: Final = 0.5


@contextmanager
def breakdown_as_fault(method: str) -> Iterator[None]:
    """Raise `DataError` where linear algebra gives up inside, as it does on values that overflow.

    Ranks are decided, and poles kept stable, where a method knows what they mean; this is for what is left. Oracle:
    staircases of any step and noise give a model or a fault, test_staircase.
    """
    try:
        yield
    except np.linalg.LinAlgError as error:
        rule = f"{method} breaks down on them ({error}): choose another method, fewer block rows or more rows"
        raise DataError(Fault("identification", "training rows", rule)) from error


@contextmanager
def repeats_told(commands_m: Sequence[Array]) -> Iterator[None]:
    """Add to a `DataError` from inside that most rows of the commands (N, 3) repeat, if they do: it may be why.

    A recorder slower than the rows makes such staircases; a smooth movement, which excites little as well, has none.
    """
    try:
        yield
    except DataError as error:
        same = [(np.diff(positions, axis=0) == 0.0).all(axis=1) for positions in commands_m]
        share = float(np.mean(np.concatenate([np.zeros(1), *same])))
        if share < _MOSTLY:
            raise
        rule = (
            f"{share:.0%} of them repeat the row before, as with a recorder slower than the rows: a synthetic source"
            " gives each row its own instant with source.recorder_hz=null"
        )
        raise DataError([*error.faults, Fault("identification", "training rows", rule)]) from error
