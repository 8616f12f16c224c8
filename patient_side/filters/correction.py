"""The correction of a linear forecast by the state of the hand's movement: varying coefficients, Fourier features.

    p[h] = y + d[h] + sum_j c_j z_j + s W[h] cos(F f + phi),   c_j = w_j[h] . t

*Coefficients that vary* (Hastie and Tibshirani 1993, "Varying-coefficient models", J. R. Stat. Soc. B 55:757) weigh
parts z of the arm's own past: the move d that the linear model forecasts, the velocity, the last three increments,
and the ways to means over 1, 3 and 10 s. They vary with the terms t:

- the hand's speed and braking. Hands move in reaches with a bell-shaped speed (Flash and Hogan 1985, J. Neuroscience
  5:1688), and longer reaches are faster (isochrony: Viviani and McCollum 1983). A fast hand is in the middle of a
  long reach, a slow one at the beginning or end of one, and its acceleration separates the first half from the
  second. x is the logarithm of the speed in units of the hand's usual one, limited to the range of the training rows,
  and b the cosine between acceleration and velocity: 1 at the beginning of a straight reach, -1 at its end.
- the opening g of the gripper, between -1 and 1: a hand opens on its way to a grasp, and moves differently with an
  object (Jeannerod 1984, J. Motor Behavior 16:235). It is 0 at the usual opening and for an unknown gripper.
- the phase of the clock behind the rows, where there is one (`row_clock`).

*Fourier features* are cosines of random projections of f: the ways to six running means, each
limited by a hyperbolic tangent, x and g. They know directions, which the coefficients do not. s is the hand's usual
move at its present activity.

All of f and t is bounded, increments larger than nearly all of the training rows fade the coefficients, and both
corrections are fitted with priors (`fit_correction`): where training rows do not support them they vanish, and the
forecast is the linear one. A jump of the arm is no such increment: no state holds it (`follow_jump`).

Random Fourier features: cosines of random projections, which together stand for a Gaussian kernel.

    cos(F f + phi),   F = N / (l s),   phi = 2 pi U - F m

N is normal, U uniform, m and s are mean and deviation of the inputs f in the training rows, and l is the kernel's
length (Rahimi and Recht 2007, "Random features for large-scale kernel machines").
"""

from dataclasses import dataclass
from math import log, sqrt, tanh
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from tis.common.streams import Stream
from tis.patient_side.filters.innovations_filter import AXES, InnovationsFilter
from tis.patient_side.filters.recent_past import SLOW_MEANS
from tis.patient_side.filters.row_clock import N_CLOCK_TERMS, Phasor, RowClock
from tis.patient_side.linear_system import Array
from tis.patient_side.movement_models import MEANS_S, N_INCREMENTS, N_PARTS, N_TERMS, Correction

LENGTH = 3.5
"""Length of the kernel, in deviations of the inputs."""


def projections(centre: Array, deviation: Array, n_features: int) -> Array:
    """Return F and phi side by side (M, K + 1) for K inputs with these means and deviations.

    They are drawn from a fixed stream, so a model file does without them. Oracle: the Gaussian kernel of `LENGTH`.
    """
    n_inputs = len(centre)
    draws = Stream.named(0, "fourier features").uniforms(0, n_features * (n_inputs + 1))
    normal = ndtri(draws[n_features:]).reshape(n_features, n_inputs)
    frequencies = normal / (LENGTH * deviation)
    phases = 2.0 * np.pi * draws[:n_features] - frequencies @ centre
    return np.hstack([frequencies, phases[:, None]])


N_USED_INCREMENTS = N_PARTS - 2 - SLOW_MEANS
N_MOVEMENT_TERMS = N_TERMS - N_CLOCK_TERMS

_MIN_SPEED = 0.05
"""Speed that differs from rest, in units of the usual one."""
_NEGLIGIBLE = 1e-30


