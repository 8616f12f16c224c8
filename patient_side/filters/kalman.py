"""The Kalman filter of an arm: the model's states, an output bias and the command itself.

The augmented state is ``z = [x (n), b (3), u (3), d (3), r (3)]``:

- x, the model's states about the operating point, ``x[k+1] = A x[k] + B u[k] + w[k]``;
- b, a slow random walk that absorbs errors of the operating point, ``y = C x + D u + b + v``;
- u, the command, and d, its velocity in m per sample: ``d[k+1] = phi d[k] + e[k]`` and
  ``u[k+1] = u[k] + d[k+1] + r[k+1]``;
- r, the velocity at which the command returns to where its forecast began: ``r[k+1] = psi r[k]``, without noise.

Where the command has arrived, u is set to it and is certain. Beyond its newest sample the mean of u is the
damped-velocity forecast, and its error is that of a velocity with noise e, whose variance follows from the error
growth on the training rows. A measurement fresher than the command therefore corrects the command's forecast and not
the bias, and the command's uncertainty enters every covariance (``D Sigma D'``, ``B Sigma B'``) with its
correlations.

Process and measurement noise may be correlated (S, as in the innovations form): given y[k], the transition from k is
``(F - T H) z + T y`` with noise ``Q - T S'``, ``T = S R^-1`` (Anderson and Moore, *Optimal Filtering*, 5.4).

The Kalman filter's two steps: prediction, and the update by a measurement.

For ``x[k+1] = F x[k] + drive[k] + w[k]``, ``y[k] = H x[k] + v[k]`` with covariances Q of w and R of v:

    prediction   x <- F x + drive,            P <- F P F' + Q
    update       K = P H' (H P H' + R)^-1,    x <- x + K (y - H x),   P <- (I - K H) P (I - K H)' + K R K'

The covariance update is Joseph's form, which holds for any gain and keeps P symmetric and positive semidefinite
where ``(I - K H) P`` loses both by rounding (Bucy and Joseph 1968; Simon, *Optimal State Estimation*, 5.1).
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

import numpy as np
from filterpy.kalman import KalmanFilter

from tis.patient_side.linear_system import Array, StateSpace
from tis.patient_side.movement_models import InputForecast
from tis.patient_side.statespace import ArmModel

# Every Kalman filter of the patient's side computes this update:
# - here, by filterpy, for `moesp_kf`, `n4sid_kf`, `arx_kf` (through `filters.kalman`) and `paper`;
# - `identification.paper_noise` with `joseph_update` and a gain of its own, a pseudo-inverse: far from convergence
#   H P H' + R can be numerically singular;
# - `InnovationsFilter.gain` in another form: its measurement is the last block of the state, without noise, and P may
#   be one Kronecker factor, a third of the size. Rows, a Cholesky solution and BLAS in place replace the products;
# - `paper_kalman.printed_update` as the paper prints it, channel by channel and with ``(I - K C) P``: a reproduction
#   must round, and diverge, as the printed formula does.


class Gaussian(NamedTuple):
    """A normal distribution: mean (n,) and covariance (n, n)."""

    mean: Array
    covariance: Array


@cache
def _filter(n: int, p: int) -> KalmanFilter:
    """Return filterpy's filter for n states and p outputs. Each step loads its state first, so nothing remains."""
    return KalmanFilter(dim_x=n, dim_z=p)


def kalman_predict(x: Array, P: Array, F: Array, Q: Array, drive: Array | None = None) -> Gaussian:
    """Return the state one step later; ``drive`` (n,) is what a known input adds to it."""
    kf = _filter(len(x), 1)
    kf.x, kf.P = x, P
    kf.predict(F=F, Q=Q)
    return Gaussian(kf.x if drive is None else kf.x + drive, kf.P)


def kalman_update(
    x: Array, P: Array, y: Array, H: Array, R: Array, inverse: Callable[..., Array] = np.linalg.inv
) -> Gaussian:
    """Return the state given a measurement ``y`` (p,) with noise covariance ``R`` (p, p): the Kalman update.

    ``inverse`` inverts the innovation's covariance; for p = 1, `numpy.reciprocal` does not raise after divergence.
    Oracle: the conditional of a joint Gaussian, test_kalman_update.
    """
    kf = _filter(len(x), len(H))
    kf.x, kf.P, kf.inv = x, P, inverse
    kf.update(y, R=R, H=H)
    return Gaussian(kf.x, kf.P)


def joseph_update(x: Array, P: Array, y: Array, H: Array, R: Array, K: Array) -> Gaussian:
    """Return the state given a measurement that enters with the gain ``K`` (n, p), optimal or not."""
    rest = np.eye(len(x)) - K.dot(H)
    return Gaussian(x + K.dot(y - H.dot(x)), rest.dot(P).dot(rest.T) + K.dot(R).dot(K.T))


