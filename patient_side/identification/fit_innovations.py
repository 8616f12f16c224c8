"""The arm's own movement by stochastic MOESP: structure, order and drift by validation.

The arm's own movement by a vector autoregression: `arx` where commands do not predict the future.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import ceil, log
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tis.patient_side.filters.innovations_filter import AXES
from tis.patient_side.identification.arm_response import fit_response
from tis.patient_side.identification.arx import ArxFactor
from tis.patient_side.identification.instrumental_variables import fit_noisy_response
from tis.patient_side.identification.level_and_scale import (
    LEVEL_STEPS,
    Calibrated,
    HeldBack,
    Tried,
    clearly_better,
    errors_on,
    forecast_steps,
    over_hold,
    settled_rows,
    try_model,
    with_level,
    with_scale,
)
from tis.patient_side.identification.noise import floored
from tis.patient_side.identification.stochastic_moesp import InnovationsForm, check_order, check_outputs
from tis.patient_side.identification.structure import PREFERRED, Structure, StructuredSubspace
from tis.patient_side.identification.trials import Scaling, Trial, held_out_groups, n_first
from tis.patient_side.identification.validation import HELD_BACK
from tis.patient_side.linear_system import Array
from tis.patient_side.movement_models import ArmResponse, InnovationsModel

ORDERS = (4, 6, 8, 10, 12, 14, 16, 20, 24, 30)
AXIS_ORDERS = (2, 3, 4, 5, 6, 7, 8, 10)
"""States per axis of an isotropic model."""

_SUFFICIENT = 1.003
_LONGEST_S = 1.0
_FAR_S = 0.5, 2.0
_BETTER = 0.99
"""A structure with more parameters must be worth them."""
_LEAST_NOISE = 1e-6
"""Variance of the arm's own innovations, in units of the command's."""
_LOOK_BACK_S = 1 / 6
"""Of a model with more block rows than were asked for, at high rates, where each row says little beyond its noise."""
_MOST_BLOCK_ROWS = 60
_SHARE = 0.01
_HARDLY_BETTER = 0.999
"""One response is no larger than another, and the errors of the rows that judge them hide what it is better by."""
_NOT_WORSE = 1.003
_HARDLY_WORSE = 1.02
_TRADE = 0.1
"""Error that an arm's response may add far ahead, over what it saves up to a second: half of all for a twentieth."""


@dataclass(frozen=True)
class FittedInnovations:
    """A model of all training rows, and the results of the selection.

    ``errors`` holds, by structure and order, the error of forecasts of the held-back rows over that of hold.
    ``commanded`` is the movement of the commands with the arm's response to them; None unless it forecasts better.
    """

    model: InnovationsModel
    errors: dict[Structure, dict[int, float]]
    warnings: tuple[str, ...]
    commanded: InnovationsModel | None = None


class Candidate(NamedTuple):
    """A model of all rows without correction, and the errors over those of hold (H,) of such models on unseen rows.

    The errors are of forecasts over ``steps`` (H,) samples, of models fitted without these rows.
    """

    model: InnovationsModel
    warnings: tuple[str, ...]
    steps: NDArray[np.int64]
    over_hold: Array

    def better_than(
        self,
        other: "Candidate",
        rate_hz: int,
        not_worse: float = _NOT_WORSE,
        trade: float = 0.0,
        better: float = _BETTER,
    ) -> bool:
        """Return whether forecasts up to a second are better on average, and those over 0.5 to 2 s ``not_worse``.

        Both are needed: a model of increments, say, can win at 33 ms and lose at a second. It may lose more where it
        wins much: ``trade`` of its mean gain.
        """
        near = self.steps <= _LONGEST_S * rate_hz
        far = (self.steps >= _FAR_S[0] * rate_hz) & (self.steps <= _FAR_S[1] * rate_hz)
        ratio = self.over_hold / other.over_hold
        # Every octave counts the same.
        octaves = np.gradient(np.log(self.steps[near])) if np.count_nonzero(near) > 1 else np.ones(1)
        mean = float(np.exp(np.average(np.log(ratio[near]), weights=octaves)))
        return mean < better and bool(np.all(ratio[far] <= max(not_worse, 1.0 + trade * (1.0 - mean))))


