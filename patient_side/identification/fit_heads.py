"""Heads on what a correction leaves: kernel ridge regressions of its errors, one frame after the other.

What a head is worth is found by leaving each person out of everything: the correction, the head before, and the head
are fitted without them, and forecast their rows. Each head is multiplied by the share that these errors support, less
half its standard error (`Stage`): a head that people whom it has not seen do not support vanishes.

Errors of the correction on rows held out would not do as what heads are fitted to. Those of one person come from
weights that have seen the person who is left out, and tell against them: of four people the shares found so were less
than half of those that a fifth supports, and at half a second nothing of the first head was left.

The priors narrow beyond a second, as those of the correction do. They are priors of functions, alike wherever the
inputs lie: the kernel's features are turned so that products of these are the kernel among the landmarks.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tis.common.streams import Stream
from tis.patient_side.filters.correction import movements
from tis.patient_side.filters.heads import FRAMES, N_LANDMARKS, Kernel, head_inputs
from tis.patient_side.filters.innovations_filter import AXES
from tis.patient_side.identification.correction_rows import short
from tis.patient_side.identification.fit_correction import Features, FittedCorrection, Stage, ridge
from tis.patient_side.linear_system import Array
from tis.patient_side.movement_models import Head

_TOGETHER: Final = (10.0, 30.0)
"""How much of the errors' variance all features of a frame may explain, by the prior."""
_ALIKE_S: Final = 1 / 3
_REACH_S: Final = 1.0
_LEAST_DEVIATION: Final = 1e-6
_LEAST_SIZE: Final = 1e-7
"""Least size of a kernel's direction that is used, of the largest."""
_EVERY: Final = 2
"""Of so many rows one is fitted: neighbouring ones tell the same."""
_FASTEST_HZ: Final = 250
"""Rate above which there are no heads: their inputs take time that a tick of a millisecond does not have."""


def with_heads(fitted: FittedCorrection, steps: NDArray[np.int64], rate_hz: int) -> FittedCorrection:
    """Return the correction with its heads and what these leave.

    It is as it was at a high rate, where rows have no wrists to look back on, and where no head is worth anything.
    Oracles in test_fit_heads: people whose movement turns by a law, and people of whom nothing can be learned.
    """
    stage, model = fitted.stage, fitted.correction
    if rate_hz > _FASTEST_HZ or any(trial.rows.around is None for trial in stage.trials):
        return fitted
    inputs, axes = [], []
    for trial in stage.trials:
        moved = movements(stage.filter, model.span, trial.rows.means)
        assert trial.rows.around is not None
        found = head_inputs(model, moved, trial.rows.activity, trial.rows.around)
        inputs.append(found[0])
        axes.append(found[1])
    units = [trial.unit for trial in stage.trials]
    held = [[e / u[: len(e), None] for e, u in zip(each, units, strict=True)] for each in fitted.errors]
    left = _Left([fitted.left_without(j, h, _EVERY) for j, h in enumerate(steps.tolist())], held)
    heads = []
    for i in range(len(FRAMES)):
        frames = axes if i == 0 else [None] * len(axes)
        heads.append(_fitted(i, [each[i] for each in inputs], frames, stage, left, steps, rate_hz))
    if not any(head.weights.any() for head in heads):
        return fitted
    errors = [[e * u[: len(e), None] for e, u in zip(each, units, strict=True)] for each in left.held]
    return replace(fitted, correction=replace(model, heads=heads), errors=errors)


class _Left(NamedTuple):
    """What is left, by horizon and trial: of fitted rows by world (M, G + 1, 3), and of all rows held out (N, 3)."""

    worlds: list[list[Array]]
    held: list[list[Array]]


