"""Groups of training rows that are held out together."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

_MAX_GROUPS = 6


def held_out_groups(lengths: Sequence[int], people: Sequence[str]) -> list[NDArray[np.intp]]:
    """Return the group of every row, by trial of ``lengths`` rows.

    With several ``people``, whose names are in the order of the trials, a group is a person, or several where they
    are more than six: what is fitted must serve a person whom it has not seen. Otherwise it is a stretch of rows, six
    in all or one for each trial. Stretches of a trial lie one after another.
    """
    names = sorted(set(people))
    if len(names) > 1:
        of_name = {name: i * min(_MAX_GROUPS, len(names)) // len(names) for i, name in enumerate(names)}
        return [np.full(n, of_name[name]) for n, name in zip(lengths, people, strict=True)]
    n_stretches = -(-_MAX_GROUPS // len(lengths))
    return [i * n_stretches + np.arange(n) * n_stretches // max(n, 1) for i, n in enumerate(lengths)]