class Movement(NamedTuple):
    """What the correction reads of M rows, in m.

    ``parts`` (M, 7, 3) are all but the forecast move, ``ways`` (M, L, 3) those to all means, the slow ones first.
    """

    parts: Array
    ways: Array
    acceleration: Array

    @property
    def velocity(self) -> Array:
        """The forecast move over a span (M, 3)."""
        return self.parts[:, 0]


def movement_rows(filter_: InnovationsFilter, span: int) -> Array:
    """Return the map (V d, M) from a mean to the correction's vectors.

    They are the parts but the forecast move, the ways that are no parts, and the acceleration.
    """
    assert filter_.past is not None, "a correction reads the recent past"
    d = filter_.n_axes
    now, once, twice = (filter_.hand(min(k * span, filter_.horizon)) for k in (0, 1, 2))
    states = np.eye(filter_.n_past, filter_.n_states)
    increments, ways = states[: d * N_USED_INCREMENTS], states[d * N_INCREMENTS :]
    fast = len(ways) - d * SLOW_MEANS
    return np.vstack([once - now, increments, ways[fast:], ways[:fast], twice - 2.0 * once + now])


def movements(filter_: InnovationsFilter, span: int, means: Array) -> Movement:
    """Return the movement at means, one a row (M, N)."""
    return split(filter_.read(movement_rows(filter_, span), means).reshape(len(means), -1, AXES))


def split(found: Array) -> Movement:
    """Return the movement of vectors (M, V, 3) in the order of `movement_rows`."""
    first = N_PARTS - 1 - SLOW_MEANS
    return Movement(found[:, : N_PARTS - 1], found[:, first:-1], found[:, -1])


def openness(gripper_rad: Array, usual_rad: float, spread_rad: float) -> Array:
    """Return g of gripper angles (M,) of any sign convention: the fitted weights take the sign into account."""
    if spread_rad <= 0:
        return np.zeros(len(gripper_rad))
    return np.asarray(np.tanh((gripper_rad - usual_rad) / spread_rad))


def log_speed(velocity: Array, unit: Array) -> Array:
    """Return x, not yet limited, of velocities (M, 3) with the usual move ``unit`` (M,)."""
    return np.asarray(np.log(np.sqrt(np.sum(velocity**2, axis=1)) / np.maximum(unit, _NEGLIGIBLE) + _MIN_SPEED))


def movement_terms(moved: Movement, x: Array, g: Array) -> Array:
    """Return the terms (M, 7) of speed, braking and gripper. Oracle: `LagCorrection.position`."""
    v, a = moved.velocity, moved.acceleration
    b = np.sum(v * a, axis=1) / np.sqrt(np.sum(v * v, axis=1) * np.sum(a * a, axis=1) + _NEGLIGIBLE)
    powers = np.stack([np.ones_like(x), x, x * x], axis=1)
    return np.hstack([powers, b[:, None] * powers, g[:, None]])


def compressed(ways: Array, unit: Array, widths: Array, x: Array, g: Array) -> Array:
    """Return the Fourier features' inputs f (M, 3 L + 2) from the ways (M, L, 3)."""
    limited = np.tanh(ways / (widths[:, None] * unit[:, None, None]))
    return np.hstack([limited.reshape(len(ways), -1), x[:, None], g[:, None]])


def largest_increment(moved: Movement, unit: Array) -> Array:
    """Return the largest of the last three increments (M,) in units of the usual move."""
    increments = moved.parts[:, 1 : 1 + N_USED_INCREMENTS]
    return np.asarray(np.sqrt(np.max(np.sum(increments**2, axis=2), axis=1)) / np.maximum(unit, _NEGLIGIBLE))


def fade(increment: Array, largest: float) -> Array:
    """Return the share (M,) of the coefficients' correction: 1, beyond the ``largest`` increment ever less."""
    return np.asarray(np.square(largest / np.maximum(increment, largest)))


