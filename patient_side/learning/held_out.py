"""The examples on which training is judged: people, else trials, else the end of the only trial."""

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from patient_side.learning.examples import Track

_FIRST_PART: Final = 0.7
_SHARE: Final = 5


def grouped(tracks: Sequence[Track], people: Sequence[str], labels: Sequence[str]) -> list[Track]:
    """Return the tracks with their groups: people where there are several, else trials, else two parts of one."""
    names = people if len(set(people)) > 1 else labels
    if len(set(names)) > 1:
        return [track._replace(group=name) for track, name in zip(tracks, names, strict=True)]
    parts = []
    for track in tracks:
        cut = round(_FIRST_PART * len(track.position_m))
        for rows, name in ((slice(0, cut), "first rows"), (slice(cut, None), "last rows")):
            parts.append(Track(track.position_m[rows], track.gripper_rad[rows], name))
    return parts


def held_out(names: Sequence[str], seed: int) -> tuple[str, ...]:
    """Return the groups to hold out: a fifth of them, at least one, by turns over the seeds; none of a single one."""
    if len(names) < 2:
        return ()
    n_held = max(1, len(names) // _SHARE)
    return tuple(sorted(names[(seed * n_held + i) % len(names)] for i in range(n_held)))


def is_in(groups: NDArray[np.int64], names: Sequence[str], held: Sequence[str]) -> NDArray[np.bool_]:
    """Return which examples of ``groups`` (B,), numbers in ``names``, belong to the groups ``held``."""
    return np.isin(groups, [names.index(name) for name in held])
