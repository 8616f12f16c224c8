"""The response of an arm to its command by least squares: increments on increments, the same in every direction.

Increments know no operating point, and least squares on them no noise but that of the increments: a servo that is
sampled without errors is found exactly, whatever path it takes between the samples. The directions of the command are
those of the arm, in its units, after one gain (3, 3).
"""

from collections.abc import Sequence

import numpy as np

from tis.patient_side.identification.structure import innovation_sizes
from tis.patient_side.identification.trials import Trial
from tis.patient_side.linear_system import Array
from tis.patient_side.movement_models import N_INCREMENTS, ArmResponse

_TURNS = 3
_MAX_MODULUS = 0.9999
_NEGLIGIBLE = 1e-10


def fit_response(trials: Sequence[Trial]) -> ArmResponse | None:
    """Return the response of the outputs (N, 3) to the first three inputs, its noise in m^2; None if it is unstable.

    Gain and coefficients are fitted by turns, trials weighted by the inverse size of their innovations. Oracles in
    test_fit_response: known responses, and a second-order servo.
    """
    pairs = [(u[:, :3], y) for u, y in trials]
    sizes = innovation_sizes([y for _, y in pairs])
    n = N_INCREMENTS
    weighted = zip(pairs, sizes, strict=True)
    centred = [((u - u.mean(axis=0)) / size, (y - y.mean(axis=0)) / size) for (u, y), size in weighted]
    us, ys = (np.concatenate([each[side] for each in centred]) for side in (0, 1))
    gain = np.linalg.lstsq(us, ys, rcond=_NEGLIGIBLE)[0]
    moves = [(np.diff(u, axis=0), np.diff(y, axis=0)) for u, y in centred]
    of_arm = np.concatenate([_lags(dy, 1) for _, dy in moves])
    of_command = np.concatenate([_lags(du, 0) for du, _ in moves])
    targets = np.concatenate([dy[n:] for _, dy in moves])
    for _ in range(_TURNS):
        through = np.einsum("mla,ab->mlb", of_command, gain)
        regressors = np.concatenate([of_arm, through], axis=1).transpose(0, 2, 1).reshape(-1, 2 * n + 1)
        found = np.linalg.lstsq(regressors, targets.ravel(), rcond=_NEGLIGIBLE)[0]
        own, command = found[:n], found[n:]
        rest = targets - np.einsum("mla,l->ma", of_arm, own)
        gain = np.linalg.lstsq(np.einsum("mla,l->ma", of_command, command), rest, rcond=_NEGLIGIBLE)[0]
    left = rest - np.einsum("mla,l->ma", of_command, command) @ gain
    companion = np.eye(n, k=-1)
    companion[0] = own
    if np.max(np.abs(np.linalg.eigvals(companion))) > _MAX_MODULUS:
        return None
    noise_m2 = float(np.mean(left**2) * np.mean(np.square(sizes)))
    return ArmResponse(np.ascontiguousarray(gain.T), own, command, max(noise_m2, np.finfo(float).tiny))


def _lags(increments: Array, first: int) -> Array:
    """Return the increments (M, L, 3) from ``first`` to the last lag before each of those that are explained."""
    n, length = N_INCREMENTS, len(increments)
    return np.stack([increments[n - lag : length - lag] for lag in range(first, n + 1)], axis=1)
