"""The Kalman filter of an arm: filterpy's, on the model's states, an output bias and the command itself.

The augmented state is ``z = [x (n), b (3), u (3), d (3), r (3)]``:

- x, the model's states about the operating point, ``x[k+1] = A x[k] + B u[k] + w[k]``;
- b, a slow random walk that takes up errors of the operating point, ``y = C x + D u + b + v``;
- u, the command, and d, its velocity in m per sample: ``d[k+1] = phi d[k] + e[k]`` and
  ``u[k+1] = u[k] + d[k+1] + r[k+1]``;
- r, the velocity at which it comes back from where its forecast has taken it: ``r[k+1] = psi r[k]``, certain.

Where the command has arrived, u is set to it and is certain. Beyond its newest sample the mean of u is the
damped-velocity forecast, and its error is that of a velocity with noise e, whose variance is taken from the
growth found in training. So a measurement that is fresher than the command corrects the command's forecast,
not the bias, and what is not known of the command enters every covariance (``D Sigma D'``, ``B Sigma B'``)
with its correlations.

Process and measurement noise may be correlated (S, as in the innovations form): given y[k], the transition
from k is ``(F - T H) z + T y`` with noise ``Q - T S'``, ``T = S R^-1`` (Anderson and Moore, *Optimal
Filtering*, 5.4).
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from patient_side.statespace import ArmModel, Array, InputForecast

if TYPE_CHECKING:
    from filterpy.kalman import KalmanFilter

BIAS_STEP = 0.05
"""Standard deviation of the bias's step from sample to sample, in units of the measurement noise's."""

NOISE_FLOOR_M = 1e-7
"""Least standard deviation of the measurement noise: a tenth of the last digit of recorded positions."""


@dataclass(frozen=True)
class AugmentedModel:
    """The matrices of the filter on d = n + 12 states, computed once.

    ``Q`` is the process noise of a step to where the command is known, ``Q_ahead`` of one beyond its newest
    sample. ``F_steps`` and ``Q_steps`` (H + 1, d, d) are those of h steps ahead taken at once; H is the
    horizon. ``input_variance_m2`` (H + 1, 3) is that of the command h samples away from the nearest arrived
    one.
    """

    n_states: int
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


def input_noise(forecast: InputForecast, horizon: int) -> tuple[Array, Array]:
    """Return the variances (m^2) of the velocity's noise e (3,) and the forecast's error (horizon + 1, 3).

    With noise of variance q, the error h samples ahead has ``q sum_i (1 + phi + ... + phi^(i-1))^2``,
    i = 1..h; q is the mean over the growth that is known of the first fifth of the horizon. Later on a hand that
    comes back is surer than that, and short forecasts must not pay for it. Oracle: the error's covariance,
    propagated.
    """
    reach = np.cumsum(forecast.damping ** np.arange(horizon))
    shape = np.concatenate([[0.0], np.cumsum(reach**2)])
    growth = np.asarray(forecast.growth_m, dtype=float)[: max(1, horizon // 5)]
    noise = np.mean(growth**2 / shape[1 : len(growth) + 1, None], axis=0) if len(growth) else np.zeros(3)
    return noise, shape[:, None] * noise


def _consistent_noise(Q: Array, R: Array, S: Array) -> tuple[Array, Array, Array]:
    """Return the noise model with a positive semi-definite joint covariance and an R of full rank."""
    n = len(Q)
    joint = np.block([[Q, S], [S.T, R]])
    deviation = np.sqrt(np.diag(joint))
    scale = np.outer(*[np.where(deviation > 0, deviation, 1.0)] * 2)  # states may have any unit
    values, vectors = np.linalg.eigh((joint + joint.T) / 2 / scale)
    if values[0] < 0:
        joint = (vectors * np.maximum(values, 0.0)) @ vectors.T * scale
    R = joint[n:, n:]
    values, vectors = np.linalg.eigh(R)
    if values[0] < NOISE_FLOOR_M**2:
        # Raising R alone keeps the joint covariance positive semi-definite.
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

    F = np.eye(size)
    F[state, state], F[state, command] = space.A, space.B
    F[command, velocity], F[velocity, velocity] = phi * eye, phi * eye
    F[command, returning], F[returning, returning] = psi * eye, psi * eye
    H = np.zeros((3, size))
    H[:, state], H[:, bias], H[:, command] = space.C, eye, space.D

    Qx, R, Sx = _consistent_noise(model.noise.Q, model.noise.R, model.noise.S)
    S = np.zeros((size, 3))
    S[state] = Sx
    T = np.asarray(np.linalg.solve(R, S.T).T, dtype=float)
    noise, variance = input_noise(model.forecast, horizon)
    Q = np.zeros((size, size))
    Q[state, state], Q[bias, bias] = Qx, BIAS_STEP**2 * R
    Q_ahead = Q.copy()
    Q_ahead[n + 3 : n + 9, n + 3 : n + 9] = np.tile(np.diag(noise), (2, 2))

    F_steps, Q_steps = np.empty((horizon + 1, size, size)), np.zeros((horizon + 1, size, size))
    F_steps[0] = np.eye(size)
    for h in range(1, horizon + 1):
        F_steps[h] = F @ F_steps[h - 1]
        Q_steps[h] = F @ Q_steps[h - 1] @ F.T + Q_ahead

    # Before anything is known: x where noise and forecast errors over the horizon can take it, b and u
    # anywhere in the output's range, and d as it is after a long time.
    span_m2 = np.maximum(model.output_high_m - model.output_low_m, NOISE_FLOOR_M) ** 2
    P0 = np.zeros((size, size))
    drive = Qx + space.B @ np.diag(variance[-1]) @ space.B.T
    for _ in range(horizon):
        P0[state, state] = space.A @ P0[state, state] @ space.A.T + drive
    P0[bias, bias] = np.diag(span_m2)
    P0[command, command] = np.diag(span_m2)
    P0[velocity, velocity] = np.diag(noise / max(1.0 - phi**2, 1.0 / horizon))
    return AugmentedModel(
        n_states=n,
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


def build_filter(model: AugmentedModel) -> "KalmanFilter":
    """Return filterpy's filter with the matrices of ``model``, at mean zero and the initial covariance."""
    from filterpy.kalman import KalmanFilter  # loads scipy.stats, longer than all else

    kf = KalmanFilter(dim_x=len(model.F), dim_z=3)
    kf.x, kf.P = np.zeros(len(model.F)), model.P0.copy()
    kf.F, kf.H, kf.R = model.F, model.H, model.R
    return kf


