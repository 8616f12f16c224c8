"""An identified system: its matrices, and what one does with them."""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import expm, logm

from tis.common.errors import DataError, Fault
from tis.patient_side.filters.gap_filter import GapFilter
from tis.patient_side.identification.input_delay import delayed
from tis.patient_side.identification.linear_model import LinearModel
from tis.patient_side.identification.noise import innovations
from tis.patient_side.identification.order import OrderChoice
from tis.patient_side.identification.residual_tests import ResidualTests, residual_tests
from tis.patient_side.identification.trials import Trial
from tis.patient_side.linear_system import Array, NoiseModel, StateSpace

_SAME = 1e-6


@dataclass(frozen=True)
class ContinuousSystem:
    """``dx/dt = A x + B u, y = C x + D u`` with each input ``delay_s`` late, exact for inputs that are held."""

    A: Array
    B: Array
    C: Array
    D: Array
    delay_s: Array


@dataclass(frozen=True)
class IdentifiedSystem:
    """``x[k+1] = A x + B u + K e, y[k] = C x + D u + e``, in the units of the data.

    ``linear`` holds the model with its origin; ``delay`` (m,) the samples by which each input acts late; ``orders``
    the order by each rule with the candidates' errors, None where the order was given. ``stretches`` are the trial,
    first row and end of the uninterrupted rows that were used, and ``linear.x0`` their initial states.
    """

    linear: LinearModel
    dt: float
    delay: tuple[int, ...]
    orders: OrderChoice | None
    stretches: tuple[tuple[int, int, int], ...]

    @property
    def space(self) -> StateSpace:
        """A, B, C and D together."""
        return self.linear.space

    @property
    def noise(self) -> NoiseModel:
        """Q, R and S together."""
        return self.linear.noise

    @property
    def A(self) -> Array:
        """State matrix (n, n)."""
        return self.space.A

    @property
    def B(self) -> Array:
        """Input matrix (n, m)."""
        return self.space.B

    @property
    def C(self) -> Array:
        """Output matrix (p, n)."""
        return self.space.C

    @property
    def D(self) -> Array:
        """Feedthrough (p, m)."""
        return self.space.D

    @property
    def K(self) -> Array:
        """Kalman gain (n, p)."""
        return self.noise.gain

    @property
    def innovations_covariance(self) -> Array:
        """Covariance Re (p, p) of e; it is the R of the innovations form, with Q = K Re K' and S = K Re."""
        return self.noise.R

    @property
    def x0(self) -> Array:
        """State (n,) at the first row of the first stretch."""
        return self.linear.x0[0]

    @property
    def order(self) -> int:
        """Number of states."""
        return self.space.order

    @property
    def poles(self) -> Array:
        """Eigenvalues of A."""
        return np.asarray(np.linalg.eigvals(self.A))

    @property
    def warnings(self) -> tuple[str, ...]:
        """What is doubtful about the model."""
        return self.linear.warnings

    def simulate(self, u: Array, x0: Array | None = None) -> Array:
        """Return the outputs (N, p) for inputs (N, m) without noise, from a state (n,), zero by default.

        An input that acts late is zero before its first row.
        """
        return self.space.simulate(np.nan_to_num(delayed(self._inputs(u), self.delay)), x0)

    def kalman_filter(self, x0: Array | None = None) -> GapFilter:
        """Return a filter before its first sample."""
        return GapFilter(self.space, self.noise, self.delay, x0)

    def predict(self, u: Array | None, y: Array, steps: int = 1) -> Array:
        """Return the outputs (N, p) as predicted ``steps`` samples before, with known inputs.

        Row k uses the outputs up to row k - steps and the inputs up to row k; the first ``steps`` rows are NaN. NaN
        in the data are missing channels.
        """
        if steps < 1:
            raise DataError(Fault("predict", "steps", "must be 1 or more", steps))
        inputs, outputs = self._both(u, y)
        states, kalman = np.empty((len(outputs), self.order)), self.kalman_filter()
        acting = np.nan_to_num(delayed(_held(inputs), self.delay))
        for k, (given, measured) in enumerate(zip(inputs, outputs, strict=True)):
            states[k] = kalman.x
            kalman.update(measured, given)
            kalman.predict()
        predicted = np.full(outputs.shape, np.nan)
        n_rows = max(0, len(outputs) - steps)
        # The state after row k, on to row k + steps.
        ahead = states[1 : 1 + n_rows]
        for step in range(1, steps):
            ahead = ahead @ self.A.T + acting[step : step + n_rows] @ self.B.T
        predicted[steps:] = ahead @ self.C.T + acting[steps:] @ self.D.T
        return predicted

    def forecast(self, u: Array | None, y: Array, steps: int, future_u: Array | None = None) -> tuple[Array, Array]:
        """Return the outputs (steps, p) after the last row, and their covariances (steps, p, p).

        ``future_u`` (steps, m) are the inputs there; by default each keeps its last value. NaN are missing channels.
        """
        inputs, outputs = self._both(u, y)
        future = None if future_u is None else self._inputs(future_u)
        if steps < 1 or (future is not None and len(future) < steps):
            raise DataError(Fault("forecast", "steps", "must be 1 or more, with an input for each", steps))
        kalman = self.kalman_filter()
        for given, measured in zip(inputs, outputs, strict=True):
            kalman.update(measured, given)
            kalman.predict()
        return kalman.forecast(steps, future)

    def residual_tests(self, u: Array | None, y: Array, lags: int = 20) -> ResidualTests:
        """Test the filter's innovations on rows without gaps, after the longest delay and ``lags`` rows more."""
        inputs, outputs = self._both(u, y)
        acting = delayed(inputs, self.delay)[max(self.delay, default=0) :]
        outputs = outputs[len(outputs) - len(acting) :]
        wrong = int(np.count_nonzero(~np.isfinite(np.hstack([acting, outputs]))))
        if wrong or lags < 1 or len(outputs) < 5 * lags:
            rule = f"must be at least {5 * max(lags, 1)} rows, five times the lags, without NaN"
            raise DataError(Fault("residual_tests", "rows", rule, len(outputs)))
        trials: list[Trial] = [(acting, outputs)]
        errors = innovations(self.space, self.K, [self._start(acting, outputs, lags)], trials)[0]
        return residual_tests(errors[lags:], acting[lags:], lags)

    def continuous(self) -> ContinuousSystem:
        """Return the system whose outputs are the same at the samples while inputs are held between them.

        Raises `DataError` where there is none: a pole at 0 or on the negative real axis has no real logarithm.
        """
        n, m = self.order, self.space.n_inputs
        bad = [pole for pole in self.poles if abs(pole) < _SAME or (pole.real < 0 and abs(pole.imag) < _SAME)]
        if bad:
            rule = "must be neither 0 nor negative and real: no held-input system in continuous time has them"
            raise DataError(Fault("continuous", "poles", rule, [complex(pole) for pole in bad]))
        step = np.eye(n + m)
        step[:n, :n], step[:n, n:] = self.A, self.B
        found = np.real(logm(step))
        if not np.allclose(expm(found), step, rtol=_SAME, atol=_SAME):
            raise DataError(Fault("continuous", "poles", "have no real logarithm to six digits: try another order"))
        rate = found / self.dt
        return ContinuousSystem(
            rate[:n, :n], rate[:n, n:], self.C, self.D, self.dt * np.array(self.delay, dtype=float)
        )

    def _start(self, u: Array, y: Array, n_rows: int) -> Array:
        """Return the state at the first row that fits the first rows, by the observer, which is stable."""
        observed = self.A - self.K @ self.C
        rest = innovations(self.space, self.K, [np.zeros(self.order)], [(u[:n_rows], y[:n_rows])])[0]
        response = np.array([self.C @ np.linalg.matrix_power(observed, k) for k in range(n_rows)])
        return np.asarray(np.linalg.lstsq(response.reshape(-1, self.order), rest.reshape(-1))[0])

    def _inputs(self, u: Array | None) -> Array:
        given = np.zeros((0, 0)) if u is None else np.asarray(u, dtype=float)
        given = given[:, None] if given.ndim == 1 else given
        if given.ndim != 2 or given.shape[1] != self.space.n_inputs:
            raise DataError(Fault("system", "input", f"must have {self.space.n_inputs} columns", given.shape))
        return given

    def _both(self, u: Array | None, y: Array) -> tuple[Array, Array]:
        outputs = np.asarray(y, dtype=float)
        outputs = outputs[:, None] if outputs.ndim == 1 else outputs
        if outputs.ndim != 2 or outputs.shape[1] != self.space.n_outputs:
            raise DataError(Fault("system", "output", f"must have {self.space.n_outputs} columns", outputs.shape))
        inputs = np.zeros((len(outputs), 0)) if u is None and not self.space.n_inputs else self._inputs(u)
        if len(inputs) != len(outputs):
            raise DataError(
                Fault("system", "input", f"must have as many rows as the output, {len(outputs)}", len(inputs))
            )
        return inputs, outputs


def _held(u: Array) -> Array:
    """Return inputs (N, m) whose missing values are the last ones before, or zero."""
    held, last = u.copy(), np.zeros(u.shape[1])
    for row in held:
        row[np.isnan(row)] = last[np.isnan(row)]
        last = row
    return held
