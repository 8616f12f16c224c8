"""The forecast of a command that has not arrived: damped velocity with a return, fitted to the training rows.

``u[k+h]`` is forecast as ``u[k] + v sum_i phi^i psi^(h-i)``, i = 1..h, with v the mean velocity per sample over the
last ``span`` samples. With psi = 1 that is the damped trend of Gardner and McKenzie (1985), without smoothing, which
never returns: hands turn back within seconds, and at long horizons it is worse than hold. With psi < 1 it is the mean
of a second-order process, a hand that is slowed down and pulled back, and tends to hold.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from tis.patient_side.filters.input_path import forecast_steps
from tis.patient_side.identification.coverage import coverage_factor, independent_windows, prediction_factor
from tis.patient_side.linear_system import Array
from tis.patient_side.movement_models import InputForecast, max_damping

HORIZONS_S = (1 / 30, 0.1, 0.2, 0.5, 1.0, 2.0)
"""Up to the length of an outage: a forecast must not run away from a hand that has turned back."""
_RETURNS_S = (np.inf, 10.0, 5.0, 3.0, 2.0)
"""Time constants of the return; a shorter one cannot be distinguished from damping."""
SPANS = (1, 2, 3)
DAMPINGS = np.round(np.linspace(0.0, 1.0, 1001), 3)
_MAX_HORIZON = 150
_N_FITTED = 2
"""Damping and persistence, which all axes share."""


def fit_forecast(commands: Sequence[Array], rate_hz: int) -> InputForecast:
    """Return damping, persistence and span of the best forecast of the commands (N, 3), and its error growth.

    The criterion is the mean, over horizons of 33, 100, 200, 500, 1000 and 2000 ms (1, 3, 6, 15, 30, 60 samples at
    30 Hz; those that the rows allow), of the squared error over that of hold. ``growth_m`` covers H = min(150, N //
    4) horizons, with N rows in the longest command; it is the rms error, widened by `coverage_factor` and
    `prediction_factor` so that 95 % ellipsoids hold 95 % of new errors. Oracles in test_forecast: a plain loop, and
    newly drawn movements.
    """
    n_horizons = max(1, min(_MAX_HORIZON, max(len(u) for u in commands) // 4))
    wanted = {max(1, round(s * rate_hz)) for s in HORIZONS_S}
    horizons = sorted(h for h in wanted if h <= n_horizons) or [1]
    persistences = [float(np.exp(-1.0 / (rate_hz * s))) for s in _RETURNS_S]
    best, found = np.inf, InputForecast(0.0, 1, np.empty((0, 3)))
    for span in SPANS:
        sums = [_sums(commands, span, h) for h in horizons]
        for persistence in persistences:
            dampings = DAMPINGS[max_damping(persistence) >= DAMPINGS]
            each = zip(horizons, sums, strict=True)
            cost = np.mean([relative_error(dampings, persistence, h, of) for h, of in each], axis=0)
            at = int(np.argmin(cost))
            if cost[at] < best:
                best = float(cost[at])
                found = InputForecast(float(dampings[at]), span, np.empty((0, 3)), persistence)
    return replace(found, growth_m=_growth_m(commands, found, n_horizons))


def _sums(commands: Sequence[Array], span: int, horizon: int) -> tuple[float, float, float]:
    """Return the sums of squares of ``u[k+h] - u[k]``, of its products with the velocity, and of the velocity's."""
    held, crossed, moved = 0.0, 0.0, 0.0
    for u in commands:
        # The same samples for every span, for a fair comparison.
        velocity, ahead = _velocity_and_ahead(u, span, horizon, max(SPANS))
        held += float(np.sum(ahead**2))
        crossed += float(np.sum(ahead * velocity))
        moved += float(np.sum(velocity**2))
    return held, crossed, moved


def relative_error(dampings: Array, persistence: float, horizon: int, sums: tuple[float, float, float]) -> Array:
    """Return, for every damping, the squared forecast error over hold's; 0 where hold makes no error."""
    held, crossed, moved = sums
    if held == 0:
        return np.zeros(len(dampings))
    powers = np.arange(1, horizon + 1)
    gains = np.sum(dampings[:, None] ** powers * persistence ** (horizon - powers), axis=1)
    return np.asarray((held - 2 * gains * crossed + gains**2 * moved) / held)


def _velocity_and_ahead(u: Array, span: int, horizon: int, first: int) -> tuple[Array, Array]:
    """Return, for samples k = first .. N - 1 - h, the velocity per sample and ``u[k+h] - u[k]``."""
    last = max(first, len(u) - horizon)
    now = u[first:last]
    return (now - u[first - span : last - span]) / span, u[first + horizon : last + horizon] - now


def _growth_m(commands: Sequence[Array], forecast: InputForecast, n_horizons: int) -> Array:
    growth, span = np.zeros((n_horizons, commands[0].shape[1])), forecast.velocity_span
    for h in range(1, n_horizons + 1):
        ends = [_velocity_and_ahead(u, span, h, span) for u in commands]
        errors = np.concatenate([ahead - forecast_steps(forecast, h) * velocity for velocity, ahead in ends])
        variances = np.sum(errors**2, axis=0) / max(1, len(errors))
        if np.all(variances > 0):
            windows = independent_windows(len(errors), h)
            by_chance = prediction_factor(windows, _N_FITTED / errors.shape[1], whole=False)
            variances *= by_chance * coverage_factor(errors, np.diag(variances), h)
        growth[h - 1] = np.sqrt(variances)
    return growth