def predict(kf: "KalmanFilter", model: AugmentedModel, output: Array | None, ahead: bool) -> None:
    """Predict one step, given y (3,) where it begins if measured; ``ahead``: beyond the newest command.

    Oracles: one-shot conditioning of the joint Gaussian, and the discrete algebraic Riccati equation.
    """
    Q = model.Q_ahead if ahead else model.Q
    if output is None:
        kf.predict(Q=Q)
    else:
        kf.predict(u=output, B=model.T, F=model.F_measured, Q=Q - model.T @ model.S.T)


def predict_ahead(kf: "KalmanFilter", model: AugmentedModel, steps: int) -> None:
    """Predict ``steps`` (<= horizon) at once, beyond the newest command and where no output is measured.

    Oracle: as many single predictions.
    """
    kf.predict(F=model.F_steps[steps], Q=model.Q_steps[steps])


def start_at(kf: "KalmanFilter", model: AugmentedModel, command: Array, distance: int) -> None:
    """Put the filter's states where a command (3,) that has always been there holds them, no bias."""
    states, n = slice(0, model.n_states), model.n_states
    # Least squares: with an integrator there are many such states or none; the smallest is as good as any.
    steady = np.linalg.lstsq(np.eye(n) - model.F[states, states], model.F[states, model.command] @ command)[0]
    kf.x[states] = steady
    set_command(kf, model, command, distance, np.zeros(3))


def set_command(kf: "KalmanFilter", model: AugmentedModel, command: Array, distance: int, velocity: Array) -> None:
    """Set the command (3,), relative to the operating point, ``distance`` samples from an arrived one.

    At distance 0 it has arrived itself and is certain.
    """
    known = slice(model.command.start, model.returning.stop)
    going, returning = model.velocity_shares
    kf.x[model.command] = command
    kf.x[model.velocity], kf.x[model.returning] = going * velocity, returning * velocity
    kf.P[known, :] = 0.0
    kf.P[:, known] = 0.0
    kf.P[model.command, model.command] = np.diag(model.input_variance_m2[min(distance, model.horizon)])