def fit_innovations(
    trials: Sequence[Trial],
    rate_hz: int,
    block_rows: int,
    order: int | None = None,
    grippers_rad: Sequence[Array] = (),
    people: Sequence[str] = (),
    orientations: Sequence[Array] = (),
    others: Sequence[Array] = (),
    *,
    follows: bool = False,
) -> FittedInnovations:
    """Return the innovations model of the outputs (N, 3), in m, of one or several trials.

    Inputs are used only where the arm ``follows`` them with a lag: then the movement of the commands, with the arm's
    response to them (`fit_response`), is returned as well, if it forecasts the arm better.

    Four structures are compared on the last 30 % of every trial's rows, with models of the rows before: positions,
    each trial about its own mean, or increments; isotropic or free. The criterion is the geometric mean, over trials
    and 33, 100, 200, 500 and 1000 ms, of the error over that of hold; a structure's order is the smallest within
    0.3 % of its best. The structure is the first of `PREFERRED`, unless others are `clearly_better`: then the best of
    those is compared with it again on rows that neither has seen, people left out where there are several, at long
    horizons too, and with their corrections (`fit_correction`). The correction uses the grippers' angles (N,) where
    they are given, and ``people``, who moves in each trial; its heads also the ``orientations`` (N, 4), and
    ``others`` (N, 4), the ways to the other arms and their grippers. Trials are weighted by the inverse size of their
    innovations, as weighted least squares requires: otherwise the liveliest trial dominates. With an ``order`` only
    the structures that can have it are tried. Raises `DataError` for arrays that `check_outputs` rejects, or for an
    ``order`` beyond the block rows. Oracle: a known system's forecasts, test_fit_innovations.
    """
    # Checks, and the rows held back.
    outputs = [y for _, y in trials]
    check_outputs(outputs, block_rows, HELD_BACK)
    if order is not None:
        check_order(order, block_rows, AXES)
    cuts = [n_first(len(y), HELD_BACK) for y in outputs]
    centred = tuple(y - y.mean(axis=0) for y in outputs)
    held_back = HeldBack(
        centred,
        tuple(cuts),
        tuple(grippers_rad),
        tuple(people),
        orientations=tuple(orientations),
        others=tuple(others),
    )
    candidates, errors = _candidates(held_back, rate_hz, block_rows, order)
    best, doubts = _with_everything(candidates, held_back, rate_hz)
    commanded = None
    if follows:
        commanded = _commanded(trials, held_back, rate_hz, block_rows, best)
    return FittedInnovations(best.model, errors, doubts, commanded)


def _commanded(
    trials: Sequence[Trial], held_back: HeldBack, rate_hz: int, block_rows: int, alone: Calibrated
) -> InnovationsModel | None:
    """Return the movement of the commands with the arm's response; None unless it is better than ``alone``.

    The response is that of an arm whose samples are exact, or of one whose sensor errs, where that forecasts better.
    """
    best: Candidate | None = None
    of_best = held_back
    for response in filter(None, (fit_response(trials, rate_hz), fit_noisy_response(trials, rate_hz))):
        model, of_arm = _with_response(response, trials, held_back, rate_hz, block_rows)
        # Beneath errors of a sensor little tells the arm's own noise, which decides how long samples are averaged.
        fitted = model.response
        assert fitted is not None
        for noise in (fitted.noise, _SHARE * fitted.noise, _LEAST_NOISE) if fitted.error else (fitted.noise,):
            tried = replace(model, response=replace(fitted, noise=noise))
            linear = with_scale(tried, of_arm, rate_hz)
            other = Candidate(tried, (), linear.steps, linear.over_hold)
            if best is None or other.better_than(best, rate_hz, better=_HARDLY_BETTER):
                best, of_best = other, of_arm
    if best is None:
        return None
    found = with_scale(best.model, of_best, rate_hz, corrected=True)
    judged = [Candidate(each.model, (), each.steps, each.over_hold) for each in (found, alone)]
    return found.model if judged[0].better_than(judged[1], rate_hz, _HARDLY_WORSE, _TRADE) else None


def _with_response(
    response: ArmResponse, trials: Sequence[Trial], held_back: HeldBack, rate_hz: int, block_rows: int
) -> tuple[InnovationsModel, HeldBack]:
    """Return the movement of the commands with a response, whose variances are in m^2, and the rows of both."""
    commands = tuple((u - u.mean(axis=0))[:, :AXES] @ response.gain.T for u, _ in trials)
    candidates, _ = _candidates(replace(held_back, outputs=commands), rate_hz, block_rows, None)
    hand = candidates[0]
    for other in candidates[1:]:
        hand = other if other.better_than(hand, rate_hz) else hand
    unit = float(np.trace(hand.model.Re)) / AXES
    noise, error = max(response.noise / unit, _LEAST_NOISE), response.error / unit
    model = replace(hand.model, response=replace(response, noise=noise, error=error))
    return model, replace(held_back, commands=commands)


def _candidates(
    held_back: HeldBack, rate_hz: int, block_rows: int, order: int | None
) -> tuple[list[Candidate], dict[Structure, dict[int, float]]]:
    """Return the preferred structure, then the best of those that are clearly better, and the errors of all.

    At high rates those of models that look back further follow.
    """
    found, errors = _of_look_back(held_back, rate_hz, block_rows, order)
    longer = min(ceil(_LOOK_BACK_S * rate_hz), _MOST_BLOCK_ROWS, _most_block_rows(held_back))
    if longer > block_rows:
        found += _of_look_back(held_back, rate_hz, longer, order)[0]
    return found, errors


