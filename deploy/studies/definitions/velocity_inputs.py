"""A least-squares forecast with and without the recording's velocities: the worth of columns that look ahead.

One regression for each number of samples ahead, the same for all axes and arms: from the increments of the last half
second to the displacement. The velocities are those of the hand that moves the arm, at the newest sample only. They
are smoothed over later rows, so in a run they would not be known; here they show what a forecast gains by them.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from tis.common.metrics.tracking import SETTLING_NS
from tis.common.sources.jigsaws import RATE_HZ
from tis.common.sources.trajectory import HandRecording, Recording
from tis.common.units import sample_index
from tis.deploy.compare.cells.forecasts import ORIGIN_EVERY, Array, ErrorSums

_PAST: Final = RATE_HZ // 2
"""Samples of the past that a forecast knows: half a second."""


@dataclass(frozen=True)
class Inputs:
    """Inputs of a forecast: the past at 30 or 10 samples/s, with or without the velocity at the newest sample.

    ``n_past``: samples of 30 a second before the newest.
    """

    rate_hz: int
    velocity: bool
    n_past: int = _PAST


INPUTS: Final = tuple(Inputs(rate, velocity) for rate in (30, 10) for velocity in (False, True))


def leave_user_out(recordings: Sequence[Recording], inputs: Inputs, n_ahead: int) -> ErrorSums | None:
    """Return the errors over all trials, each forecast by a regression on the trials of the other people.

    A recording's label ends with its trial, as ``Suturing_D002``. None without a forecast. Oracle: motion at a
    constant velocity, which is forecast without an error.
    """
    people = [recording.label.split()[0][-4] for recording in recordings]
    rows = [_rows(recording, inputs, n_ahead) for recording in recordings]
    moments = [(past.T @ past, past.T @ ahead) for past, ahead in rows]
    parts = []
    for person in sorted(set(people)):
        others = [moment for moment, of in zip(moments, people, strict=True) if of != person]
        if not others:
            continue
        gram, cross = (np.sum([moment[i] for moment in others], axis=0) for i in (0, 1))
        weights = np.linalg.lstsq(gram, cross, rcond=None)[0]
        parts += [
            ErrorSums.of((past @ weights - ahead).reshape(-1, 3, n_ahead).transpose(0, 2, 1))
            for (past, ahead), of in zip(rows, people, strict=True)
            if of == person
        ]
    return ErrorSums.total(parts)


def _rows(recording: Recording, inputs: Inputs, n_ahead: int) -> tuple[Array, Array]:
    """Return what is known (N, P) and the displacements (N, H), the three axes of an origin in a row."""
    found = [_hand_rows(hand, inputs, n_ahead) for hand in recording.hands]
    return np.concatenate([past for past, _ in found]), np.concatenate([ahead for _, ahead in found])


def _hand_rows(hand: HandRecording, inputs: Inputs, n_ahead: int) -> tuple[Array, Array]:
    position_m = hand.follower.position_m
    first = -(-sample_index(SETTLING_NS, RATE_HZ) // ORIGIN_EVERY) * ORIGIN_EVERY
    origins = np.arange(first, len(position_m) - n_ahead, ORIGIN_EVERY)
    every = RATE_HZ // inputs.rate_hz
    lags = np.arange(0, inputs.n_past + 1, every)
    # increments (N, P, 3), the newest first, then the velocity
    past = -np.diff(position_m[origins[:, None] - lags], axis=1)
    if inputs.velocity:
        assert hand.command_velocity_m_s is not None
        past = np.concatenate([past, hand.command_velocity_m_s[origins, None] / RATE_HZ], axis=1)
    ahead = position_m[origins[:, None] + np.arange(1, n_ahead + 1)] - position_m[origins, None]
    return past.transpose(0, 2, 1).reshape(-1, past.shape[1]), ahead.transpose(0, 2, 1).reshape(-1, n_ahead)
