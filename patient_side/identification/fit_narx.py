"""NARX on a training set: number of lags by validation. For comparison only: filters need a linear model."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from math import comb

import numpy as np

from tis.common.channels import Hand
from tis.common.errors import DataError, Fault
from tis.common.scenario.identification import Identification
from tis.common.sources.trajectory import Recording
from tis.patient_side.identification.arx import check_lags
from tis.patient_side.identification.breakdown import breakdown_as_fault
from tis.patient_side.identification.dataset import training_set
from tis.patient_side.identification.narx import NarxModel, identify
from tis.patient_side.identification.trials import check_trials
from tis.patient_side.identification.validation import HELD_BACK, SimulationFit, fewest_rows, scored, split_trials
from tis.patient_side.statespace import Array

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