class Seen(NamedTuple):
    """What the heads make of the newest sample: features (M,) of both, and s, also times the movement's axes (9,)."""

    of_movement: NDArray[np.float32]
    of_base: NDArray[np.float32]
    axes_m: tuple[float, ...]
    size_m: float


class LagCorrection(NamedTuple):
    """The correction at one lag: the map from a mean to its vectors, and the weights, interpolated to the lag.

    ``fourier`` is None where the features have no weight, ``heads`` are the weights of the heads' features.
    """

    rows: Array
    weights: Array
    fourier: Array | None
    heads: tuple[NDArray[np.float32], ...]
    of: "CorrectionForecasts"

    def position(
        self, mean: Array, activity: float, gripper_rad: float | None, phasor: Phasor, seen: Seen | None = None
    ) -> Array:
        """Return the forecast (3,) from a mean (M, 3/d), and from what the heads have ``seen``, if anything."""
        # Plain numbers: on so few of them Python is faster than numpy.
        of = self.of
        model = of.model
        vectors = self.rows.dot(mean).reshape(-1)
        numbers = vectors.tolist()
        vx, vy, vz, ix, iy, iz, jx, jy, jz, kx, ky, kz = numbers[_VELOCITY:_SLOW]
        ax, ay, az = numbers[_ACCELERATION:_SCALED]
        scale = sqrt(activity) if activity > _NEGLIGIBLE else sqrt(_NEGLIGIBLE)
        unit = model.usual_m * scale
        vv = vx * vx + vy * vy + vz * vz
        b = (vx * ax + vy * ay + vz * az) / sqrt(vv * (ax * ax + ay * ay + az * az) + _NEGLIGIBLE)
        x = log(sqrt(vv) / unit + _MIN_SPEED)
        if x < model.lowest:
            x = model.lowest
        elif x > model.highest:
            x = model.highest
        g = 0.0
        if gripper_rad is not None and model.gripper_spread_rad > 0.0:
            g = tanh((gripper_rad - model.gripper_usual_rad) / model.gripper_spread_rad)
        # The coefficients at this state of the movement, and the sum of the parts they weigh.
        bx = b * x
        terms = [1.0, x, x * x, b, bx, bx * x, g]
        if of.clock is not None:
            terms += of.clock.terms(phasor)
        coefficients = self.weights.dot(terms)
        square = max(ix * ix + iy * iy + iz * iz, jx * jx + jy * jy + jz * jz, kx * kx + ky * ky + kz * kz)
        allowed = (model.largest * unit) ** 2
        if square > allowed:
            coefficients = of.linear + (coefficients - of.linear) * (allowed / square)
        position = coefficients.dot(vectors[:_FAST].reshape(N_PARTS + 1, AXES))
        if self.fourier is not None:
            # The Fourier features.
            ways = vectors[_SCALED:] * (1.0 / scale)
            inputs = np.empty(len(ways) + 3)
            np.tanh(ways, out=inputs[:-3])
            inputs[-3] = x
            inputs[-2] = g
            inputs[-1] = 1.0
            features = of.projections.dot(inputs)
            position += self.fourier.dot(np.cos(features, out=features)) * scale
        return np.asarray(position if seen is None else self._with_heads(position.tolist(), seen))

    def _with_heads(self, position: list[float], seen: Seen) -> list[float]:
        of_movement, of_base = self.heads
        u, v, w = of_movement.dot(seen.of_movement).tolist()
        ux, uy, uz, vx, vy, vz, wx, wy, wz = seen.axes_m
        px, py, pz = position
        x, y, z = of_base.dot(seen.of_base).tolist()
        s = seen.size_m
        return [
            px + u * ux + v * vx + w * wx + x * s,
            py + u * uy + v * vy + w * wy + y * s,
            pz + u * uz + v * vz + w * wz + z * s,
        ]


_VELOCITY = 2 * AXES
_SLOW = _VELOCITY + (1 + N_USED_INCREMENTS) * AXES
_FAST = _SLOW + SLOW_MEANS * AXES
_ACCELERATION = _SLOW + len(MEANS_S) * AXES
_SCALED = _ACCELERATION + AXES


