"""A factorisation that breaks down is a fault of the rows it was asked of, and says what to do."""

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from common.errors import DataError, Fault


@contextmanager
def breakdown_as_fault(method: str) -> Iterator[None]:
    """Raise `DataError` where linear algebra gives up inside, as it does on values that overflow.

    Ranks are decided, and poles kept stable, where a method knows what they mean; this is for what is left. Oracle:
    staircases of any step and noise give a model or a fault, test_staircase.
    """
    try:
        yield
    except np.linalg.LinAlgError as error:
        rule = (
            f"{method} breaks down on them ({error}): choose another method, fewer block rows, more rows or, for a"
            " synthetic source, a recorder_hz of null"
        )
        raise DataError(Fault("identification", "training rows", rule)) from error
