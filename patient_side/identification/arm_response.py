"""The response of an arm to its command by least squares: increments on increments, the same in every direction.

Increments know no operating point, and least squares on them no noise but that of the increments: a servo that is
sampled without errors is found exactly, whatever path it takes between the samples. The directions of the command
are those of the arm, in its units, after one gain (3, 3).

What they do not explain adds up along a forecast. An arm that is pulled to its command forgets it, so the way that
the arm has yet to go, about the trial's own mean, is one more regressor where it makes forecasts of a second better.
"""

from collections.abc import Sequence
from math import sqrt

import numpy as np
import scipy

from tis.patient_side.identification.structure import innovation_sizes
from tis.patient_side.identification.trials import Trial, n_first
from tis.patient_side.identification.validation import HELD_BACK
from tis.patient_side.linear_system import Array
from tis.patient_side.movement_models import N_INCREMENTS, ArmResponse

_TURNS = 10
_LOOKS = (2, 5)
"""Turns after which rows are left out that are explained far worse than the usual one."""
_TIMES_USUAL = 10.0
_MAX_MODULUS = 0.9999
_NEGLIGIBLE = 1e-10
_OFFSET_S = 3.0
"""Time within which a new offset between command and arm is found."""
_RUN_S = 1.0
_RUNS_PER_S = 4
_WORTH = 0.98
"""Error of a second with a pull, over that without, that is worth a further state."""


def fit_response(trials: Sequence[Trial], rate_hz: int) -> ArmResponse | None:
    """Return the response of the outputs (N, 3) to the first three inputs, its noise in m^2; None if it is unstable.

    Gain and coefficients are fitted by turns, trials weighted by the inverse size of their innovations. Oracles in
    test_arm_response: known responses, and a second-order servo.
    """
    pairs = [(u[:, :3], y) for u, y in trials]
    cuts = [n_first(len(y), HELD_BACK) for _, y in pairs]
    # A pull is judged on rows that it was not fitted to.
    samples, judged = _OFFSET_S * rate_hz, []
    centred = [(u - u[:cut].mean(axis=0), y - y[:cut].mean(axis=0)) for (u, y), cut in zip(pairs, cuts, strict=True)]
    first = [(u[:cut], y[:cut]) for (u, y), cut in zip(centred, cuts, strict=True)]
    sizes = innovation_sizes([y for _, y in first])
    for offset_samples in (0.0, samples):
        found = _fitted_response(first, sizes, offset_samples)
        judged.append(np.inf if found is None else _run_error(found, centred, cuts, sizes, rate_hz))
    pulled = None
    sizes = innovation_sizes([y for _, y in pairs])
    whole = [(u - u.mean(axis=0), y - y.mean(axis=0)) for u, y in pairs]
    if judged[1] < _WORTH * judged[0]:
        pulled = _fitted_response(whole, sizes, samples)
    return pulled or _fitted_response(whole, sizes, 0.0)