BIAS_STEP = 0.05
"""Standard deviation of the bias's step from sample to sample, in units of the measurement noise's."""

NOISE_FLOOR_M = 1e-7
"""Minimum standard deviation of the measurement noise: a tenth of the last digit of recorded positions."""


@dataclass(frozen=True)
class AugmentedModel:
    """The matrices of the filter on d = n + 12 states, computed once.

    ``Q`` is the process noise of a step to where the command is known, ``Q_ahead`` of one beyond its newest
    sample. ``F_steps`` and ``Q_steps`` (H + 1, d, d) cover h steps ahead at once; H is the horizon.
    ``input_variance_m2`` (H + 1, 3) is the variance of the command h samples away from the nearest arrived one.
    """

    F: Array
    H: Array
    Q: Array
    Q_ahead: Array
    R: Array
    S: Array
    T: Array
    F_measured: Array
    F_steps: Array
    Q_steps: Array
    input_variance_m2: Array
    P0: Array
    bias: slice
    command: slice
    velocity: slice
    returning: slice
    velocity_shares: tuple[float, float]

    @property
    def horizon(self) -> int:
        """Return H, the number of samples beyond which nothing is forecast."""
        return len(self.F_steps) - 1


@dataclass(eq=False, slots=True)
class Belief:
    """Mean (d,) and covariance (d, d) of the augmented state; every step below changes both."""

    x: Array
    P: Array


