"""Noise covariances in innovations form, so that a Kalman filter on them is consistent.

The filter's innovations obey ``e[k] = y[k] - C x[k] - D u[k]``, ``x[k+1] = A x[k] + B u[k] + K e[k]``. An
initial K explains the simulation error as the response to the residuals of a long vector ARX model (Hannan
and Rissanen 1982); Gauss-Newton steps then reduce the determinant of the innovations' covariance Re
(prediction error method; Ljung, "System Identification", sections 7.2 and 10.2). A, B, C and D do not change.
"""

from collections.abc import Iterator, Sequence

import numpy as np

from tis.patient_side.identification.hankel import COLUMNS_AT_ONCE, accumulate, empty_factor, fill_hankel
from tis.patient_side.identification.output_error import STABLE_BELOW, fit_response
from tis.patient_side.identification.trials import Trial
from tis.patient_side.linear_system import Array, NoiseModel, StateSpace

SENSOR_RESOLUTION_M = 1e-6
"""Resolution of the recordings, six decimals of a metre: a lower bound on the deviation of innovations."""

_MAX_STEPS = 10
_MIN_IMPROVEMENT = 0.01
_MIN_STEP = 1 / 16
_DOUBLINGS, _CONVERGED = 40, 1e-14
_NOTHING = 1e-30  # signals have unit deviation
_RICCATI_FLOORS = (1e-10, 1e-7, 1e-4, 1e-2)


def estimate_noise(
    space: StateSpace,
    x0: Sequence[Array],
    trials: Sequence[Trial],
    lags: int,
    residuals: Sequence[Array] | None = None,
) -> tuple[NoiseModel, tuple[str, ...]]:
    """Return Q = K Re K', R = Re, S = K Re of a model on its training trials, and a warning when K is zero.

    ``x0`` holds each trial's initial state, ``lags`` is the length of the ARX model, whose ``residuals`` may be
    passed to share them between several models of the same trials; signals in m. R is floored at the sensor's
    resolution, the joint covariance [Q S; S' R] is positive semidefinite by construction and A - K C is stable.
    A model of order 0, or with a simulation error below the resolution, has only R. Oracle: normalised innovations
    of a textbook Kalman filter on fresh data of a known system, test_noise.
    """
    gain = np.zeros((space.order, space.n_outputs))
    simulation_errors = innovations(space, gain, x0, trials)
    covariance = covariance_of(simulation_errors)
    warnings: tuple[str, ...] = ()
    if space.order and np.all(np.diag(covariance) > SENSOR_RESOLUTION_M**2):
        gain = _start(space, x0, trials, simulation_errors, residuals or arx_residuals(trials, lags))
        gain = refined_gain(space, gain, x0, trials)
        covariance = covariance_of(innovations(space, gain, x0, trials))
        if not gain.any():
            warnings = ("no Kalman gain predicts the training rows better than the simulation: Q is zero",)
    return innovations_noise(gain, covariance), warnings


def innovations_noise(gain: Array, covariance: Array) -> NoiseModel:
    """Return Q = K Re K', R = Re, S = K Re of innovations with a covariance Re (p, p) in m^2, which is floored."""
    R = floored(covariance)
    Q = gain @ R @ gain.T
    return NoiseModel((Q + Q.T) / 2, R, gain @ R)


def innovations(space: StateSpace, gain: Array, x0: Sequence[Array], trials: Sequence[Trial]) -> list[Array]:
    """Return the one-step errors (N, p) of the filter with a constant ``gain`` (n, p) on each trial."""
    p = space.n_outputs
    predictor = StateSpace(
        space.A - gain @ space.C,
        np.hstack([space.B - gain @ space.D, gain]),
        space.C,
        np.hstack([space.D, np.zeros((p, p))]),
    )
    return [y - predictor.simulate(np.hstack([u, y]), x) for (u, y), x in zip(trials, x0, strict=True)]


def _start(
    space: StateSpace,
    x0: Sequence[Array],
    trials: Sequence[Trial],
    simulation_errors: Sequence[Array],
    residuals: Sequence[Array],
) -> Array:
    """Return the K by which the simulation errors respond to the ARX residuals; zero where it is no improvement."""
    responses = [(e, r - e) for e, r in zip(residuals, simulation_errors, strict=True)]
    gain = fit_response(space.A, space.C, responses)
    while not is_observer_stable(space.A, space.C, gain):
        gain = gain / 2
    better = _size(innovations(space, gain, x0, trials)) < _size(simulation_errors)
    return gain if better else np.zeros_like(gain)


def riccati_gain(A: Array, C: Array, errors: Array) -> Array:
    """Return the Kalman gain K (n, p) of noises w and v with the covariance of the rows of ``errors`` (N, n + p).

    It needs no stable A, and A - K C is stable. A floor on both noises, relative to their size, keeps the Riccati
    equation solvable where data without noise leave modes on the unit circle that nothing drives; it rises until the
    solution exists. Oracle: the innovations form of a known system, test_riccati_gain.
    """
    n, p = len(A), len(C)
    covariance = errors.T @ errors / max(1, len(errors))
    size = max(float(np.trace(covariance)), _NOTHING)
    for floor in _RICCATI_FLOORS:
        joint = covariance + floor * size * np.eye(n + p)
        Q, S, R = joint[:n, :n], joint[:n, n:], joint[n:, n:]
        P = _riccati(A, C, Q, R, S)
        K = np.asarray(np.linalg.solve(C @ P @ C.T + R, (A @ P @ C.T + S).T).T)
        if np.all(np.isfinite(K)) and is_observer_stable(A, C, K):
            return K
    raise np.linalg.LinAlgError("no filter of the model is stable: some state is not observable")


