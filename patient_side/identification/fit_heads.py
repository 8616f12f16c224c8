"""Heads on what a correction leaves: ridge regressions of its errors on random features, one frame after the other.

They are fitted to the errors of rows held out, by person, of the correction, and, where people are held out again,
each is multiplied by the share that these support, less half its standard error (`Stage`): a head that people whom it
has not seen do not support vanishes. The priors narrow beyond a second, as those of the correction do.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tis.patient_side.filters.correction import movements
from tis.patient_side.filters.heads import FRAMES, N_HEAD_FEATURES, HeadInputs, head_inputs, head_projections
from tis.patient_side.filters.innovations_filter import AXES
from tis.patient_side.identification.correction_rows import short
from tis.patient_side.identification.fit_correction import Features, FittedCorrection, Stage, solutions
from tis.patient_side.linear_system import Array
from tis.patient_side.movement_models import Head

_TOGETHER: Final = (3.0, 10.0)
"""How much of the errors' variance all features of a frame may explain, by the prior."""
_ALIKE_S: Final = 1 / 3
_REACH_S: Final = 1.0
_LEAST_DEVIATION: Final = 1e-6
_FASTEST_HZ: Final = 250
"""Rate above which there are no heads: their inputs take some 0.1 ms, which a tick of a millisecond does not have."""


def with_heads(fitted: FittedCorrection, steps: NDArray[np.int64], rate_hz: int) -> FittedCorrection:
    """Return the correction with its heads and what these leave.

    It is as it was at a high rate, and where rows have no wrists to look back on.
    Oracles in test_fit_heads: people whose movement turns by a law, and people of whom nothing can be learned.
    """
    if rate_hz > _FASTEST_HZ:
        return fitted
    stage, model = fitted.stage, fitted.correction
    by_trial: list[tuple[HeadInputs, HeadInputs]] = []
    for trial in stage.trials:
        if trial.rows.wrists is None:
            return fitted
        moved = movements(stage.filter, model.span, trial.rows.means)
        by_trial.append(head_inputs(model, moved, trial.rows.activity, trial.rows.wrists, trial.rows.between_m))
    units = [trial.unit for trial in stage.trials]
    left = [[e / u[: len(e), None] for e, u in zip(each, units, strict=True)] for each in fitted.errors]
    heads = []
    for i in range(len(FRAMES)):
        head, left = _fitted(i, [each[i] for each in by_trial], stage, left, steps, rate_hz)
        heads.append(head)
    errors = [[e * u[: len(e), None] for e, u in zip(each, units, strict=True)] for each in left]
    return replace(fitted, correction=replace(model, heads=heads), errors=errors)


def _fitted(
    i: int,
    inputs: Sequence[HeadInputs],
    stage: Stage,
    left: list[list[Array]],
    steps: NDArray[np.int64],
    rate_hz: int,
) -> tuple[Head, list[list[Array]]]:
    """Return head ``i``, and what it leaves of ``left`` on people held out."""
    pooled = np.concatenate([each.values for each in inputs])
    known = np.ma.masked_invalid(pooled)  # recordings of one hand have no other arm
    centre = short(known.mean(axis=0).filled(0.0))
    deviation = short(np.maximum(known.std(axis=0).filled(0.0), _LEAST_DEVIATION))
    drawn = head_projections(i, centre, deviation, N_HEAD_FEATURES).astype(np.float32)
    features: list[Features] = [
        np.cos(each.known(centre).astype(np.float32) @ drawn[:, :-1].T + drawn[:, -1]) for each in inputs
    ]
    axes = [each.axes for each in inputs]
    turned = [[_turned(e, q) for e, q in zip(each, axes, strict=True)] for each in left]
    moments = stage.moments_of_features(features, turned)
    weights = np.zeros((len(steps), AXES, N_HEAD_FEATURES))
    after = []
    for j, h in enumerate(steps.tolist()):
        alike = h + _ALIKE_S * rate_hz
        precision = np.full(
            N_HEAD_FEATURES, alike * N_HEAD_FEATURES / _TOGETHER[i] / min(1.0, _REACH_S * rate_hz / h)
        )
        whole, by_group = solutions(moments[j], precision)
        share, residuals = stage.left_of_features(features, turned[j], by_group)
        weights[j] = share * whole.T
        after.append([_turned_back(e, q) for e, q in zip(residuals, axes, strict=True)])
    return Head(centre, deviation, short(weights)), after


def _turned(errors: Array, axes: Array | None) -> Array:
    """Return errors (M, 3) in a frame's axes (N, 3, 3)."""
    return errors if axes is None else np.matmul(axes[: len(errors)], errors[:, :, None])[:, :, 0]


def _turned_back(errors: Array, axes: Array | None) -> Array:
    return errors if axes is None else np.matmul(errors[:, None], axes[: len(errors)])[:, 0]
