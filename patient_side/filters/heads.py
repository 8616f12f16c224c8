"""Heads on the residual of a corrected forecast: random features of a hand's movement, tool and gripper.

    r[h] = s Q' W[h] cos(F f + phi)

f are inputs in a frame Q, r is what they add to the forecast over h samples, and s is the hand's usual move at its
present activity. The features stand for a Gaussian kernel (`correction`, Rahimi and Recht 2007), longer than that of
the correction's own, as the inputs are more; ridge regressions on people who are held out say what each is worth
(`fit_heads`). There are two:

- in the frame of the *movement*, its first axis along the velocity, its second upright: how a reach goes on depends
  little on where it leads;
- in the frame of the *base*: where a hand goes depends on where things lie, on where the tool points, and on how it
  turns.

The inputs are the last increments and the ways to running means, limited as the correction's are, the speed, the
gripper's opening, and its changes; those of the base are also the tool's axes and its turns, and the way to the
other arm. All are known at the newest sample: the features are computed once for each, and the forecasts of all ticks
until the next one use them.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tis.patient_side.filters.correction import (
    N_USED_INCREMENTS,
    Movement,
    Seen,
    log_speed,
    movement_rows,
    openness,
    projections,
    split,
)
from tis.patient_side.filters.innovations_filter import AXES, InnovationsFilter
from tis.patient_side.linear_system import Array
from tis.patient_side.movement_models import Correction
from tis.patient_side.playout import Playout, SourceBuffer

FRAMES: Final = ("movement", "base")
N_HEAD_FEATURES: Final = 400
LENGTHS: Final = (12.0, 14.0)
"""Lengths of the kernels, in deviations of the inputs, by frame."""
_LAGS_S: Final = (0.0, 1 / 30, 0.1, 0.2, 1 / 3, 2 / 3)
"""How long ago the orientations and grippers were that the inputs compare with the present ones."""
_TURN_RAD: Final = 1.1
_SWING: Final = 1.2
"""Turn of a tool, and change of a gripper in units of its spread, that count as large after a second."""
_INCREMENT: Final = 2.0
"""Increment that counts as large, in units of the usual one."""
_LEAST: Final = 1e-12
_DOWN: Final = np.array([0.0, 0.0, 1.0])
_NEXT: Final = np.array([1, 2, 0])
_LAST: Final = np.array([2, 0, 1])


def wrist_lags(rate_hz: int) -> NDArray[np.int64]:
    """Return the numbers of samples (L,) by which orientations and grippers are looked back on, 0 first."""
    return np.round(np.array(_LAGS_S) * rate_hz).astype(np.int64)


def looked_back(wrists: Array, first: int, rate_hz: int) -> Array:
    """Return the wrists (N - first, L, 5) at the lags of each row from ``first`` on, of those of all rows (N, 5)."""
    rows = np.arange(first, len(wrists))[:, None] - wrist_lags(rate_hz)
    return np.asarray(wrists[np.maximum(rows, 0)])


def looked_back_in(buffer: SourceBuffer, index: int, lags: NDArray[np.int64]) -> Array:
    """Return the wrists (1, L, 5) at the lags of an arrived sample; one that is missing is the next newer one."""
    indices = index - lags
    if buffer.all_arrived(indices):
        return buffer.wrists(indices)[None]
    known = np.maximum.accumulate(np.where(buffer.arrived(indices), np.arange(len(lags)), 0))
    return buffer.wrists(indices[known])[None]


def _way_to_other(playout: Playout, index: int) -> Array | None:
    """Return the way (1, 3) to the other arm, at this one's sample or the last one before it; None: unknown."""
    own_m, other = playout.arm.get(index), playout.other_arm
    if other is None or own_m is None:
        return None
    there_m = other.get(index if index in other else other.newest_before(index))
    return None if there_m is None else (there_m - own_m)[None]


class HeadInputs(NamedTuple):
    """Inputs of one head at M rows (M, I), and its frame's axes (M, 3, 3), one a row; None: those of the base."""

    values: Array
    axes: Array | None

    def known(self, centre: Array) -> Array:
        """Return the values with the ``centre`` (I,) for those that are not known."""
        return np.asarray(np.where(np.isnan(self.values), centre, self.values))


def head_inputs(
    model: Correction, moved: Movement, activity: Array, wrists: Array, between_m: Array | None = None
) -> tuple[HeadInputs, HeadInputs]:
    """Return the inputs of both heads at M rows, with the wrists (M, L, 5) at the lags of each.

    ``between_m`` (M, 3) are the ways to the other arm, NaN where it is not known. Unknown orientations and grippers
    are those that count as usual. Oracle: plain loops in test_heads.
    """
    unit = model.usual_m * np.sqrt(np.maximum(activity, _LEAST**2))
    increments = moved.parts[:, 1 : 1 + N_USED_INCREMENTS]
    axes = _axes_of(increments.sum(axis=1))
    vectors = np.concatenate([increments, moved.ways], axis=1) / unit[:, None, None]
    usual = np.full(N_USED_INCREMENTS, _INCREMENT / model.span)
    vectors /= np.concatenate([usual, model.widths])[:, None]
    speed = np.clip(log_speed(moved.velocity, unit), model.lowest, model.highest)
    gripper = _grippers(model, wrists[:, :, 4])
    scalars = np.hstack([speed[:, None], gripper])
    if between_m is None:
        between_m = np.full((len(unit), AXES), np.nan)
    turned = np.tanh(np.matmul(vectors, axes.transpose(0, 2, 1))).reshape(len(unit), -1)
    based = np.tanh(vectors).reshape(len(unit), -1)
    return (
        HeadInputs(np.hstack([turned, scalars, axes[:, :2, 2]]), axes),
        HeadInputs(np.hstack([based, scalars, _tools(wrists[:, :, :4]), between_m]), None),
    )