def _fitted_response(centred: Sequence[Trial], sizes: Sequence[float], offset_samples: float) -> ArmResponse | None:
    """Return the response without pull, or with one and an offset that is found within so many samples."""
    n, with_pull = N_INCREMENTS, offset_samples > 0
    weighted = [(u / size, y / size) for (u, y), size in zip(centred, sizes, strict=True)]
    us, ys = (np.concatenate([each[side] for each in weighted]) for side in (0, 1))
    gain = np.linalg.lstsq(us, ys, rcond=_NEGLIGIBLE)[0]
    moves = [(np.diff(u, axis=0), np.diff(y, axis=0)) for u, y in weighted]
    of_arm = np.concatenate([_lags(dy, 1) for _, dy in moves])
    of_command = np.concatenate([_lags(du, 0) for du, _ in moves])
    targets = np.concatenate([dy[n:] for _, dy in moves])
    if with_pull:
        of_arm, of_command = (
            np.concatenate([lags, sign * np.concatenate([each[side][n:-1] for each in weighted])[:, None]], axis=1)
            for lags, side, sign in ((of_arm, 1, -1.0), (of_command, 0, 1.0))
        )
    kept = np.ones(len(targets), dtype=np.bool_)
    for turn in range(_TURNS):
        through = np.einsum("mla,ab->mlb", of_command[kept], gain)
        ways = [of_arm[kept, n:] + through[:, n + 1 :]]
        regressors = np.concatenate([of_arm[kept, :n], through[:, : n + 1], *ways], axis=1)
        regressors = regressors.transpose(0, 2, 1).reshape(len(through) * targets.shape[1], -1)
        found = np.linalg.lstsq(regressors, targets[kept].ravel(), rcond=_NEGLIGIBLE)[0]
        own, command, pull = found[:n], found[n : 2 * n + 1], found[2 * n + 1 :]
        rest = targets - np.einsum("mla,l->ma", of_arm, np.concatenate([own, pull]))
        driven = np.einsum("mla,l->ma", of_command, np.concatenate([command, pull]))
        gain = np.linalg.lstsq(driven[kept], rest[kept], rcond=_NEGLIGIBLE)[0]
        left = rest - driven @ gain
        if turn in _LOOKS:
            # An arm that hits something, or its own limits, answers no command for a few rows.
            sizes_left = np.linalg.norm(left, axis=1)
            kept = sizes_left <= _TIMES_USUAL * np.median(sizes_left)
    of_row = np.concatenate([np.full(len(dy) - n, size) for (_, dy), size in zip(moves, sizes, strict=True)])
    left_m = (left * of_row[:, None])[kept]
    step = np.eye(n, k=-1)
    step[0] = own
    if with_pull:
        step = np.block([[step, pull * np.eye(n, 1)], [-own, 1.0 - pull]])
    if np.max(np.abs(np.linalg.eigvals(step))) > _MAX_MODULUS or (with_pull and not 0.0 < pull[0] < 1.0):
        return None
    noise_m2 = max(float(np.mean(left_m**2)), np.finfo(float).tiny)
    gain = np.ascontiguousarray(gain.T)
    if not with_pull:
        return ArmResponse(gain, own, command, noise_m2)
    return ArmResponse(gain, own, command, noise_m2, float(pull[0]), float(pull[0] * offset_samples) ** -2)


def _run_error(
    response: ArmResponse, centred: Sequence[Trial], cuts: Sequence[int], sizes: Sequence[float], rate_hz: int
) -> float:
    """Return the rms error, in units of the sizes, of a second's runs from the row ``cuts`` on, by known commands."""
    n, length, stride = N_INCREMENTS, max(1, round(_RUN_S * rate_hz)), max(1, rate_hz // _RUNS_PER_S)
    errors = [np.zeros((1, 3))]
    for (u, y), cut, size in zip(centred, cuts, sizes, strict=True):
        p = u @ response.gain.T
        dp, dy = np.diff(p, axis=0), np.diff(y, axis=0)
        # The offset as a filter finds it, sample by sample.
        explained = np.einsum("mla,l->ma", _lags(dy, 1), response.own)
        explained += np.einsum("mla,l->ma", _lags(dp, 0), response.command)
        ways = (p - y)[n:]
        if response.pull:
            share = response.pull * sqrt(response.drift)
            misfits = (dy[n:] - explained) / response.pull - ways[:-1]
            offsets = scipy.signal.lfilter([0.0, share], [1.0, share - 1.0], misfits, axis=0)
            ways = ways + np.vstack([offsets, offsets[-1:]])
        starts = np.arange(max(n, cut), len(dy) - length, stride)
        if not len(starts):
            continue
        past, way = [dy[starts - 1 - i] for i in range(n)], ways[starts - n]
        moved = np.zeros((len(starts), 3))
        for k in range(length):
            move = response.pull * way
            for weight, each in zip(response.own, past, strict=True):
                move = move + weight * each
            for i, weight in enumerate(response.command):
                move = move + weight * dp[starts + k - i]
            past, way, moved = [move, *past[:-1]], way + dp[starts + k] - move, moved + move
        errors.append((y[starts + length] - y[starts] - moved) / size)
    return float(np.sqrt(np.mean(np.square(np.concatenate(errors)))))


def _lags(increments: Array, first: int) -> Array:
    """Return the increments (M, L, 3) from ``first`` to the last lag before each of those that are explained."""
    n, length = N_INCREMENTS, len(increments)
    return np.stack([increments[n - lag : length - lag] for lag in range(first, n + 1)], axis=1)
