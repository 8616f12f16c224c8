"""Drawn ticks of training rows: for each, which positions have arrived, under drawn loss and delay."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tis.common.streams import Stream
from tis.patient_side.statespace import Array

MAX_P_LOSS = 0.3
MAX_JITTER_STEPS = 15.0
_MIN_PAST = 8


@dataclass(frozen=True)
class ArrivalDraw:
    """A tick at ``row`` of a trial, ``ahead`` steps after the newest position that has arrived.

    ``arrived`` (A,) tells of the positions 0 .. A - 1 steps before the tick whether they have.
    """

    trial: int
    row: int
    ahead: int
    arrived: NDArray[np.bool_]

    def window(self, y: Array, n_steps: int, end: int) -> tuple[Array, NDArray[np.bool_]]:
        """Return ``n_steps`` positions (n_steps, 3) of a trial (N, 3) up to row ``end``, and which have arrived.

        They are relative to the newest that has; rows before the trial's first have not.
        """
        rows = np.arange(end - n_steps + 1, end + 1)
        ages = self.row - rows
        known = (rows >= 0) & (ages >= 0) & (ages < len(self.arrived))
        known[known] = self.arrived[ages[known]]
        inside = np.clip(rows, 0, len(y) - 1)
        return np.where(known[:, None], y[inside] - y[self.row - self.ahead], 0.0), known


def arrival_draws(
    lengths: Sequence[int], horizons: Sequence[int], n_each: int, n_steps: int, label: str
) -> list[ArrivalDraw]:
    """Return ``n_each`` draws at each of ``horizons``, all below ``n_steps``, from trials of ``lengths`` rows.

    There are none at a horizon that no trial is long enough for.

    The row is drawn from all rows with some past. Each position is lost with a probability that is drawn for the
    tick, up to 30 %; in every second draw positions are also late by up to 15 steps more than the newest. The random
    numbers are those of the stream ``label``, the same in every call.
    """
    stream, draws = Stream.named(0, label), []
    for i, ahead in enumerate(horizons):
        first = ahead + _MIN_PAST
        eligible = np.cumsum([0] + [max(0, n - first) for n in lengths])
        if eligible[-1] == 0:
            continue
        for j in range(n_each):
            u = stream.uniforms((i * n_each + j) * (2 * n_steps + 3), 2 * n_steps + 3)
            place = int(u[0] * eligible[-1])
            trial = int(np.searchsorted(eligible, place, side="right")) - 1
            jitter = MAX_JITTER_STEPS * u[2] * (j % 2)
            ages = np.arange(n_steps)
            arrived = (u[3 : n_steps + 3] >= MAX_P_LOSS * u[1]) & (ages >= ahead + jitter * u[n_steps + 3 :])
            arrived[ahead] = True
            draws.append(ArrivalDraw(trial, first + place - int(eligible[trial]), ahead, arrived))
    return draws