def _riccati(A: Array, C: Array, Q: Array, R: Array, S: Array) -> Array:
    """Return the filter's covariance P (n, n) before each sample, by structure-preserving doubling.

    Chu, Fan, Lin and Wang 2004, Int. J. Control 77:767. Each step doubles the samples that the recursion covers, and
    none reorders eigenvalues, which fails where some lie near the unit circle.
    """
    one = np.eye(len(A))
    across = np.linalg.solve(R, S.T).T
    F, G, P = (A - across @ C).T, C.T @ np.linalg.solve(R, C), Q - across @ S.T
    for _ in range(_DOUBLINGS):
        before = P
        W = np.linalg.inv(one + G @ P)
        onward = F @ W
        P = P + F.T @ P @ W @ F
        G = G + onward @ G @ F.T
        P, G, F = (P + P.T) / 2, (G + G.T) / 2, onward @ F
        if np.linalg.norm(P - before) <= _CONVERGED * np.linalg.norm(P):
            break
    return np.asarray(P)


def refined_gain(space: StateSpace, gain: Array, x0: Sequence[Array], trials: Sequence[Trial]) -> Array:
    """Return ``gain`` after Gauss-Newton steps on the determinant of the innovations' covariance.

    To first order a change dK changes e by minus the response of (A - K C, dK, C) to e, so the best dK is a
    linear least-squares solution. A step that destabilises the filter or improves too little is halved, down to 1/16.
    """
    errors = innovations(space, gain, x0, trials)
    size = _size(errors)
    for _ in range(_MAX_STEPS):
        direction = fit_response(space.A - gain @ space.C, space.C, [(e, e) for e in errors])
        step = 1.0
        while step >= _MIN_STEP:
            candidate = gain + step * direction
            if is_observer_stable(space.A, space.C, candidate):
                candidate_errors = innovations(space, candidate, x0, trials)
                saved = size - _size(candidate_errors)
                if saved >= _MIN_IMPROVEMENT:
                    break
                if saved >= 0:  # converged: a shorter step would not improve more
                    return gain
            step /= 2
        else:
            return gain
        gain, errors, size = candidate, candidate_errors, size - saved
    return gain


def arx_residuals(trials: Sequence[Trial], lags: int) -> list[Array]:
    """Return the residuals (N, p) of a vector ARX model on each trial; zero in its first ``lags`` rows."""
    m, p = trials[0][0].shape[1], trials[0][1].shape[1]
    factor = empty_factor((lags + 1) * (m + p))
    for u, y in trials:
        for columns in _regressors(u, y, lags):
            factor = accumulate(factor, columns)
    coefficients = np.linalg.lstsq(factor[:, :-p], factor[:, -p:])[0]
    residuals = []
    for u, y in trials:
        residual, first = np.zeros_like(y), lags
        for columns in _regressors(u, y, lags):
            last = first + columns.shape[1]
            residual[first:last] = (columns[-p:] - coefficients.T @ columns[:-p]).T
            first = last
        residuals.append(residual)
    return residuals


def _regressors(u: Array, y: Array, lags: int) -> Iterator[Array]:
    """Yield stretches of Hankel columns, ``lags + 1`` block rows of u over those of y, the present output last."""
    inputs = (lags + 1) * u.shape[1]
    for first in range(lags, len(u), COLUMNS_AT_ONCE):
        last = min(first + COLUMNS_AT_ONCE, len(u))
        columns = np.empty((inputs + (lags + 1) * y.shape[1], last - first))
        fill_hankel(columns[:inputs], u[first - lags : last])
        fill_hankel(columns[inputs:], y[first - lags : last])
        yield columns


def is_observer_stable(A: Array, C: Array, gain: Array) -> bool:
    """Return whether the errors of the filter with a constant ``gain`` (n, p) decay."""
    return bool(np.max(np.abs(np.linalg.eigvals(A - gain @ C))) < STABLE_BELOW)


def covariance_of(errors: Sequence[Array]) -> Array:
    """Return the second moments (p, p) of the errors (N, p) of all trials."""
    return np.asarray(np.sum([e.T @ e for e in errors], axis=0) / sum(len(e) for e in errors))


def _size(errors: Sequence[Array]) -> float:
    """Return the log-determinant of the errors' covariance."""
    return float(np.linalg.slogdet(covariance_of(errors))[1])


def floored(covariance: Array) -> Array:
    """Return a covariance (p, p) in m^2 with no deviation below the sensor's resolution in any direction."""
    values, vectors = np.linalg.eigh(covariance)
    floored = vectors @ np.diag(np.maximum(values, SENSOR_RESOLUTION_M**2)) @ vectors.T
    return np.asarray((floored + floored.T) / 2)