def _most_block_rows(held_back: HeldBack) -> int:
    """Return the largest number of block rows that the rows not held back allow: [Y_p; Y_f] has as many columns."""
    n_trials = len(held_back.first_rows)
    return int(sum(held_back.first_rows)) // (2 * (AXES + n_trials))


def _of_look_back(
    held_back: HeldBack, rate_hz: int, block_rows: int, order: int | None
) -> tuple[list[Candidate], dict[Structure, dict[int, float]]]:
    """Return the candidates, and the errors of all, of one number of block rows."""
    cuts = held_back.first_rows
    # Every structure and order on the first rows.
    tried: dict[Structure, dict[int, Tried]] = {}
    subspaces: dict[Structure, StructuredSubspace] = {}
    for structure in PREFERRED:
        orders = _orders(structure, order)
        if orders:
            found = StructuredSubspace.of(structure, held_back.outputs, cuts, block_rows)
            subspaces[structure] = found
            tried[structure] = {n: try_model(found.of_first(n), held_back, rate_hz) for n in found.shown(orders)}
    chosen = {structure: _smallest_sufficient(by_order) for structure, by_order in tried.items()}
    preferred = next(iter(tried))
    at_best = {each: tried[each][n] for each, n in chosen.items()}
    better = [each for each in at_best if clearly_better(at_best[each], at_best[preferred], held_back, rate_hz)]
    candidates = [
        _candidate(subspaces[each], chosen[each], held_back, rate_hz, at_best[each])
        for each in (preferred, *sorted(better, key=lambda each: at_best[each].error)[:1])
    ]
    return candidates, {each: {n: by.error for n, by in by_order.items()} for each, by_order in tried.items()}


def _with_everything(
    candidates: Sequence[Candidate], held_back: HeldBack, rate_hz: int
) -> tuple[Calibrated, tuple[str, ...]]:
    """Return the model with its correction and scale: the first one, or another where that is better with both.

    Another is corrected only if it is better without, as a correction takes longer to fit than a linear model.
    """
    best, whole = candidates[0], with_scale(candidates[0].model, held_back, rate_hz, corrected=True)
    for other in candidates[1:]:
        if not other.better_than(best, rate_hz):
            continue
        found = with_scale(other.model, held_back, rate_hz, corrected=True)
        corrected = [
            each if of.model.correction is None else each._replace(over_hold=each.over_hold * of.gain)
            for each, of in ((other, found), (best, whole))
        ]
        if corrected[0].better_than(corrected[1], rate_hz):
            best, whole = other, found
    return whole, best.warnings


def _orders(structure: Structure, order: int | None) -> tuple[int, ...]:
    """Return the orders to try of a structure: none where it cannot have the requested one."""
    if order is not None:
        return () if structure.isotropic and order % AXES else (order,)
    return tuple(AXES * n for n in AXIS_ORDERS) if structure.isotropic else ORDERS


def _smallest_sufficient(tried: dict[int, Tried]) -> int:
    best = min(each.error for each in tried.values())
    return next(n for n, each in tried.items() if each.error <= _SUFFICIENT * best)


def _candidate(found: StructuredSubspace, order: int, held_back: HeldBack, rate_hz: int, tried: Tried) -> Candidate:
    """Return a structure's model of all rows, and its errors on unseen rows: people left out, or rows held back."""
    of_first = found.of_first(order)
    model, warnings = found.of_all(order)
    model = with_level(model, of_first, held_back, rate_hz, tried)
    steps = forecast_steps(held_back, rate_hz)
    if len(set(held_back.people)) < 2:
        errors = errors_on(replace(of_first, level_step=model.level_step), held_back, steps)
        return Candidate(model, warnings, steps, over_hold(held_back, steps, errors))
    groups = np.array([each[0] for each in held_out_groups([1] * len(held_back.outputs), held_back.people)])
    logs = np.zeros(len(steps))
    for group in sorted(set(groups.tolist())):
        seen, unseen = (held_back.of_trials(np.flatnonzero(each)) for each in (groups != group, groups == group))
        subspace = StructuredSubspace.of(found.structure, seen.outputs, seen.first_rows, model.block_rows)
        without, _ = subspace.of_all(order)
        rows = settled_rows(unseen, rate_hz)
        errors = errors_on(replace(without, level_step=model.level_step), rows, steps)
        logs += len(rows.outputs) * np.log(over_hold(rows, steps, errors))
    return Candidate(model, warnings, steps, np.exp(logs / len(groups)))


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
