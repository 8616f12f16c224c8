"""The clock behind the rows of a recording: its phase, tracked by a phasor.

A recorder that takes rows at one rate from a source at another, each time the newest sample, leaves rows that are
unevenly spaced in time. Rows of 30 Hz from a source of 51.3 Hz are two source samples apart, but every third or
fourth time only one: the increment is then half as large as its neighbours. All recorded trials that were looked at
(JIGSAWS) have this pattern. It repeats with a fixed frequency, in cycles per row, so that its phase tells how far the
next rows are from this one.

The evidence of a row is the relative excess of its increment over the mean of the last four, along that mean. A
phasor sums it up, turned back by the clock's frequency and forgotten over 300 rows: its angle is the phase, its size
the confidence. Rest gives no evidence, and a missing row only turns the phasor.
"""

import cmath
from dataclasses import dataclass, field
from math import pi

import numpy as np

from tis.patient_side.filters.recursion import filtered
from tis.patient_side.linear_system import Array
from tis.patient_side.movement_models import N_INCREMENTS

N_HARMONICS = 4
N_CLOCK_TERMS = 2 * N_HARMONICS

Phasor = tuple[complex, float]
"""Sum of the evidence, and of its weights."""

NO_PHASE: Phasor = (0j, 0.0)

_KEPT = 1.0 - 1.0 / 300.0
"""Share of the evidence that is left after a row: 10 s at 30 Hz."""
_AT_REST = 0.15
"""Speed that gives half its evidence, in units of the usual one."""
_PRIOR_ROWS = 3.0
_CONFIDENT = 0.1
"""Mean evidence that is fully believed: a pattern of single and double steps has 0.12."""


@dataclass(frozen=True)
class RowClock:
    """The tracker of a clock with ``frequency`` cycles a row; ``usual_m`` is the hand's usual increment."""

    frequency: float
    usual_m: float
    turn: complex = field(init=False, repr=False)
    rest_m2: float = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "turn", _KEPT * cmath.exp(2j * pi * self.frequency))
        object.__setattr__(self, "rest_m2", (_AT_REST * self.usual_m) ** 2)

    def after(self, phasor: Phasor, gap: int, increments: list[float], activity: float) -> Phasor:
        """Return the phasor ``gap`` rows later, given the last increments (12 numbers, newest first) of an even row.

        Without increments, as after missing rows, it only turns.
        """
        total, weight = phasor
        if gap == 1:
            total *= self.turn
            weight *= _KEPT
        else:
            total *= self.turn**gap
            weight *= _KEPT**gap
        if increments:
            excess, share = _evidence(increments, activity * self.rest_m2)
            return total + excess, weight + share
        return total, weight

    def terms(self, phasor: Phasor) -> list[float]:
        """Return cosine and sine of the phase and its harmonics (8), times the confidence."""
        total, weight = phasor
        size = abs(total)
        if size == 0.0:
            return [0.0] * N_CLOCK_TERMS
        one = total / size
        believed = min(1.0, size / ((weight + _PRIOR_ROWS) * _CONFIDENT))
        first = believed * one
        second = first * one
        third = second * one
        fourth = third * one
        return [
            first.real,
            first.imag,
            second.real,
            second.imag,
            third.real,
            third.imag,
            fourth.real,
            fourth.imag,
        ]


def _evidence(increments: list[float], rest_m2: float) -> tuple[float, float]:
    """Return the weighted excess of the newest increment over the mean of all, and the weight, 0 at rest."""
    x, y, z, x1, y1, z1, x2, y2, z2, x3, y3, z3 = increments
    mx, my, mz = (x + x1 + x2 + x3) / 4, (y + y1 + y2 + y3) / 4, (z + z1 + z2 + z3) / 4
    square = mx * mx + my * my + mz * mz
    whole = square + rest_m2
    if whole <= 0.0:
        return 0.0, 0.0
    excess = (x * mx + y * my + z * mz - square) / whole
    if excess > 1.0:
        excess = 1.0
    elif excess < -1.0:
        excess = -1.0
    return excess, square / whole


def evidence_of(increments: Array, activity: Array, usual_m: float) -> tuple[Array, Array]:
    """Return excess and weight of rows (M,) with increments (M, 12), newest first. Oracle: `RowClock.after`."""
    each = increments.reshape(len(increments), N_INCREMENTS, -1)
    mean = each.mean(axis=1)
    square = np.sum(mean**2, axis=1)
    whole = square + activity * (_AT_REST * usual_m) ** 2
    moving = whole > 0.0
    excess = np.divide(np.sum(each[:, 0] * mean, axis=1) - square, whole, out=np.zeros_like(whole), where=moving)
    return np.clip(excess, -1.0, 1.0), np.divide(square, whole, out=np.zeros_like(whole), where=moving)


def terms_of(clock: RowClock, increments: Array, activity: Array) -> Array:
    """Return the terms (M, 8) at each row of an unbroken recording with increments (M, 12), newest first.

    Oracle: `RowClock`, row by row.
    """
    excess, weight = evidence_of(increments, activity, clock.usual_m)
    (total,) = filtered(np.ones(1), np.array([1.0, -clock.turn]), excess[None])
    (weights,) = filtered(np.ones(1), np.array([1.0, -_KEPT]), weight[None])
    confidence = np.abs(total) / ((weights + _PRIOR_ROWS) * _CONFIDENT)
    angles = np.angle(total)[:, None] * np.arange(1, N_HARMONICS + 1)
    both = np.stack([np.cos(angles), np.sin(angles)], axis=2).reshape(len(angles), -1)
    return np.asarray(np.minimum(1.0, confidence)[:, None] * both)
