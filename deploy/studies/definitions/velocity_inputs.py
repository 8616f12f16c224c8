"""A least-squares forecast with and without the recording's velocities: the worth of columns that look ahead.

One regression for each number of samples ahead, the same for all axes and arms: from the increments of the last half
second to the displacement. The velocities are those of the hand that moves the arm, at the newest sample only. They
are smoothed over later rows, so in a run they would not be known; here they show what a forecast gains by them.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

from tis.common.channels import Hand
from tis.common.metrics.tracking import SETTLING_NS
from tis.common.sources.jigsaws import RATE_HZ
from tis.common.sources.trajectory import HandRecording, Recording
from tis.common.units import sample_index
from tis.deploy.compare.cells.forecasts import ORIGIN_EVERY, ErrorSums
from tis.deploy.studies.definitions.readings import N_AHEAD, NAMES
from tis.patient_side.linear_system import Array

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


# Errors of an axis over all steps of a short window: 30 rows in, 10 out, as Weerasinghe et al. score in 2024.
#
# Their code (UVA-DSA/MTRSAP, config.py and train_prediction.py) pools the windows of the person who is left out, and
# all 10 steps of each, in one RMSE and one MAE for x, y and z of each arm.

N_IN: Final = 30
N_OUT: Final = 10
LEAST_SQUARES: Final = f"least squares, {N_IN} rows"
_HANDS: Final[tuple[Hand, ...]] = ("left", "right")


def window_rows(results: Iterable[Mapping[str, Any]], recordings: Sequence[Recording]) -> list[dict[str, Any]]:
    """Return a row for each arm and forecast: RMSE and MAE of x, y and z in mm over 10 steps, one user out.

    ``results`` are those of the twins whose person is left out. All are scored on the windows that have two seconds
    of the recording behind them, as in the other tables. The least squares know no more than the 30 rows, the
    estimators all rows before. Oracle: errors by hand, test_windows.
    """
    found = list(results)
    rows = []
    for hand in _HANDS:
        sums = {name: ErrorSums.total(_of(found, hand, name)) for name in NAMES}
        of_hand = [replace(one, hands=tuple(each for each in one.hands if each.hand == hand)) for one in recordings]
        if all(one.hands for one in of_hand):
            sums[LEAST_SQUARES] = leave_user_out(of_hand, Inputs(30, False, N_IN - 1), N_AHEAD)
        rows += [_row(hand, name, each) for name, each in sums.items() if each is not None and each.n]
    return rows


def _of(results: Iterable[Mapping[str, Any]], hand: Hand, name: str) -> list[ErrorSums]:
    return [ErrorSums.from_json(result["forecasts"][hand][name]) for result in results if hand in result["forecasts"]]


def _row(hand: Hand, name: str, sums: ErrorSums) -> dict[str, Any]:
    count = N_OUT * sums.n
    squares_m2, absolute_m = sums.squares_m2[:N_OUT].sum(axis=0), sums.absolute_m[:N_OUT].sum(axis=0)
    return {
        "hand": hand,
        "name": name,
        "n_windows": sums.n,
        "rmse_mm": (1000 * np.sqrt(squares_m2 / count)).tolist(),
        "mae_mm": (1000 * absolute_m / count).tolist(),
    }
