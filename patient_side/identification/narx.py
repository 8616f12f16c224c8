"""Polynomial NARX: the next outputs as a sum of few monomials of the last outputs and inputs.

``y[k] = sum_j theta_j phi_j(y[k-1..k-lags], u[k..k-lags]) + e[k]``, each phi_j a product of at most ``degree``
factors. Orthogonal forward regression selects the monomials: each step adds the one that explains most of the
residual, as long as Schwarz's criterion falls (Chen, Billings and Luo 1989, Int. J. Control 50:1873). The
coefficients are then regularised. Stability is not guaranteed, so that a free run clips its outputs to the training
range plus a margin.

NARX on a training set: number of lags by validation. For comparison only: filters need a linear model.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from itertools import combinations_with_replacement
from math import comb

import numpy as np

from tis.common.channels import Hand
from tis.common.errors import DataError, Fault
from tis.common.scenario.identification import Identification
from tis.common.sources.trajectory import Recording
from tis.patient_side.identification.arx import check_lags
from tis.patient_side.identification.dataset import training_set
from tis.patient_side.identification.hankel import COLUMNS_AT_ONCE, accumulate, empty_factor
from tis.patient_side.identification.linear_model import Signals, as_trials, check_numbers
from tis.patient_side.identification.trials import Scaling, Trial, breakdown_as_fault, check_trials
from tis.patient_side.identification.validation import HELD_BACK, SimulationFit, fewest_rows, scored, split_trials
from tis.patient_side.linear_system import Array

MAX_TERMS = 12
_RIDGE = 1e-6
_MARGIN = 0.5
_COLLINEAR = 1e-10

Monomial = tuple[int, ...]
"""The factors of a product, by their position among the regressors; the empty product is the constant 1."""


@dataclass(frozen=True)
class NarxModel:
    """Monomials and coefficients (terms,) for each output, in scaled units about the means of the training rows.

    The regressors are the outputs 1 .. lags samples ago, then the inputs 0 .. lags samples ago, channel by channel
    within each. ``low`` and ``high`` (p,) bound the outputs of a free run.
    """

    lags: int
    terms: tuple[tuple[Monomial, ...], ...]
    coefficients: tuple[Array, ...]
    scaling: Scaling
    input_mean: Array
    output_mean: Array
    low: Array
    high: Array

    def free_run(self, u: Array, y: Array) -> Array:
        """Return the simulation (N, p) from all inputs and the first ``lags`` outputs, of y (>= lags, p)."""
        inputs, first = self._scaled(u, y[: self.lags])
        outputs = np.zeros((len(u), first.shape[1]))
        outputs[: self.lags] = first
        for k in range(self.lags, len(u)):
            now = slice(k - self.lags, k + 1)
            regressors = _regressors(inputs[now], outputs[now], self.lags)
            for output, (terms, theta) in enumerate(zip(self.terms, self.coefficients, strict=True)):
                outputs[k, output] = (_products(regressors, terms) @ theta)[0]
            outputs[k] = np.clip(outputs[k], self.low, self.high)
        return np.asarray(outputs * self.scaling.output + self.output_mean)

    def _scaled(self, u: Array, y: Array) -> tuple[Array, Array]:
        return (u - self.input_mean) / self.scaling.input, (y - self.output_mean) / self.scaling.output


def identify(u: Signals, y: Signals, order: int, horizon: int, *, degree: int = 2) -> NarxModel:
    """Return the model of ``order`` lags and at most 12 monomials an output, of ``degree`` or less.

    The parameters are those of the linear methods: one trial (N, m), (N, p) or several; the first ``horizon`` rows of
    each are omitted, so that models of all orders up to it explain the same rows. Raises `DataError`. Oracles in
    test_narx: a known bilinear system, and `arx` for degree 1.
    """
    check_numbers(order, horizon)
    trials = as_trials(u, y)
    check_trials(trials, horizon)
    check_lags(order, horizon)
    scaling = Scaling.of(trials)
    input_mean = np.concatenate([inputs for inputs, _ in trials]).mean(axis=0)
    output_mean = np.concatenate([outputs for _, outputs in trials]).mean(axis=0)
    scaled = scaling.scaled([(inputs - input_mean, outputs - output_mean) for inputs, outputs in trials])
    usable = [(inputs, outputs) for inputs, outputs in scaled if len(inputs) > horizon]
    candidates = _monomials(order * len(output_mean) + (order + 1) * len(input_mean), degree)
    columns, targets = _triangle(usable, order, horizon, candidates)
    n_rows = sum(len(outputs) - horizon for _, outputs in usable)
    chosen = [_forward_regression(columns, target, n_rows) for target in targets.T]
    low, high = _range(scaled)
    return NarxModel(
        order,
        tuple(tuple(candidates[i] for i in indices) for indices in chosen),
        tuple(_ridge(columns[:, indices], target) for indices, target in zip(chosen, targets.T, strict=True)),
        scaling,
        input_mean,
        output_mean,
        low,
        high,
    )


def _regressors(u: Array, y: Array, lags: int) -> Array:
    """Return the rows (N - lags, p lags + m (lags + 1)) of y[k-1], .., y[k-lags], u[k], .., u[k-lags]."""
    n = len(u)
    return np.hstack(
        [*(y[lags - i : n - i] for i in range(1, lags + 1)), *(u[lags - i : n - i] for i in range(lags + 1))]
    )


def _monomials(n_regressors: int, degree: int) -> list[Monomial]:
    return [factors for d in range(degree + 1) for factors in combinations_with_replacement(range(n_regressors), d)]


def _products(regressors: Array, monomials: Sequence[Monomial]) -> Array:
    return np.column_stack([np.prod(regressors[:, list(factors)], axis=1) for factors in monomials])


def _triangle(trials: Sequence[Trial], lags: int, first: int, monomials: Sequence[Monomial]) -> tuple[Array, Array]:
    """Return columns with the inner products of monomials and targets over the rows of all trials from ``first`` on.

    They are the columns of the triangular factor of all rows, which need not be in memory at once.
    """
    n_outputs = trials[0][1].shape[1]
    factor = empty_factor(len(monomials) + n_outputs)
    for u, y in trials:
        regressors, targets = _regressors(u, y, lags)[first - lags :], y[first:]
        for begin in range(0, len(targets), COLUMNS_AT_ONCE):
            rows = slice(begin, begin + COLUMNS_AT_ONCE)
            stretch = np.hstack([_products(regressors[rows], monomials), targets[rows]])
            factor = accumulate(factor, np.ascontiguousarray(stretch.T))
    return factor[:, :-n_outputs], factor[:, -n_outputs:]


def _forward_regression(columns: Array, target: Array, n: int) -> list[int]:
    """Return the selected columns, at least one, in order of selection; their inner products are over ``n`` rows."""
    rest, residual, chosen = columns.copy(), target.copy(), list[int]()
    sizes = np.sum(columns**2, axis=0)
    criterion = np.inf
    while len(chosen) < min(MAX_TERMS, columns.shape[1]):
        # The column that explains most of the residual; nearly collinear ones are rounding.
        norms = np.sum(rest**2, axis=0)
        usable = norms > _COLLINEAR * sizes
        gains = np.divide((residual @ rest) ** 2, norms, out=np.zeros_like(norms), where=usable)
        best = int(np.argmax(gains))
        if chosen and gains[best] <= 0:
            break
        # What it leaves, and whether Schwarz's criterion accepts it.
        direction = rest[:, best] / np.sqrt(norms[best]) if usable[best] else np.zeros(len(target))
        residual = residual - direction * (direction @ residual)
        left = float(residual @ residual)
        schwarz = n * np.log(max(left, np.finfo(float).tiny)) + (len(chosen) + 1) * np.log(n)
        if chosen and schwarz >= criterion:
            break
        # Gram-Schmidt: the remaining columns become orthogonal to it.
        chosen.append(best)
        criterion = schwarz
        rest -= np.outer(direction, direction @ rest)
        rest[:, best] = 0.0
        if left <= _COLLINEAR**2 * n:
            break
    return chosen


def _ridge(columns: Array, target: Array) -> Array:
    """Return the regularised least squares, with each coefficient's penalty in units of its column's mean square."""
    penalty = np.diag(np.sqrt(_RIDGE * np.sum(columns**2, axis=0)))
    padded = np.concatenate([target, np.zeros(columns.shape[1])])
    return np.asarray(np.linalg.lstsq(np.vstack([columns, penalty]), padded)[0])


def _range(trials: Sequence[Trial]) -> tuple[Array, Array]:
    outputs = np.concatenate([y for _, y in trials])
    margin = _MARGIN * np.ptp(outputs, axis=0)
    return outputs.min(axis=0) - margin, outputs.max(axis=0) + margin


MAX_LAGS_TRIED = 3
_MAX_VALUES = 5e7


@dataclass(frozen=True)
class NarxStudy:
    """A model of the first rows, and its simulation of the held-back ones; ``errors`` by number of lags."""

    model: NarxModel
    fit: SimulationFit
    errors: dict[int, float]


def fit_narx(trainings: Sequence[Recording], hand: Hand, identification: Identification) -> NarxStudy:
    """Return the NARX model of the rows before the held-back ones; raises `DataError`.

    ``order`` counts lags; every rule that is no number means validation: 1, 2 or 3 lags, by the smallest error of the
    free run on the held-back rows, scored from row ``2 block_rows`` on like linear models.
    """
    block_rows, order = identification.block_rows, identification.order
    training = training_set(
        trainings,
        hand,
        pool_hands=identification.train == "others",
        velocities=identification.looks_ahead,
        shortest=fewest_rows(block_rows),
    )
    check_trials(training.trials, block_rows, training.labels, HELD_BACK)
    tried = [order] if isinstance(order, int) else list(range(1, min(MAX_LAGS_TRIED, block_rows) + 1))
    check_lags(tried[-1], block_rows)
    fit_on, validate_on = split_trials(training.trials)
    inputs, outputs = [u for u, _ in fit_on], [y for _, y in fit_on]
    n_outputs = outputs[0].shape[1]
    _check_size(sum(map(len, inputs)), inputs[0].shape[1], n_outputs, tried[-1])
    found = {}
    with breakdown_as_fault("narx"):
        for lags in tried:
            model = identify(inputs, outputs, lags, block_rows)
            found[lags] = model, scored(partial(_simulated, model), n_outputs, validate_on, 2 * block_rows)
    best = min(found, key=lambda lags: found[lags][1].error)
    return NarxStudy(*found[best], {lags: fit.error for lags, (_, fit) in found.items()})


def _simulated(model: NarxModel, u: Array, y: Array) -> Array:
    return model.free_run(u, y[: max(model.lags, 1)])


def _check_size(n_rows: int, n_inputs: int, n_outputs: int, lags: int) -> None:
    """Raise `DataError` where the table of all monomials of degree 2 would fill the memory."""
    n_monomials = comb(n_outputs * lags + n_inputs * (lags + 1) + 2, 2)
    if n_rows * n_monomials > _MAX_VALUES:
        rule = f"must be lower for narx: {n_rows} rows of {n_monomials} monomials fill the memory"
        raise DataError(Fault("identification", "order", rule, lags))


def n_terms(model: NarxModel) -> list[int]:
    """Return the number of monomials of each output."""
    return [int(np.size(theta)) for theta in model.coefficients]
