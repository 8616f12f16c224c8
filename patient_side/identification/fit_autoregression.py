"""The arm's own movement by a vector autoregression: `arx` where commands do not predict the future."""

from collections.abc import Sequence
from math import log

import numpy as np

from tis.patient_side.identification.arx import ArxFactor
from tis.patient_side.identification.forecast_error import HeldBack
from tis.patient_side.identification.innovations_form import InnovationsForm
from tis.patient_side.identification.level_and_scale import LEVEL_STEPS, with_level, with_scale
from tis.patient_side.identification.noise import floored
from tis.patient_side.identification.trials import Scaling, Trial, n_first
from tis.patient_side.identification.validation import HELD_BACK
from tis.patient_side.movement_models import InnovationsModel
from tis.patient_side.statespace import Array

_MAX_MODULUS = 0.999


def fit_autoregression(trials: Sequence[Trial], rate_hz: int, largest: int) -> InnovationsModel:
    """Return the autoregression of the outputs (N, 3), in m, of one or several trials, of 1 .. ``largest`` lags.

    Each trial is centred on its own mean. Schwarz's criterion on all rows selects the number of lags; the drift of
    the level and the scale of the covariances are fitted as for the innovations model of `stochastic_moesp`.
    Oracle: a known process, test_autoregression.
    """
    outputs = [y - y.mean(axis=0) for _, y in trials]
    scale = Scaling.of([(y, y) for y in outputs]).output
    cuts = [n_first(len(y), HELD_BACK) for y in outputs]
    heads = [y[:cut] / scale for y, cut in zip(outputs, cuts, strict=True)]
    whole, first = _factor([y / scale for y in outputs], largest), _factor(heads, largest)
    lags = schwarz_lags(whole, largest)
    form, form_of_first = (autoregression(factor, lags).in_units(scale) for factor in (whole, first))
    held_back = HeldBack(tuple(outputs), tuple(cuts))
    model = with_level(_model(form, largest), _model(form_of_first, largest), held_back, rate_hz)
    return with_scale(model, held_back, rate_hz).model


def _model(form: InnovationsForm, block_rows: int) -> InnovationsModel:
    none, one = np.empty(0), np.ones(1)
    return InnovationsModel(form.A, form.C, form.K, floored(form.Re), LEVEL_STEPS[0], block_rows, none, one, one)


def schwarz_lags(factor: ArxFactor, largest: int) -> int:
    """Return the number of lags, 1 .. ``largest``, that minimises log det of the residuals + d log N / N."""
    p, n_rows = factor.n_outputs, factor.n_rows

    def criterion(lags: int) -> float:
        return float(np.linalg.slogdet(floored(factor.residual(lags)))[1]) + p * p * lags * log(n_rows) / n_rows

    return min(range(1, largest + 1), key=criterion)


def autoregression(factor: ArxFactor, lags: int) -> InnovationsForm:
    """Return the least-squares autoregression; all poles shrink in proportion where one of them is not stable."""
    space, gain = factor.model(lags)
    radius = space.spectral_radius()
    if radius > _MAX_MODULUS:
        # Coefficient i times the i-th power of a factor multiplies every pole by the factor.
        p = factor.n_outputs
        shrunk = np.repeat((_MAX_MODULUS / radius) ** np.arange(1, lags + 1), p)[:, None]
        gain = gain * shrunk
        A = space.A.copy()
        A[:, :p] = gain + np.eye(lags * p, k=p)[:, :p]
        return InnovationsForm(A, space.C, gain, factor.residual(lags))
    return InnovationsForm(space.A, space.C, gain, factor.residual(lags))


def _factor(outputs: Sequence[Array], largest: int) -> ArxFactor:
    return ArxFactor.of([(y[:, :0], y) for y in outputs], largest)
