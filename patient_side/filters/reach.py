"""The phase of a reach: a correction of the linear forecast by the hand's speed, braking and gripper.

Hands move in reaches with a bell-shaped speed (Flash and Hogan 1985, J. Neuroscience 5:1688), and longer reaches are
faster (isochrony: Viviani and McCollum 1983). A fast hand is therefore in the middle of a long reach, a slow one at
the beginning or end of one; its acceleration separates the first half from the second. A linear model ignores the
phase. Three parts of its forecast therefore get coefficients that vary with it (Hastie and Tibshirani 1993,
"Varying-coefficient models", J. R. Stat. Soc. B 55:757):

    p[h] = y + (1 + c_1) d[h] + c_2 v + c_3 l,   c_i = w_i[h] . (1, x, x^2, b, b x, b x^2, g)

with the move d that the model forecasts, the velocity v and the distance l to the level; x is the logarithm of the
speed in units of the hand's usual one, limited to the range of the training rows, and b the cosine between
acceleration and velocity: 1 at the beginning of a straight reach, -1 at its end. No direction is preferred. The last
term is the opening of the gripper: a hand opens on its way to a grasp, and moves differently with an object
(transport and aperture of prehension: Jeannerod 1984, J. Motor Behavior 16:235). g lies between -1 and 1; it is 0 at
the usual opening and for an unknown gripper.
"""

from dataclasses import dataclass
from math import log, sqrt, tanh
from typing import NamedTuple

import numpy as np

from patient_side.filters.innovations_filter import AXES, InnovationsFilter
from patient_side.statespace import Array, Reach

N_PARTS = 3
N_TERMS = 7
"""Terms of a coefficient: three powers of x, with and without b, and the opening."""

_MIN_SPEED = 0.05
"""Speed that differs from rest, in units of the usual one."""
_NEGLIGIBLE = 1e-30

Coefficients = tuple[float, ...]
"""Weights of the terms, part by part (21)."""


class Phase(NamedTuple):
    """Velocity and acceleration (M, 3) in m per span, distance to the level (M, 3), speed (M,) in usual ones."""

    velocity: Array
    acceleration: Array
    to_level: Array
    speed: Array


def phases(filter_: InnovationsFilter, span: int, means: Array, activity: Array, usual_m: float) -> Phase:
    """Return the phases at means (M, N); ``activity`` (M,) scales the innovations' variances there."""
    rows = _phase_rows(filter_, span)
    parts = (means @ rows.T).reshape(len(means), N_PARTS, AXES)
    velocity = parts[:, 0]
    speed = np.sqrt(np.sum(velocity**2, axis=1) / np.maximum(activity, _NEGLIGIBLE)) / usual_m
    return Phase(velocity, parts[:, 2], parts[:, 1], speed)


def openness(gripper_rad: Array, usual_rad: float, spread_rad: float) -> Array:
    """Return g of gripper angles (M,) of any sign convention: the fitted weights take the sign into account."""
    if spread_rad <= 0:
        return np.zeros(len(gripper_rad))
    return np.asarray(np.tanh((gripper_rad - usual_rad) / spread_rad))


def log_speed(speed: Array) -> Array:
    """Return x of speeds (M,)."""
    return np.asarray(np.log(speed + _MIN_SPEED))


def terms(phase: Phase, opening: Array, lowest: float, highest: float) -> Array:
    """Return the terms (M, 7) of coefficients; ``opening`` (M,) is g. Oracle: `Bend.position`."""
    x = np.clip(log_speed(phase.speed), lowest, highest)
    v, a = phase.velocity, phase.acceleration
    b = np.sum(v * a, axis=1) / np.sqrt(np.sum(v * v, axis=1) * np.sum(a * a, axis=1) + _NEGLIGIBLE)
    powers = np.stack([np.ones_like(x), x, x * x], axis=1)
    return np.hstack([powers, b[:, None] * powers, opening[:, None]])