def _fitted(
    i: int,
    inputs: Sequence[Array],
    frames: Sequence[Array | None],
    stage: Stage,
    left: _Left,
    steps: NDArray[np.int64],
    rate_hz: int,
) -> Head:
    """Return head ``i``, and take what it adds from what is ``left``."""
    known = np.ma.masked_invalid(np.concatenate(inputs))  # recordings of one hand have no other arm
    centre = short(known.mean(axis=0).filled(0.0))
    deviation = short(np.maximum(known.std(axis=0).filled(0.0), _LEAST_DEVIATION))
    landmarks = _landmarks(i, (np.concatenate(inputs) - centre) / deviation)
    kernel = Kernel.of(i, centre, deviation, landmarks)
    root = root_of(kernel.rows(centre + deviation * landmarks))
    features: list[Features] = [kernel.rows(each) @ root for each in inputs]
    power = np.mean(np.square(np.concatenate([each[::_EVERY] for each in features])), axis=0)
    weights = np.zeros((len(steps), AXES, len(landmarks)))
    groups = [int(trial.rows.group[0]) for trial in stage.trials]
    alone = [each[::_EVERY].T @ each[::_EVERY] for each in features]
    for j, h in enumerate(steps.tolist()):
        alike = (h + _ALIKE_S * rate_hz) / _EVERY
        prior = _TOGETHER[i] * min(1.0, _REACH_S * rate_hz / h)
        precision = alike / (prior * power)  # in units of the features' sizes: one prior for all of them
        worlds = _by_world(features, alone, frames, groups, left.worlds[j], precision)
        corrections = []
        for each, frame, group, error in zip(features, frames, groups, left.held[j], strict=True):
            corrections.append(_from(each[: len(error)] @ worlds[group], frame))
        share, left.held[j] = stage.shared(left.held[j], corrections)
        weights[j] = share * (root @ worlds[-1]).T
        if share and i < len(FRAMES) - 1:
            together = share * worlds.transpose(1, 0, 2).reshape(root.shape[1], -1)
            for each, frame, error in zip(features, frames, left.worlds[j], strict=True):
                added = each[::_EVERY][: len(error)] @ together
                error -= _from(added.reshape(error.shape), None if frame is None else frame[::_EVERY])
    return Head(centre, deviation, short(weights, digits=7), landmarks)


def _landmarks(i: int, rows: Array) -> Array:
    """Return the landmarks (M, I) of head ``i``: rows of inputs (N, I), drawn without repetition.

    They have two digits, as they are many, and stand in the model file and in each log.
    """
    draws = Stream.named(0, f"landmarks of the {FRAMES[i]}").uniforms(0, len(rows))
    return np.nan_to_num(rows[np.sort(np.argsort(draws)[:N_LANDMARKS])]).round(2)


def root_of(products: Features) -> NDArray[np.float32]:
    """Return the map (M, K) from features to those whose products are the kernel, of that among the landmarks (M, M).

    Of the kernel's directions those remain whose sizes single precision can tell. Weights on them are large, and
    nearly cancel, so they are kept in all its digits. Oracle: kernel ridge regression.
    """
    sizes, directions = np.linalg.eigh(products.astype(np.float64))
    kept = sizes > _LEAST_SIZE * sizes[-1]
    return np.asarray(directions[:, kept] / np.sqrt(sizes[kept]), dtype=np.float32)


def _by_world(
    features: Sequence[Features],
    alone: Sequence[Features],
    frames: Sequence[Array | None],
    groups: Sequence[int],
    left: Sequence[Array],
    precision: Array,
) -> NDArray[np.float32]:
    """Return the weights (G + 1, K, 3) of each world, fitted to the rows of the groups that it has seen."""
    n_worlds, size = left[0].shape[1], len(precision)
    past, cross = np.zeros((n_worlds, size, size)), np.zeros((n_worlds, size, AXES))
    square, n = np.zeros(n_worlds), np.zeros(n_worlds)
    for each, whole, frame, group, error in zip(features, alone, frames, groups, left, strict=True):
        rows = each[::_EVERY]
        turned = error if frame is None else np.matmul(error, frame[::_EVERY][: len(error)].transpose(0, 2, 1))
        tail, seen = rows[len(error) :], np.arange(n_worlds) != group
        past[group] += whole - tail.T @ tail
        both = rows[: len(error)].T @ turned.reshape(len(error), -1).astype(np.float32)
        cross[seen] += both.reshape(size, n_worlds, AXES).transpose(1, 0, 2)[seen]
        square[seen] += (np.sum(turned**2, axis=(0, 2)) / AXES)[seen]
        n[seen] += len(error)
    total = past.sum(axis=0)
    past[-1] = 0.0  # the last world has seen all
    found = [ridge(total - past[g], cross[g], float(square[g]), float(n[g]), precision) for g in range(n_worlds)]
    return np.stack(found).astype(np.float32)


def _from(added: Array, frame: Array | None) -> Array:
    """Return what is added in a frame's axes (M, 3, 3), of numbers (..., 3) at its rows (N, ...), in the base's."""
    if frame is None:
        return added
    axes = frame[: len(added)]
    return np.asarray(np.matmul(added.reshape(len(added), -1, AXES), axes).reshape(added.shape))
