"""Heads on the residual of a corrected forecast: kernels of a hand's movement, tool and grippers.

    r[h] = s (Q' W[h] k(f) + V[h] l(g))

f and g are inputs in a frame Q and in the base's, r is what they add to the forecast over h samples, and s is the
hand's usual move at its present activity. k and l are Gaussian kernels between the inputs and landmarks, which are
some of the training's own inputs (Nyström's method: Williams and Seeger 2001, "Using the Nyström method to speed up
kernel machines"), longer than that of the correction's own features, as the inputs are more. Random features do for
those; with so many inputs as here landmarks do better, as they lie where the inputs do. Ridge regressions, and people
who are left out of both, say what each is worth (`fit_heads`). There are two:

- in the frame of the *movement*, its first axis along the velocity, its second upright: how a reach goes on depends
  little on where it leads;
- in the frame of the *base*: where a hand goes depends on where things lie, on where the tool points, on how it
  turns, and on where the other arm is and what it does.

The inputs are the last increments and the ways to running means, limited as the correction's are, the speed, the
gripper's opening, and its changes; those of the base are also the tool's axes and its turns, the other gripper's
opening and its changes, the way to the other arm, and how it changed in the last second and in the last three. All
are known at the newest sample: the features are computed once for each, and the forecasts of all ticks until the next
one use them.

The sums below are of plain numbers where a sample arrives, and of arrays (M,) where M rows are fitted.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import isnan, nan, sqrt
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tis.patient_side.filters.correction import N_USED_INCREMENTS, Movement, Seen, movement_rows
from tis.patient_side.filters.innovations_filter import AXES, InnovationsFilter
from tis.patient_side.linear_system import Array
from tis.patient_side.movement_models import MEANS_S, N_HEAD_INPUTS, Correction
from tis.patient_side.playout import Playout, SourceBuffer

FRAMES: Final = ("movement", "base")
N_LANDMARKS: Final = 300
LENGTHS: Final = (12.0, 14.0)
"""Lengths of the kernels, in deviations of the inputs, by frame."""
_LAGS_S: Final = (0.0, 1 / 30, 0.1, 0.2, 1 / 3, 2 / 3)
"""How long ago the grippers were that the inputs compare with the present ones."""
_TURNS: Final = (2, 4)
"""Which of these the tool's turns are compared over."""
_WAYS_S: Final = (0.0, 1.0, 3.0)
"""How long ago the ways to the other arm were that the inputs compare with the present one."""
_WAY_M: Final = 0.03
_TURN_RAD: Final = 1.1
_SWING: Final = 1.2
"""Turn of a tool, and change of a gripper in units of its spread, that count as large after a second."""
_INCREMENT: Final = 2.0
"""Increment that counts as large, in units of the usual one."""
_LEAST: Final = 1e-12
_N_VECTORS: Final = N_USED_INCREMENTS + len(MEANS_S)

# A row of inputs: the path in the base's frame, the base's others, what both heads use, the path in the frame of the
# movement, and how that lies.
_OTHERS: Final = AXES * _N_VECTORS
_BOTH: Final = _OTHERS + 6 + len(_LAGS_S) + AXES * (len(_TURNS) + len(_WAYS_S))
_TURNED: Final = _BOTH + len(_LAGS_S) + 1
_UP: Final = _TURNED + AXES * _N_VECTORS
_OF_FRAME: Final = (slice(_BOTH, _UP + 2), slice(0, _TURNED))
assert tuple(each.stop - each.start for each in _OF_FRAME) == N_HEAD_INPUTS

Numbers = Any
"""A number, or an array (M,) of them."""
Table = Sequence[Sequence[Numbers]] | Array
Singles = NDArray[np.float32]


def lags(of_s: Sequence[float], rate_hz: int) -> NDArray[np.int64]:
    """Return times as numbers of samples."""
    return np.round(np.array(of_s) * rate_hz).astype(np.int64)


def looked_back(values: Array, first: int, lags_: NDArray[np.int64]) -> Array:
    """Return values (N - first, L, K) at the lags of each row from ``first`` on, of those of all rows (N, K)."""
    return np.asarray(values[np.maximum(np.arange(first, len(values))[:, None] - lags_, 0)])


@dataclass(frozen=True)
class Surroundings:
    """Wrists and the other arm at M rows: what heads look back on beside the path.

    ``wrists`` (L, 5, M) are the arm's at the lags, ``other_rad`` (L, M) the other gripper's angles, and ``ways_m``
    (L', 3, M) the ways to the other arm. NaN: unknown.
    """

    wrists: Table
    other_rad: Sequence[Numbers] | Array
    ways_m: Table

    @classmethod
    def of_rows(cls, wrists: Array, others: Array, first: int, rate_hz: int) -> "Surroundings":
        """Return those of the rows from ``first`` on, of all wrists (N, 5), and ways and grippers (N, 4)."""
        near, far = lags(_LAGS_S, rate_hz), lags(_WAYS_S, rate_hz)
        return cls(
            looked_back(wrists, first, near).transpose(1, 2, 0),
            looked_back(others[:, AXES:], first, near)[:, :, 0].T,
            looked_back(others[:, :AXES], first, far).transpose(1, 2, 0),
        )