class Bend(NamedTuple):
    """The correction at one lag: the map (15, N) from a mean to d, v, l, acceleration and y, and coefficients."""

    rows: Array
    coefficients: Coefficients
    reach: Reach

    def position(self, mean: Array, activity: float, gripper_rad: float | None) -> Array:
        """Return the forecast (3,) from a mean (N,)."""
        # Plain numbers: on so few of them Python is faster than numpy. First the phase x, b, g of the reach.
        reach = self.reach
        dx, dy, dz, vx, vy, vz, lx, ly, lz, ax, ay, az, px, py, pz = self.rows.dot(mean).tolist()
        vv = vx * vx + vy * vy + vz * vz
        b = (vx * ax + vy * ay + vz * az) / sqrt(vv * (ax * ax + ay * ay + az * az) + _NEGLIGIBLE)
        x = log(sqrt(vv / (activity if activity > _NEGLIGIBLE else _NEGLIGIBLE)) / reach.usual_m + _MIN_SPEED)
        if x < reach.lowest:
            x = reach.lowest
        elif x > reach.highest:
            x = reach.highest
        if gripper_rad is None or reach.gripper_spread_rad <= 0.0:
            g = 0.0
        else:
            g = tanh((gripper_rad - reach.gripper_usual_rad) / reach.gripper_spread_rad)
        # The three coefficients at this phase, and the sum of the parts they weigh.
        d0, d1, d2, d3, d4, d5, d6, v0, v1, v2, v3, v4, v5, v6, l0, l1, l2, l3, l4, l5, l6 = self.coefficients
        d = d0 + x * (d1 + x * d2) + b * (d3 + x * (d4 + x * d5)) + g * d6
        v = v0 + x * (v1 + x * v2) + b * (v3 + x * (v4 + x * v5)) + g * v6
        l = l0 + x * (l1 + x * l2) + b * (l3 + x * (l4 + x * l5)) + g * l6  # noqa: E741  as in the equation
        return np.array((px + d * dx + v * vx + l * lx, py + d * dy + v * vy + l * ly, pz + d * dz + v * vz + l * lz))


@dataclass(frozen=True, eq=False)
class ReachForecasts:
    """The corrections of a filter's forecasts by a `Reach`: coefficients for every number of samples (H + 2, 21)."""

    reach: Reach
    table: Array
    rows: Array

    @classmethod
    def of(cls, reach: Reach, filter_: InnovationsFilter) -> "ReachForecasts":
        """Return the table: linear between the horizons of ``reach``, constant beyond the last.

        Within the first sample truth and move are linear: the move's coefficient is constant, the others rise from 0.
        """
        steps, knots = np.arange(filter_.horizon + 2), np.concatenate([[0.0], reach.horizons])
        flat = reach.weights.reshape(len(reach.horizons), -1)
        flat = np.vstack([flat[0], flat])
        flat[0, N_TERMS:] = 0.0
        table = np.stack([np.interp(steps, knots, column) for column in flat.T], axis=1)
        table[:, 0] += 1.0
        position = _now(filter_)
        rows = np.vstack([np.zeros_like(position), _phase_rows(filter_, reach.span), position])
        return cls(reach, table, rows)

    def bend(self, weights: Array, steps: int, fraction: float) -> Bend:
        """Return the correction of the forecast of ``weights`` (3, N), ``steps + fraction`` samples ahead."""
        rows = self.rows.copy()
        rows[:AXES] = weights
        rows[:AXES] -= rows[-AXES:]
        coefficients = (1.0 - fraction) * self.table[steps] + fraction * self.table[steps + 1]
        return Bend(rows, tuple(coefficients.tolist()), self.reach)


def _now(filter_: InnovationsFilter) -> Array:
    """Return the map (3, N) from a mean to the present position."""
    rows = np.zeros((AXES, len(filter_.one_step)))
    rows[:, -AXES:] = np.eye(AXES)
    return rows


def _phase_rows(filter_: InnovationsFilter, span: int) -> Array:
    """Return the map (9, N) from a mean to velocity, distance to the level and acceleration of its own forecast."""
    now = _now(filter_)
    once, twice = (filter_.outputs[min(k * span, filter_.horizon)] for k in (1, 2))
    to_level = np.zeros_like(now)
    if filter_.level is not None:
        to_level = filter_.level - now
    return np.vstack([once - now, to_level, twice - 2.0 * once + now])
