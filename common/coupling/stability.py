"""Stability of a hand that feels a wall through a delay: the stiffness at which the loop begins to oscillate."""

from collections.abc import Callable
from math import inf, pi, sqrt
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tis.common.servo import servo_transition

_GRID: Final = 4000
_SLOWEST_RAD_S: Final = 0.05
_MOST_N_M: Final = 1e6
Complex = NDArray[np.complex128]


class Limb(NamedTuple):
    """Mass in kg, damping in N s/m and stiffness in N/m that hold a hand, with its device, at what it intends."""

    mass_kg: float
    damping_ns_m: float
    stiffness_n_m: float


class Arm(NamedTuple):
    """A servo's natural frequency in Hz, damping ratio, and mass in kg, which a wall pushes."""

    bandwidth_hz: float
    damping: float
    mass_kg: float


def critical_stiffness(limb: Limb, delay_s: float) -> float:
    """Return the least Ke (N/m) at which ``M s^2 + B s + K + Ke exp(-s tau)`` has a root on the imaginary axis.

    Parameters
    ----------
    limb
        M, B and K of hand and device.
    delay_s
        The loop's delay tau: the round trip, plus half a tick for which the force is held.

    Notes
    -----
    There ``Ke sin(w tau) = B w`` and ``Ke cos(w tau) = M w^2 - K``: the phase of ``M s^2 + B s + K`` plus w tau,
    which grows with w, is an odd multiple of pi, and Ke is the modulus. Oracle: the loop in time, test_stability.
    """
    from scipy.optimize import brentq  # a third of a second, which a side does not need

    mass, damping, stiffness = limb

    def lag(w: float) -> float:
        return float(np.arctan2(damping * w, stiffness - mass * w * w)) + w * delay_s

    least, turn = inf, 0
    while True:
        wanted = (2 * turn + 1) * pi
        high = (wanted + pi) / delay_s
        w = float(brentq(lambda x, wanted=wanted: lag(x) - wanted, 0.0, high, xtol=1e-12))
        modulus = abs(complex(stiffness - mass * w * w, damping * w))
        least = min(least, modulus)
        if mass * w * w > stiffness + least:  # from there on the modulus only grows
            return least
        turn += 1


def loop_limit(limb: Limb, arm: Arm | None, delay_s: float, period_s: float) -> float:
    """Return the least unstable stiffness (N/m) of the whole loop as it is sampled, by Nyquist's criterion.

    Both sides hold what they receive for a tick. ``delay_s`` is the time from a sample of the hand to the tick at
    which the force that answers it is held, without the arm; without an ``arm`` the force follows its set point at
    once.

    Notes
    -----
    ``L = Ke G H exp(-j w d)`` with the exact sampled responses G of the hand to its force and H of the arm to its set
    point; the phase falls with w, so the loop is stable while ``|L| < 1`` wherever L is real and negative. Oracles:
    `critical_stiffness` at short ticks, and the largest eigenvalue of the sampled loop, test_stability.
    """
    w = np.geomspace(_SLOWEST_RAD_S, 0.999 * pi / period_s, _GRID)
    hand = _response(limb, w, period_s) * np.exp(-1j * w * delay_s)

    def most(stiffness_n_m: float) -> float:
        """Return the largest modulus of L where it is real and negative."""
        loop = stiffness_n_m * hand * (1.0 if arm is None else _arm_response(arm, stiffness_n_m, w, period_s))
        phase = np.unwrap(np.angle(loop))
        turns = np.floor((phase + pi) / (2.0 * pi))
        at = np.flatnonzero(np.diff(turns))
        share = (np.maximum(turns[at], turns[at + 1]) * 2.0 * pi - pi - phase[at]) / (phase[at + 1] - phase[at])
        log = np.log(np.abs(loop))
        return float(np.exp(log[at] + share * (log[at + 1] - log[at])).max(initial=0.0))

    return _first_above_one(most)


def _first_above_one(most: Callable[[float], float]) -> float:
    """Return the least stiffness at which ``most`` reaches 1; infinity where it does not within reason."""
    from scipy.optimize import brentq  # a third of a second, which a side does not need

    grid = np.geomspace(0.1, _MOST_N_M, 140)
    below = float(grid[0])
    for above in grid[1:].tolist():
        if most(above) >= 1.0:
            return float(brentq(lambda k: most(k) - 1.0, below, above, rtol=1e-6)) if most(below) < 1.0 else below
        below = above
    return inf


def _response(limb: Limb, w: NDArray[np.float64], period_s: float) -> Complex:
    """Return the position per N at the ticks, for a force that is held for a tick."""
    mass, damping, stiffness = limb
    natural = sqrt(stiffness / mass)
    move = servo_transition(natural / (2.0 * pi), damping / (2.0 * mass * natural), period_s)
    return _sampled(move, w, period_s) / stiffness


def _arm_response(arm: Arm, stiffness_n_m: float, w: NDArray[np.float64], period_s: float) -> Complex:
    """Return the arm's position in contact per m of its set point, which is held for a tick."""
    natural = 2.0 * pi * arm.bandwidth_hz
    touching = sqrt(natural**2 + stiffness_n_m / arm.mass_kg)
    move = servo_transition(touching / (2.0 * pi), arm.damping * natural / touching, period_s)
    return _sampled(move, w, period_s) * (natural / touching) ** 2


def _sampled(move: NDArray[np.float64], w: NDArray[np.float64], period_s: float) -> Complex:
    """Return the response at the ticks of a servo with this transition (2, 2) to its held reference."""
    z: Complex = np.exp(1j * w * period_s)
    (a, b), (c, d) = move.tolist()
    # (zI - A)^-1 (I - A) [1, 0]', first row
    determinant = (z - a) * (z - d) - b * c
    return np.asarray(((z - d) * (1.0 - a) - b * c) / determinant, dtype=np.complex128)
