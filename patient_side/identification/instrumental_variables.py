"""The response of an arm to its command where samples of the arm have errors of the sensor.

Least squares on increments (`arm_response`) takes such errors for movement: at 120 Hz a twentieth of a millimetre
hides what an arm does in a period. Refined instrumental variables find the response all the same (Young 2011,
"Recursive Estimation and Time-Series Analysis", 7): the arm that the response of the turn before makes of the
command stands in for the arm's own past, as it has no error of the sensor, and both are filtered by the inverse of
the autoregression, which leaves white errors. Positions are taken as sums of increments that forget, so that no
operating point matters and a slow drift of the arm adds up to little.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import scipy

from tis.patient_side.identification.structure import innovation_sizes
from tis.patient_side.identification.trials import Trial
from tis.patient_side.linear_system import Array
from tis.patient_side.movement_models import N_INCREMENTS, ArmResponse

_TURNS = 10
_REMEMBERED_S = 0.3
_SMOOTHED_S = np.geomspace(0.005, 1.0, 8)
_SMOOTH_RANK = 1e-6
_NEGLIGIBLE = 1e-10
_ONE = np.ones(1)
_SUFFICIENT = 1.003
_MAX_MODULUS = 0.9999


class _Fit(NamedTuple):
    """A response of 1 .. 4 lags: gain (3, 3), polynomials of the increments, and the mean square that it leaves."""

    gain: Array
    poles: Array
    command: Array
    error: float


def fit_noisy_response(trials: Sequence[Trial], rate_hz: int) -> ArmResponse | None:
    """Return the response of the outputs (N, 3) to the first three inputs; None where the sensor shows no errors.

    Variances are in m^2. The least number of lags that explains the arm is taken. What the response leaves of the
    increments is divided by its autocovariances into the arm's own noise, which is white, and the errors of its
    sensor, which pass a difference and the autoregression. The noise is rather an upper limit: where the errors are
    larger, the share that chance adds to it is, too. Oracle: known servos and sensors, test_instrumental_variables.
    """
    whole = [(u[:, :3] - u[:, :3].mean(axis=0), y - y.mean(axis=0)) for u, y in trials]
    sizes = innovation_sizes([y for _, y in whole])
    moves = [(np.diff(u, axis=0), np.diff(y, axis=0)) for u, y in whole]
    weighted = [(du / size, dy / size) for (du, dy), size in zip(moves, sizes, strict=True)]
    fits = [_fitted(weighted, n, rate_hz) for n in range(1, N_INCREMENTS + 1)]
    least = min(fit.error for fit in fits)
    gain, poles, command, _ = next(fit for fit in fits if fit.error <= _SUFFICIENT * least)
    # The noise of the arm and the errors of its sensor.
    left = [_filtered(poles, _ONE, dy) - _filtered(command, _ONE, du @ gain.T) for du, dy in moves]
    rows = [each[N_INCREMENTS:] for each in left]
    seen = np.sum([_products(each, N_INCREMENTS + 2) for each in rows], axis=0) / sum(each.size for each in rows)
    shapes = [_ONE, np.convolve(poles, [1.0, -1.0])]
    of_each = [_products(np.pad(shape, (0, len(seen))), len(seen)) for shape in shapes]
    (noise_m2, error_m2), _ = scipy.optimize.nnls(np.stack(of_each, axis=1), seen)
    if not error_m2:
        return None
    own = np.pad(-poles[1:], (0, N_INCREMENTS + 1 - len(poles)))
    command = np.pad(command, (0, N_INCREMENTS + 1 - len(command)))
    return ArmResponse(gain, own, command, max(float(noise_m2), np.finfo(float).tiny), error=float(error_m2))


def _fitted(moves: Sequence[Trial], n: int, rate_hz: int) -> _Fit:
    """Return the best turn's response with ``n`` lags of the arm; the command's gain at rest is 1."""
    forget = np.array([1.0, -np.exp(-1.0 / (_REMEMBERED_S * rate_hz))])
    commands = [_filtered(_ONE, forget, du) for du, _ in moves]
    arms = [_filtered(_ONE, forget, dy) for _, dy in moves]
    target = np.concatenate(arms)
    gain = np.linalg.lstsq(np.concatenate(commands), target, rcond=_NEGLIGIBLE)[0]
    # At first smoothed commands say where the arm is.
    smoothed = [_smoothed(each @ gain, rate_hz) for each in commands]
    rows = np.concatenate(smoothed).reshape(-1, smoothed[0].shape[-1])
    weights = np.linalg.lstsq(rows, target.ravel(), rcond=_SMOOTH_RANK)[0]
    known, poles, turns = [each @ weights for each in smoothed], np.ones(1), list[_Fit]()
    for _ in range(_TURNS):
        normal, right = np.zeros((2 * n + 1, 2 * n + 1)), np.zeros(2 * n + 1)
        for each in zip(arms, known, commands, strict=True):
            arm, stand_in, command = (_filtered(_ONE, poles, one) for one in each)
            driven = [_lagged(command @ gain, lag, n) for lag in range(n + 1)]
            pasts = [[_lagged(one, lag, n) for lag in range(1, n + 1)] for one in (arm, stand_in)]
            regressors, instruments = (np.stack([*past, *driven], axis=-1).reshape(-1, 2 * n + 1) for past in pasts)
            normal += instruments.T @ regressors
            right += instruments.T @ arm[n:].ravel()
        found = np.linalg.lstsq(normal, right, rcond=_NEGLIGIBLE)[0]
        poles, taps = _stable(np.concatenate([[1.0], -found[:n]])), np.asarray(found[n:])
        at_rest = float(np.sum(taps) / np.sum(poles))
        if abs(at_rest) > _NEGLIGIBLE:
            taps = taps / at_rest
        answers = [_filtered(taps, poles, each) for each in commands]
        gain = np.linalg.lstsq(np.concatenate(answers), target, rcond=_NEGLIGIBLE)[0]
        known = [each @ gain for each in answers]
        error = float(np.mean((target - np.concatenate(known)) ** 2))
        turns.append(_Fit(np.ascontiguousarray(gain.T), poles, taps, error))
    return min(turns, key=lambda turn: turn.error)


def _smoothed(signal: Array, rate_hz: int) -> Array:
    """Return a signal (N, 3), and it smoothed once and twice over several times (N, 3, L)."""
    found = [signal]
    for time_s in _SMOOTHED_S:
        kept = float(np.exp(-1.0 / (time_s * rate_hz)))
        share, pole = np.array([1.0 - kept]), np.array([1.0, -kept])
        once = _filtered(share, pole, signal)
        found += [once, _filtered(share, pole, once)]
    return np.stack(found, axis=-1)


def _filtered(numerator: Array, denominator: Array, signal: Array) -> Array:
    """Return a signal (N, 3) that has passed a filter from rest."""
    return np.asarray(scipy.signal.lfilter(numerator, denominator, signal, axis=0))


def _lagged(signal: Array, lag: int, first: int) -> Array:
    """Return the rows ``lag`` before each of those from ``first`` on."""
    return signal[first - lag : len(signal) - lag]


def _stable(poles: Array) -> Array:
    """Return a polynomial whose roots beyond the unit circle are reflected into it."""
    roots = np.roots(poles)
    sizes = np.abs(roots)
    if np.all(sizes <= _MAX_MODULUS):
        return poles
    return np.real(np.poly(np.where(sizes > 1.0, roots / np.maximum(sizes, 1.0) ** 2, roots) * _MAX_MODULUS))


def _products(signal: Array, n: int) -> Array:
    """Return the sums of products of a signal (M,) or (M, 3) with itself at lags 0 .. ``n`` - 1, over all axes."""
    return np.array([float(np.sum(signal[lag:] * signal[: len(signal) - lag])) for lag in range(n)])