def input_noise(forecast: InputForecast, horizon: int) -> tuple[Array, Array]:
    """Return the variances (m^2) of the velocity's noise e (3,) and the forecast's error (horizon + 1, 3).

    With noise of variance q, the error h samples ahead has ``q sum_i (1 + phi + ... + phi^(i-1))^2``,
    i = 1..h; q is the mean over the known growth within the first fifth of the horizon. Later, a hand that
    comes back is more certain than this sum, and short forecasts must not pay for it. Oracle: the error's covariance,
    propagated.
    """
    reach = np.cumsum(forecast.damping ** np.arange(horizon))
    shape = np.concatenate([[0.0], np.cumsum(reach**2)])
    growth = np.asarray(forecast.growth_m, dtype=float)[: max(1, horizon // 5)]
    noise = np.mean(growth**2 / shape[1 : len(growth) + 1, None], axis=0) if len(growth) else np.zeros(3)
    return noise, shape[:, None] * noise


def _consistent_noise(Q: Array, R: Array, S: Array) -> tuple[Array, Array, Array]:
    """Return the noise model with a positive semidefinite joint covariance and an R of full rank."""
    n = len(Q)
    joint = np.block([[Q, S], [S.T, R]])
    # States may have any unit: eigenvalues are compared in units of the deviations.
    deviation = np.sqrt(np.diag(joint))
    scale = np.outer(*[np.where(deviation > 0, deviation, 1.0)] * 2)
    values, vectors = np.linalg.eigh((joint + joint.T) / 2 / scale)
    if values[0] < 0:
        joint = (vectors * np.maximum(values, 0.0)) @ vectors.T * scale
    R = joint[n:, n:]
    values, vectors = np.linalg.eigh(R)
    if values[0] < NOISE_FLOOR_M**2:
        # Raising R alone keeps the joint covariance positive semidefinite.
        R = (vectors * np.maximum(values, NOISE_FLOOR_M**2)) @ vectors.T
    return joint[:n, :n], R, joint[:n, n:]


def augment(model: ArmModel, horizon: int) -> AugmentedModel:
    """Return the filter's matrices for ``model``; nothing is forecast over more than ``horizon`` samples."""
    space, phi, psi = model.space, model.forecast.damping, model.forecast.persistence
    n = space.order
    size = n + 12
    state, bias, command, velocity = slice(0, n), slice(n, n + 3), slice(n + 3, n + 6), slice(n + 6, n + 9)
    returning = slice(n + 9, size)
    eye = np.eye(3)

    # Transition and measurement.
    F = np.eye(size)
    F[state, state], F[state, command] = space.A, space.B
    F[command, velocity], F[velocity, velocity] = phi * eye, phi * eye
    F[command, returning], F[returning, returning] = psi * eye, psi * eye
    H = np.zeros((3, size))
    H[:, state], H[:, bias], H[:, command] = space.C, eye, space.D

    # Noise: the model's own, the bias's step, and the velocity's beyond the newest command.
    Qx, R, Sx = _consistent_noise(model.noise.Q, model.noise.R, model.noise.S)
    S = np.zeros((size, 3))
    S[state] = Sx
    T = np.asarray(np.linalg.solve(R, S.T).T, dtype=float)
    noise, variance = input_noise(model.forecast, horizon)
    Q = np.zeros((size, size))
    Q[state, state], Q[bias, bias] = Qx, BIAS_STEP**2 * R
    Q_ahead = Q.copy()
    Q_ahead[n + 3 : n + 9, n + 3 : n + 9] = np.tile(np.diag(noise), (2, 2))

    # Before the first sample: b and u anywhere in the output's range, d as it is after a long time.
    span_m2 = np.maximum(model.output_high_m - model.output_low_m, NOISE_FLOOR_M) ** 2
    P0 = np.zeros((size, size))
    P0[state, state] = _reachable(space, Qx, variance[-1], horizon)
    P0[bias, bias] = P0[command, command] = np.diag(span_m2)
    P0[velocity, velocity] = np.diag(noise / max(1.0 - phi**2, 1.0 / horizon))

    F_steps, Q_steps = _steps_at_once(F, Q_ahead, horizon)
    return AugmentedModel(
        F=F,
        H=H,
        Q=Q,
        Q_ahead=Q_ahead,
        R=R,
        S=S,
        T=T,
        F_measured=F - T @ H,
        F_steps=F_steps,
        Q_steps=Q_steps,
        input_variance_m2=variance,
        P0=P0,
        bias=bias,
        command=command,
        velocity=velocity,
        returning=returning,
        velocity_shares=model.forecast.velocities(),
    )


def _reachable(space: StateSpace, Q: Array, input_variance_m2: Array, horizon: int) -> Array:
    """Return the covariance (n, n) that noise and forecast errors give the model's states over the horizon."""
    P, drive = np.zeros_like(Q), Q + space.B @ np.diag(input_variance_m2) @ space.B.T
    for _ in range(horizon):
        P = space.A @ P @ space.A.T + drive
    return P


def _steps_at_once(F: Array, Q: Array, horizon: int) -> tuple[Array, Array]:
    """Return transition and noise (horizon + 1, d, d) of 0 .. ``horizon`` steps taken at once."""
    F_steps, Q_steps = np.empty((horizon + 1, *F.shape)), np.zeros((horizon + 1, *F.shape))
    F_steps[0] = np.eye(len(F))
    for h in range(1, horizon + 1):
        F_steps[h] = F @ F_steps[h - 1]
        Q_steps[h] = F @ Q_steps[h - 1] @ F.T + Q
    return F_steps, Q_steps


def initial_belief(model: AugmentedModel) -> Belief:
    """Return the belief before the first sample: mean zero and the initial covariance."""
    return Belief(np.zeros(len(model.F)), model.P0.copy())


def predict(belief: Belief, model: AugmentedModel, output: Array | None, ahead: bool) -> None:
    """Predict one step, given y (3,) where it begins if measured; ``ahead``: beyond the newest command.

    Oracles: one-shot conditioning of the joint Gaussian, and the discrete algebraic Riccati equation.
    """
    Q = model.Q_ahead if ahead else model.Q
    if output is None:
        belief.x, belief.P = kalman_predict(belief.x, belief.P, model.F, Q)
    else:
        Q, drive = Q - model.T @ model.S.T, model.T.dot(output)
        belief.x, belief.P = kalman_predict(belief.x, belief.P, model.F_measured, Q, drive)


def predict_ahead(belief: Belief, model: AugmentedModel, steps: int) -> None:
    """Predict ``steps`` (<= horizon) at once, beyond the newest command and where no output is measured.

    Oracle: as many single predictions.
    """
    belief.x, belief.P = kalman_predict(belief.x, belief.P, model.F_steps[steps], model.Q_steps[steps])


def update(belief: Belief, model: AugmentedModel, output: Array) -> None:
    """Correct the belief by a measured output (3,), relative to the operating point."""
    belief.x, belief.P = kalman_update(belief.x, belief.P, output, model.H, model.R)


def start_at(belief: Belief, model: AugmentedModel, command: Array, distance: int) -> None:
    """Set the model's states to the equilibrium under a constant command (3,), without bias."""
    n = model.bias.start
    states = slice(0, n)
    # Least squares: with an integrator there are many equilibria or none; the smallest solution is as good as any.
    steady = np.linalg.lstsq(np.eye(n) - model.F[states, states], model.F[states, model.command] @ command)[0]
    belief.x[states] = steady
    set_command(belief, model, command, distance, np.zeros(3))


def set_command(belief: Belief, model: AugmentedModel, command: Array, distance: int, velocity: Array) -> None:
    """Set the command (3,), relative to the operating point, ``distance`` samples from an arrived one.

    At distance 0 it has arrived itself and is certain.
    """
    known = slice(model.command.start, model.returning.stop)
    going, returning = model.velocity_shares
    belief.x[model.command] = command
    belief.x[model.velocity], belief.x[model.returning] = going * velocity, returning * velocity
    belief.P[known, :] = 0.0
    belief.P[:, known] = 0.0
    belief.P[model.command, model.command] = np.diag(model.input_variance_m2[min(distance, model.horizon)])