def _axes_of(x: Numbers, y: Numbers, z: Numbers) -> tuple[Numbers, ...]:
    """Return the axes of a movement: along it, upright, and across, 9 numbers. They vanish where it does."""
    size = (x * x + y * y + z * z + _LEAST) ** -0.5
    x, y, z = x * size, y * size, z * size
    px, py, pz = -z * x, -z * y, 1.0 - z * z
    size = (px * px + py * py + pz * pz + _LEAST) ** -0.5
    px, py, pz = px * size, py * size, pz * size
    return x, y, z, px, py, pz, y * pz - z * py, z * px - x * pz, x * py - y * px


@dataclass(frozen=True)
class _Sizes:
    """What counts as large at one rate, inverted: an increment or way (9, 1), a gripper's changes, and turns."""

    ways: Array
    usual_rad: float
    spread: float
    swings: tuple[float, ...]
    turns: tuple[float, ...]

    @classmethod
    def of(cls, model: Correction) -> "_Sizes":
        spread = 1.0 / model.gripper_spread_rad if model.gripper_spread_rad > 0.0 else 0.0
        usual = np.full(N_USED_INCREMENTS, _INCREMENT / model.span)
        return cls(
            1.0 / (model.usual_m * np.concatenate([usual, model.widths])[:, None]),
            model.gripper_usual_rad,
            spread,
            tuple(spread / (_SWING * lag_s**0.5) for lag_s in _LAGS_S[1:]),
            tuple(4.0 / (_TURN_RAD * _LAGS_S[i] ** 0.5) for i in _TURNS),
        )

    def others(self, around: Surroundings) -> list[Numbers]:
        """Return the inputs that are not of the path, not yet limited, those that both heads use last."""
        x, y, z, w, g = around.wrists[0]
        (ox, oy, oz), *ways_m = around.ways_m
        now, *before = around.other_rad
        found = [z * x + y * w, y * z - x * w, 0.5 - x * x - y * y, 0.5 - y * y - z * z, x * y + z * w, x * z - y * w]
        found += [ox, oy, oz, (now - self.usual_rad) * self.spread]
        found += [(now - then) * large for large, then in zip(self.swings, before, strict=True)]
        for large, i in zip(self.turns, _TURNS, strict=True):
            # The sine of the turn, whatever the signs of the quaternions: 2 cos sin of half of it.
            a, b, c, d, _ = around.wrists[i]
            cosine = (x * a + y * b + z * c + w * d) * large / 2.0
            found.append((d * x - w * a - y * c + z * b) * cosine)
            found.append((d * y - w * b - z * a + x * c) * cosine)
            found.append((d * z - w * c - x * b + y * a) * cosine)
        for a, b, c in ways_m:
            found += [(ox - a) / _WAY_M, (oy - b) / _WAY_M, (oz - c) / _WAY_M]
        found += [(g - then[4]) * large for large, then in zip(self.swings, around.wrists[1:], strict=True)]
        found.append((g - self.usual_rad) * self.spread)
        return found


def _speed(x: Numbers, y: Numbers, z: Numbers) -> Numbers:
    """Return the hyperbolic tangent of the logarithm of a speed: even at rest it is finite."""
    square = x * x + y * y + z * z
    return (square - 1.0) / (square + 1.0)


def head_inputs(
    model: Correction, moved: Movement, activity: Array, around: Surroundings
) -> tuple[tuple[Array, Array], Array]:
    """Return the inputs (M, I) of both heads at M rows, NaN where unknown, and the axes (M, 3, 3) of the movement.

    Oracle: plain loops in test_heads.
    """
    sizes, n = _Sizes.of(model), len(activity)
    path = np.concatenate([moved.parts[:, 1 : 1 + N_USED_INCREMENTS], moved.ways], axis=1) * sizes.ways
    path /= np.sqrt(np.maximum(activity, _LEAST**2))[:, None, None]
    velocity = path[:, :N_USED_INCREMENTS].sum(axis=1).T
    axes = np.stack(_axes_of(*velocity), axis=1).reshape(n, AXES, AXES)
    others = np.stack([*sizes.others(around), _speed(*velocity)], axis=1)
    turned = np.matmul(path, axes.transpose(0, 2, 1))
    rows = np.tanh(np.hstack([path.reshape(n, -1), others, turned.reshape(n, -1), axes[:, :2, 2]]))
    of_movement, of_base = (rows[:, each] for each in _OF_FRAME)
    return (of_movement, of_base), axes