@dataclass(frozen=True, eq=False)
class CorrectionForecasts:
    """The corrections of a filter's forecasts: weights for every number of samples (H + 2).

    The vectors are, in this order: position, forecast move, velocity, increments, ways to slow and to fast means,
    acceleration, and the ways again in the features' units. The position counts as a part with the coefficient 1;
    ``linear`` are the coefficients without a correction. ``projections`` include the phases, ``fourier`` the unit.
    ``rows`` map a mean to the vectors, all but the forecast move, which they leave to a `LagCorrection`.
    """

    model: Correction
    clock: RowClock | None
    linear: Array
    projections: Array
    weights: Array
    fourier: Array
    heads: tuple[NDArray[np.float32], ...]
    rows: Array

    @classmethod
    def of(cls, model: Correction, filter_: InnovationsFilter) -> "CorrectionForecasts":
        """Return the tables: linear between the horizons of ``model``, constant beyond the last.

        Within the first sample truth and move are linear: the move's coefficient is constant, all others rise from 0.
        """
        clock = clock_of(model)
        n_terms = N_TERMS if clock is not None else N_MOVEMENT_TERMS
        of_parts = _table(model.horizons, model.weights[:, :, :n_terms], filter_.horizon)
        of_parts[0] = 0.0
        of_parts[0, 0] = of_parts[1, 0]
        weights = np.concatenate([np.zeros_like(of_parts[:, :1]), of_parts], axis=1)
        weights[:, :2, 0] += 1.0
        fourier = _table(model.horizons, model.usual_m * model.fourier, filter_.horizon)
        moved = movement_rows(filter_, model.span)
        d, position = filter_.n_axes, filter_.output(0)
        ways = moved[(1 + N_USED_INCREMENTS) * d : -d] / np.repeat(model.widths * model.usual_m, d)[:, None]
        rows = np.vstack([position, np.zeros_like(position), moved, ways])
        linear = np.zeros(N_PARTS + 1)
        linear[:2] = 1.0
        drawn = projections(model.centre, model.deviation, model.fourier.shape[2])
        tables = (_table(model.horizons, each.weights, filter_.horizon) for each in model.heads)
        heads = tuple(each.astype(np.float32) for each in tables)
        return cls(model, clock, linear, drawn, weights, fourier, heads, rows)

    def at(self, weights: Array, steps: int, fraction: float) -> LagCorrection:
        """Return the correction of the forecast of ``weights`` (d, M), ``steps + fraction`` samples ahead."""
        rows = self.rows.copy()
        d = len(weights)
        rows[d : 2 * d] = weights - rows[:d]
        here, there = 1.0 - fraction, fraction
        of_parts = here * self.weights[steps] + there * self.weights[steps + 1]
        of_features = here * self.fourier[steps] + there * self.fourier[steps + 1]
        heads = tuple(here * each[steps] + there * each[steps + 1] for each in self.heads)
        return LagCorrection(rows, of_parts, of_features if np.any(of_features) else None, heads, self)


def clock_of(model: Correction) -> RowClock | None:
    """Return the tracker of the clock behind the rows; None where they are even."""
    return RowClock(model.clock, model.usual_m / model.span) if model.clock > 0.0 else None


def _table(horizons: Array, values: Array, horizon: int) -> Array:
    """Return values (H, ...) interpolated to 0 .. horizon + 1 samples, from 0 at 0."""
    knots = np.concatenate([[0.0], horizons])
    at = np.interp(np.arange(horizon + 2), knots, np.arange(len(knots)))
    before = np.minimum(at.astype(int), len(horizons) - 1)
    share = (at - before).reshape(-1, *[1] * (values.ndim - 1))
    padded = np.concatenate([np.zeros_like(values[:1]), values])
    return np.asarray((1.0 - share) * padded[before] + share * padded[before + 1])