def _axes_of(velocity: Array) -> Array:
    """Return the axes (M, 3, 3) of a movement: along it, upright, and across. They vanish where it does."""
    along = velocity / np.maximum(np.linalg.norm(velocity, axis=1, keepdims=True), _LEAST)
    upright = _DOWN - along[:, 2:] * along
    upright /= np.maximum(np.linalg.norm(upright, axis=1, keepdims=True), _LEAST)
    return np.stack([along, upright, _cross(along, upright)], axis=1)


def _grippers(model: Correction, angles_rad: Array) -> Array:
    """Return opening and changes (M, L) of grippers (M, L) at the lags."""
    g = openness(angles_rad[:, 0], model.gripper_usual_rad, model.gripper_spread_rad)[:, None]
    if model.gripper_spread_rad <= 0.0:
        return np.repeat(g, angles_rad.shape[1], axis=1)
    large = _SWING * model.gripper_spread_rad * np.sqrt(_LAGS_S[1:])
    return _known(np.hstack([g, np.tanh((angles_rad[:, :1] - angles_rad[:, 1:]) / large)]))


def _tools(turns: Array) -> Array:
    """Return two axes of tools, and their turns in the base's frame, (M, 6 + 3 (L - 1)), of quaternions (M, L, 4)."""
    x, y, z, w = turns[:, 0].T
    two = [z * x + y * w, y * z - x * w, 0.5 - x * x - y * y, 0.5 - y * y - z * z, x * y + z * w, x * z - y * w]
    now, then = turns[:, :1], turns[:, 1:]
    half = then[..., 3:] * now[..., :3] - now[..., 3:] * then[..., :3] - _cross(now[..., :3], then[..., :3])
    cosine = np.sum(now * then, axis=2, keepdims=True)
    large = _TURN_RAD * np.sqrt(_LAGS_S[1:])[:, None]
    moved = np.tanh(2.0 * np.copysign(1.0, cosine) * half / large).reshape(len(turns), -1)
    return _known(np.hstack([2.0 * np.stack(two, axis=1), moved]))


def _cross(a: Array, b: Array) -> Array:
    """Return the cross products of vectors (..., 3): on so few numpy's own takes four times as long."""
    return a.take(_NEXT, axis=-1) * b.take(_LAST, axis=-1) - a.take(_LAST, axis=-1) * b.take(_NEXT, axis=-1)


def _known(values: Array) -> Array:
    """Return values with 0 for those that are not known."""
    return np.asarray(np.where(np.isnan(values), 0.0, values))


def head_projections(i: int, centre: Array, deviation: Array, n_features: int) -> Array:
    """Return F and phi side by side (M, I + 1) of head ``i``."""
    return projections(centre, deviation, n_features, LENGTHS[i], f"head of the {FRAMES[i]}")


@dataclass(frozen=True, eq=False)
class Heads:
    """The heads of a correction at one rate: all that does not depend on data."""

    model: Correction
    lags: NDArray[np.int64]
    rows: Array
    drawn: Sequence[Array]

    @classmethod
    def of(cls, model: Correction, filter_: InnovationsFilter, rate_hz: int) -> "Heads | None":
        """Return the heads; None where the correction has none."""
        if not model.heads:
            return None
        rows: Array = np.kron(movement_rows(filter_, model.span), np.eye(AXES // filter_.n_axes)).astype(float)
        drawn = [
            head_projections(i, each.centre, each.deviation, each.weights.shape[2])
            for i, each in enumerate(model.heads)
        ]
        return cls(model, wrist_lags(rate_hz), rows, drawn)

    def seen(self, mean: Array, activity: float, playout: Playout, index: int) -> tuple[Seen, ...]:
        """Return the features after the arm's arrived sample at ``index``, with the filter's mean (M, 3/d) there."""
        moved = split(self.rows.dot(mean.reshape(-1)).reshape(1, -1, AXES))
        wrists, way_m = looked_back_in(playout.arm, index, self.lags), _way_to_other(playout, index)
        inputs = head_inputs(self.model, moved, np.array([activity]), wrists, way_m)
        scale = self.model.usual_m * np.sqrt(max(activity, _LEAST**2))
        found = []
        for drawn, head, each in zip(self.drawn, self.model.heads, inputs, strict=True):
            features = scale * np.cos(drawn[:, :-1].dot(each.known(head.centre)[0]) + drawn[:, -1])
            found.append(Seen(features, None if each.axes is None else each.axes[0]))
        return tuple(found)