class Kernel(NamedTuple):
    """Gaussian kernel exp(-|z - c|^2 / 2 l^2) between M landmarks c and inputs z, both in deviations about the mean.

    An input that is unknown is at the mean. ``centre`` and ``precision`` (I,) are mean and inverse deviation,
    ``slopes`` (M, I) are c / l^2, ``levels`` (M,) half of c^2 / l^2, and ``narrow`` is 1 / l^2.
    """

    centre: Singles
    precision: Singles
    slopes: Singles
    levels: Singles
    narrow: float

    @classmethod
    def of(cls, i: int, centre: Array, deviation: Array, landmarks: Array) -> "Kernel":
        """Return the kernel of head ``i``."""
        narrow = LENGTHS[i] ** -2
        parts = centre, 1.0 / deviation, narrow * landmarks, narrow / 2.0 * np.sum(landmarks**2, axis=1)
        at, precision, slopes, levels = (part.astype(np.float32) for part in parts)
        return cls(at, precision, slopes, levels, narrow)

    def rows(self, inputs: Array) -> Singles:
        """Return the features (N, M) of inputs (N, I). Oracle: the kernel in plain numbers, test_heads."""
        ways = np.nan_to_num((inputs.astype(np.float32) - self.centre) * self.precision)
        found: Singles = ways @ self.slopes.T
        found -= self.levels
        found -= self.narrow / 2.0 * np.sum(ways**2, axis=1, keepdims=True)
        return np.exp(found, out=found)

    def row(self, inputs: Singles) -> Singles:
        """Return the features (M,) of one row of inputs (I,). Oracle: `rows`."""
        ways = inputs - self.centre
        ways *= self.precision
        square = ways.dot(ways)
        if isnan(square):
            np.nan_to_num(ways, copy=False)
            square = ways.dot(ways)
        found: Singles = self.slopes.dot(ways)
        found -= self.levels
        found -= self.narrow / 2.0 * square
        return np.exp(found, out=found)


@dataclass(frozen=True, eq=False)
class Heads:
    """The heads of a correction at one rate: all that does not depend on data."""

    sizes: _Sizes
    usual_m: float
    near: tuple[int, ...]
    far: tuple[int, ...]
    rows: Array
    kernels: tuple[Kernel, ...]

    @classmethod
    def of(cls, model: Correction, filter_: InnovationsFilter, rate_hz: int) -> "Heads | None":
        """Return the heads; None where the correction has none."""
        if not model.heads:
            return None
        d, sizes = filter_.n_axes, _Sizes.of(model)
        return cls(
            sizes,
            model.usual_m,
            tuple(lags(_LAGS_S, rate_hz).tolist()),
            tuple(lags(_WAYS_S, rate_hz).tolist()),
            movement_rows(filter_, model.span)[d : d * (1 + _N_VECTORS)] * np.repeat(sizes.ways, d, axis=0),
            tuple(Kernel.of(i, each.centre, each.deviation, each.landmarks) for i, each in enumerate(model.heads)),
        )

    def seen(self, mean: Array, activity: float, playout: Playout, index: int) -> Seen:
        """Return the features after the arm's arrived sample at ``index``, with the filter's mean (M, 3/d) there.

        It is `head_inputs` of one row, in plain numbers where there are few. Oracle: that.
        """
        scale = sqrt(activity) if activity > _LEAST**2 else _LEAST
        path = self.rows.dot(mean).reshape(_N_VECTORS, AXES)
        path *= 1.0 / scale
        (ax, ay, az), (bx, by, bz), (cx, cy, cz) = path[:N_USED_INCREMENTS].tolist()
        velocity = ax + bx + cx, ay + by + cy, az + bz + cz
        axes = _axes_of(*velocity)
        others = self.sizes.others(self._around(playout, index))
        others.append(_speed(*velocity))
        inputs = np.empty(_UP + 2)
        inputs[:_OTHERS] = path.ravel()
        inputs[_OTHERS:_TURNED] = others
        inputs[_TURNED:_UP] = path.dot(np.array(axes).reshape(AXES, AXES).T).ravel()
        inputs[_UP:] = axes[2], axes[5]
        limited = np.tanh(inputs, dtype=np.float32, casting="same_kind")
        movement, base = self.kernels
        of_movement, of_base = movement.row(limited[_OF_FRAME[0]]), base.row(limited[_OF_FRAME[1]])
        size = self.usual_m * scale
        return Seen(of_movement, of_base, tuple(size * each for each in axes), size)

    def _around(self, playout: Playout, index: int) -> Surroundings:
        """Return what the heads look back on at an arrived sample, and at the other arm's last one by then."""
        arm, other = playout.arm, playout.other_arm
        wrists = arm.wrists_before(index, self.near)
        if other is None or (at := index if index in other else other.newest_before(index)) < 0:
            return Surroundings(wrists, (nan,) * len(self.near), (_UNKNOWN,) * len(self.far))
        ways_m, last = [], _UNKNOWN
        for lag in self.far:
            here_m, there_m = _at_or_before(arm, index - lag), _at_or_before(other, at - lag)
            if here_m is not None and there_m is not None:
                (x, y, z), (a, b, c) = here_m.tolist(), there_m.tolist()
                last = a - x, b - y, c - z
            ways_m.append(last)
        return Surroundings(wrists, [each[4] for each in other.wrists_before(at, self.near)], ways_m)


_UNKNOWN: Final = (nan, nan, nan)


def _at_or_before(buffer: SourceBuffer, index: int) -> Array | None:
    """Return the position at an index, or at the last arrived one before it; None: there is none."""
    found = buffer.get(index)
    return buffer.get(buffer.newest_before(index)) if found is None else found
