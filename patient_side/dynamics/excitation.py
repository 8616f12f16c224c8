"""Movements that show the arm's dynamics: sums of sines within the joints' limits."""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from tis.common.streams import Stream
from tis.patient_side.dynamics.parameters import N_PARAMETERS, regressor
from tis.patient_side.linear_system import Array
from tis.patient_side.plant.arm_geometry import HIGH, LOW, N_JOINTS

PERIOD_S: Final = 10.0
HARMONICS: Final = 15
"""Frequencies from 0.1 to 1.5 Hz."""
MAX_SPEED: Final = np.array([1.5, 1.5, 0.25, 4.0, 4.0, 4.0, 4.0])
"""Largest speeds (7,) of the joints, in rad/s, of the insertion in m/s."""
_TRAVEL: Final = 0.8
"""Share of a joint's travel that a movement may use."""
_CANDIDATES: Final = 12
_CONDITION_HZ: Final = 20


def excitation(stream: Stream, independent: NDArray[np.int64], rate_hz: int, duration_s: float) -> Array:
    """Return set points (N, 7) at ``rate_hz``: of several random movements the one that tells the most.

    Each joint makes a periodic movement, a finite Fourier series with random coefficients, as large as its travel and
    its speed allow (Swevers et al., "Optimal robot excitation and identification", IEEE T-RA 13(5), 1997). The
    candidate whose regressor of base parameters, with columns of equal length, has the least condition number is
    taken. Oracle: limits and periodicity, test_excitation.
    """
    per_joint = 2 * HARMONICS + 2
    draws = stream.uniforms(0, _CANDIDATES * N_JOINTS * per_joint).reshape(_CANDIDATES, N_JOINTS, per_joint)
    t_s = np.arange(int(PERIOD_S * _CONDITION_HZ)) / _CONDITION_HZ
    conditions = [_condition(fourier(one, t_s), independent) for one in draws]
    best = draws[int(np.argmin(conditions))]
    return fourier(best, np.arange(int(duration_s * rate_hz)) / rate_hz)


def fourier(draws: Array, t_s: Array) -> Array:
    """Return the movement (N, 7) of uniforms (7, 2 * HARMONICS + 2) at times (N,)."""
    found = np.empty((len(t_s), N_JOINTS))
    w = 2.0 * np.pi * np.arange(1, HARMONICS + 1) / PERIOD_S
    for i in range(N_JOINTS):
        sines, cosines = (2.0 * draws[i, :-2] - 1.0).reshape(2, HARMONICS)
        fine_s = np.linspace(0.0, PERIOD_S, 1000)
        shape = np.sin(np.outer(fine_s, w)) @ sines + np.cos(np.outer(fine_s, w)) @ cosines
        speed = np.cos(np.outer(fine_s, w)) @ (w * sines) - np.sin(np.outer(fine_s, w)) @ (w * cosines)
        room = _TRAVEL * (HIGH[i] - LOW[i]) / 2.0
        share = 0.6 + 0.4 * draws[i, -1]
        scale = share * min(room / np.abs(shape).max(), MAX_SPEED[i] / np.abs(speed).max())
        # the centre takes what the amplitude leaves
        centre = (LOW[i] + HIGH[i]) / 2.0 + (2.0 * draws[i, -2] - 1.0) * (room - scale * np.abs(shape).max())
        found[:, i] = centre + scale * (np.sin(np.outer(t_s, w)) @ sines + np.cos(np.outer(t_s, w)) @ cosines)
    return found


def _condition(joints: Array, independent: NDArray[np.int64]) -> float:
    velocity = np.gradient(joints, 1.0 / _CONDITION_HZ, axis=0)
    acceleration = np.gradient(velocity, 1.0 / _CONDITION_HZ, axis=0)
    stacked = regressor(joints, velocity, acceleration).reshape(-1, N_PARAMETERS)[:, independent]
    lengths = np.maximum(np.linalg.norm(stacked, axis=0), 1e-12)
    return float(np.linalg.cond(stacked / lengths))
