"""The paper's empirical Q and R: covariances of the residuals of a first run of its filter.

The four steps of its section "Empirical Estimation of Q and R":

1. ``Q = epsilon_q I`` and ``R = epsilon_r I``;
2. a run of the filter over the training rows, by the paper's prediction and update equations: the measurement is
   ``z = C x``, without D, and the state is driven by ``u[k-1]``;
3. ``r_y[k] = y[k] - C x[k]`` and ``r_x[k] = x[k] - A x[k-1] - B u[k]``, x being the updated estimates;
4. ``R = 1/N sum r_y r_y'`` over N rows, ``Q = 1/(N-1) sum r_x r_x'`` over the N - 1 steps, means not removed.

Its r_x takes ``u[k]`` where its own filter takes ``u[k-1]``; that is kept (it changes the root of Q's trace by
less than 1 % on real trials, with equal epsilons). Values that it leaves open are those of Algorithm 1: x = 0 and
P = I at the first row, which is not assimilated.
"""

from collections.abc import Sequence

import numpy as np

from common.errors import DataError, Fault
from patient_side.identification.trials import Trial
from patient_side.statespace import Array, NoiseModel, StateSpace


def first_run(space: StateSpace, u: Array, y: Array, epsilon_q: float, epsilon_r: float) -> Array:
    """Return the updated state estimates (N, n) of the first run over inputs (N, m) and outputs (N, p).

    Raises `DataError` where it diverges, as it can with a model of many states that is far from stable. Oracles in
    test_paper_noise: filterpy's filter, and three samples worked by hand.
    """
    from patient_side.filters.kalman_update import joseph_update, kalman_predict  # loads filterpy, as in the registry

    C, n = space.C, space.order
    Q, R = epsilon_q * np.eye(n), epsilon_r * np.eye(space.n_outputs)
    drive = u @ space.B.T
    states, P = np.zeros((len(u), n)), np.eye(n)
    with np.errstate(over="ignore", invalid="ignore"):
        for k in range(1, len(u)):
            x, P = kalman_predict(states[k - 1], P, space.A, Q, drive[k - 1])
            if not np.all(np.isfinite(P)):
                raise DataError(_diverged(space))
            # Not the gain of `kalman_update`: far from convergence rounding can make the inverted matrix singular.
            K = P @ C.T @ np.linalg.pinv(C @ P @ C.T + R, hermitian=True)
            # Joseph's form of the paper's (I - K C) P, which loses symmetry and then diverges where A is unstable.
            states[k], P = joseph_update(x, P, y[k], C, R, K)
    return states


def _diverged(space: StateSpace) -> Fault:
    rule = f"the first run for Q and R diverges, spectral radius {space.spectral_radius():.4g}: choose a lower order"
    return Fault("identification", "order", rule, space.order)


def empirical_noise(space: StateSpace, trials: Sequence[Trial], epsilon_q: float, epsilon_r: float) -> NoiseModel:
    """Return the paper's empirical Q (n, n) and R (p, p) in the units of the trials; its S is zero.

    The paper has one trial; of several, the sums are pooled, each with its own first run. Raises `DataError` where
    that diverges.
    """
    Q, R = np.zeros((space.order, space.order)), np.zeros((space.n_outputs, space.n_outputs))
    for u, y in trials:
        states = first_run(space, u, y, epsilon_q, epsilon_r)
        r_y = y - states @ space.C.T
        r_x = states[1:] - states[:-1] @ space.A.T - u[1:] @ space.B.T
        R += r_y.T @ r_y
        Q += r_x.T @ r_x
    n_rows = sum(len(u) for u, _ in trials)
    if not (np.all(np.isfinite(Q)) and np.all(np.isfinite(R))):
        raise DataError(_diverged(space))
    Q, R = Q / (n_rows - len(trials)), R / n_rows
    return NoiseModel((Q + Q.T) / 2, (R + R.T) / 2, np.zeros((space.order, space.n_outputs)))
