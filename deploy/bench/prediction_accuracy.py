"""Errors of predictions 5 samples ahead: our systems beside other packages', for `tis bench identification`.

All are fitted to the first 70 % of the rows and predict the rest by their own Kalman gain, from one plain loop. The
plants are those that a model with poles moved inside fails on: integrators, and hardly damped oscillations.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from importlib.util import find_spec
from typing import Any, Final

import numpy as np
from scipy.linalg import solve_discrete_are

from tis.patient_side.identification.system_identification import identify
from tis.patient_side.identification.validation import PREDICTED_STEPS
from tis.patient_side.linear_system import Array, StateSpace

HORIZON: Final = 15
SHARE: Final = 0.7
SIPPY: Final = ("N4SID", "MOESP", "CVA")
"""Methods of the package sippy_unipi."""
_WARM_UP: Final = 30

Matrices = tuple[Array, Array, Array, Array, Array]
"""A, B, C, D and K."""


@dataclass(frozen=True)
class Plant:
    """Two states, one input, one output, with noises of deviations ``w`` (2,) and ``v``.

    The input is a drawn command less ``feedback`` (2,) times the states; each command lasts ``held`` samples.
    """

    name: str
    space: StateSpace
    w: tuple[float, float]
    v: float
    feedback: tuple[float, float]
    held: int
    command: float

    def rows(self, n_rows: int, seed: int) -> tuple[Array, Array]:
        """Return inputs and outputs (n_rows, 1)."""
        rng = np.random.default_rng(seed)
        drawn = np.repeat(self.command * rng.normal(size=n_rows // self.held + 1), self.held)[:n_rows]
        noise, error = rng.normal(size=(n_rows, 2)) * self.w, self.v * rng.normal(size=n_rows)
        x, u, y = np.zeros(2), np.empty((n_rows, 1)), np.empty((n_rows, 1))
        for k in range(n_rows):
            u[k] = drawn[k] - np.dot(self.feedback, x)
            y[k] = self.space.C @ x + error[k]
            x = self.space.A @ x + self.space.B @ u[k] + noise[k]
        return u, y


def _siso(A: Any, B: Any) -> StateSpace:
    return StateSpace(np.array(A), np.array(B), np.array([[1.0, 0.0]]), np.zeros((1, 1)))


PLANTS: Final = (
    Plant("ball and beam", _siso([[1, 0.1], [0, 1]], [[0.025], [0.5]]), (1e-4, 1e-3), 1e-3, (0.3, 0.35), 10, 0.05),
    Plant(
        "velocity-driven servo", _siso([[1, 0.05], [0, 0.7]], [[0], [0.3]]), (1e-3, 1e-2), 2e-3, (0.5, 0.0), 8, 1.0
    ),
    Plant(
        "near-unstable oscillator",
        _siso(0.9995 * np.array([[np.cos(0.3), np.sin(0.3)], [-np.sin(0.3), np.cos(0.3)]]), [[0], [1]]),
        (0.1, 0.1),
        0.3,
        (0.0, 0.0),
        1,
        1.0,
    ),
)


def prediction_errors(u: Array, y: Array, order: int) -> Iterator[tuple[str, float]]:
    """Yield who predicts, and the rms error over the deviation of what is predicted.

    A package that fails on the rows has the error NaN.
    """
    cut = int(SHARE * len(u))
    in_u, in_y = u[:cut].std(axis=0), y[:cut].std(axis=0)
    u, y = u / in_u, y / in_y
    steps = PREDICTED_STEPS
    held = y[cut + _WARM_UP : -steps] - y[cut + _WARM_UP + steps :]
    deviation = y[cut + _WARM_UP + steps :].std(axis=0)
    yield "hold", float(np.sqrt(np.mean(np.mean(held**2, axis=0) / deviation**2)))
    for who, call in _identifiers(u[:cut], y[:cut], order).items():
        try:
            errors = _ahead(call(), u, y)[cut + _WARM_UP :]
            yield who, float(np.sqrt(np.mean(np.mean(errors**2, axis=0) / deviation**2)))
        except Exception:  # whatever another package raises
            yield who, float("nan")


def _ahead(matrices: Matrices, u: Array, y: Array) -> Array:
    """Return the errors of predicting row k + 5 after row k, with known inputs."""
    A, B, C, D, K = matrices
    x, errors = np.zeros(len(A)), np.empty((len(y) - PREDICTED_STEPS, y.shape[1]))
    for k in range(len(errors)):
        x = A @ x + B @ u[k] + K @ (y[k] - C @ x - D @ u[k])
        ahead = x
        for step in range(1, PREDICTED_STEPS):
            ahead = A @ ahead + B @ u[k + step]
        errors[k] = y[k + PREDICTED_STEPS] - C @ ahead - D @ u[k + PREDICTED_STEPS]
    return errors


def _identifiers(u: Array, y: Array, order: int) -> dict[str, Callable[[], Matrices]]:
    def ours(method: str, stable: bool) -> Callable[[], Matrices]:
        def call() -> Matrices:
            found = identify(u, y, order=order, method=method, horizon=HORIZON, stable=stable)
            return found.A, found.B, found.C, found.D, found.K

        return call

    calls = {f"tis {method}": ours(method, False) for method in ("moesp", "n4sid", "cva")}
    calls["tis moesp, stable"] = ours("moesp", True)
    return calls | dict(_peers(u, y, order))


def _peers(u: Array, y: Array, order: int) -> Iterator[tuple[str, Callable[[], Matrices]]]:
    if find_spec("sippy_unipi"):
        for method in SIPPY:
            yield f"sippy_unipi {method}", partial(_sippy, method, u, y, order)
    if find_spec("nfoursid"):
        yield "nfoursid", partial(_nfoursid, u, y, order)
    if find_spec("ctrlsys"):
        yield "ctrlsys (SLICOT)", partial(_slicot, u, y, order)


def sippy_model(method: str, u: Array, y: Array, order: int, horizon: int) -> Any:
    """Return what sippy_unipi identifies."""
    from sippy_unipi import system_identification

    return system_identification(y.T, u.T, method, SS_f=horizon, SS_fixed_order=order, SS_D_required=True)


def nfoursid_model(u: Array, y: Array, order: int, horizon: int) -> Any:
    """Return what nfoursid identifies: a state space, and the covariance of its noises."""
    import pandas as pd
    from nfoursid.nfoursid import NFourSID

    inputs, outputs = ([f"{side}{i}" for i in range(a.shape[1])] for side, a in (("u", u), ("y", y)))
    frame = pd.DataFrame(np.hstack([u, y]), columns=inputs + outputs)
    found = NFourSID(frame, outputs, inputs, num_block_rows=horizon)
    found.subspace_identification()
    return found.system_identification(rank=order)


def _sippy(method: str, u: Array, y: Array, order: int) -> Matrices:
    g = sippy_model(method, u, y, order, HORIZON)
    return g.A, g.B, g.C, g.D, g.K


def _nfoursid(u: Array, y: Array, order: int) -> Matrices:
    s, covariance = nfoursid_model(u, y, order, HORIZON)
    p = y.shape[1]
    R, S, Q = covariance[:p, :p], covariance[p:, :p], covariance[p:, p:]
    P = solve_discrete_are(s.a.T, s.c.T, Q, R, s=S)
    return s.a, s.b, s.c, s.d, np.linalg.solve(s.c @ P @ s.c.T + R, (s.a @ P @ s.c.T + S).T).T


def _slicot(u: Array, y: Array, order: int) -> Matrices:
    import ctrlsys

    (n_rows, m), p = u.shape, y.shape[1]
    columns = (np.asfortranarray(u), np.asfortranarray(y))
    _, R, *_ = ctrlsys.ib01ad("M", "Q", "N", "O", "N", "N", HORIZON, m, p, *columns, 0.0, -1.0)
    A, C, B, D, _, _, _, K, *_ = ctrlsys.ib01bd("C", "A", "K", HORIZON, order, m, p, n_rows, R, 0.0)
    return A, B, C, D, K
