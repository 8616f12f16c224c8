"""The models of an arm as values; the linear one is x[k+1] = A x[k] + B u[k] + w, y[k] = C x[k] + D u[k] + v."""

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from tis.common.channels import Arm, Hand
from tis.common.sources.provenance import RecordedRows
from tis.patient_side.completion_model import CompletionModel
from tis.patient_side.direct_model import DirectModel
from tis.patient_side.learned_model import LearnedModel
from tis.patient_side.wrist_model import WristModel

Array = NDArray[np.float64]

_BLOCK = 32


@dataclass(frozen=True)
class StateSpace:
    """Matrices of shapes A (n, n), B (n, m), C (p, n), D (p, m); n may be 0: a static relation y = D u."""

    A: Array
    B: Array
    C: Array
    D: Array

    @property
    def order(self) -> int:
        """Number of states n."""
        return len(self.A)

    @property
    def n_inputs(self) -> int:
        """Number of inputs m."""
        return int(self.D.shape[1])

    @property
    def n_outputs(self) -> int:
        """Number of outputs p."""
        return len(self.D)

    def spectral_radius(self) -> float:
        """Return the largest modulus of A's eigenvalues, 0 for a static relation."""
        return float(np.max(np.abs(np.linalg.eigvals(self.A)))) if self.order else 0.0

    def simulate(self, u: Array, x0: Array | None = None) -> Array:
        """Return the noise-free outputs (N, p) for inputs (N, m) from state ``x0`` (n,), zero by default.

        Oracle: a plain loop, test_statespace.
        """
        # Blocks of rows instead of a loop over rows: within a block the outputs are products of matrices.
        n, p, m, length = self.order, self.n_outputs, self.n_inputs, min(_BLOCK, max(1, len(u)))
        n_blocks = -(-len(u) // length)
        inputs = np.zeros((n_blocks, length * m))
        inputs.reshape(-1)[: len(u) * m] = u.reshape(-1)
        # C A^t, and the Markov parameters D, C B, C A B, ...
        powers = np.empty((length + 1, n, n))
        powers[0] = np.eye(n)
        for t in range(length):
            powers[t + 1] = self.A @ powers[t]
        observe = self.C @ powers[:length]
        markov = np.concatenate([np.zeros((length - 1, p, m)), self.D[None], (observe @ self.B)[:-1]])
        # Response to the inputs of the same block: response[t, :, j] is that of its row t to its row j.
        response = np.lib.stride_tricks.sliding_window_view(markov, length, axis=0)[:, :, :, ::-1]
        outputs = inputs @ response.transpose(3, 2, 0, 1).reshape(length * m, length * p)
        # Response to the state at the beginning of each block, which runs from block to block.
        if n:
            drives = inputs @ (powers[length - 1 :: -1] @ self.B).transpose(0, 2, 1).reshape(length * m, n)
            states = np.empty((n_blocks, n))
            x = np.zeros(n) if x0 is None else np.asarray(x0, dtype=float)
            for block, drive in enumerate(drives):
                states[block] = x
                x = powers[length] @ x + drive
            outputs += states @ observe.reshape(length * p, n).T
        return np.asarray(outputs.reshape(n_blocks * length, p)[: len(u)])


@dataclass(frozen=True)
class NoiseModel:
    """Covariances of process noise Q (n, n), measurement noise R (p, p) and their cross term S (n, p), SI units."""

    Q: Array
    R: Array
    S: Array

    @property
    def gain(self) -> Array:
        """Return the Kalman gain K (n, p) of an innovations form: ``w = K v``, so ``S = K R`` and ``Q = K R K'``."""
        return np.asarray(np.linalg.solve(self.R, self.S.T).T)


@dataclass(frozen=True)
class Correction:
    """What a linear forecast leaves to the hand's state of movement: see `tis.patient_side.filters.correction`.

    The velocity is the forecast move over ``span`` samples, its usual size ``usual_m`` (rms over the training rows);
    ``lowest`` and ``highest`` bound the logarithm of speed, ``largest`` is the increment, in usual moves, beyond
    which the coefficients fade. ``gripper_usual_rad`` and ``gripper_spread_rad`` are mean and deviation of the
    gripper's angle in the training rows, 0 where it does not move. ``clock`` is the frequency of the clock behind the
    rows in cycles per row, 0 where rows are even.

    ``weights`` (H, P, T) weigh T terms in the coefficients of P parts, ``horizons`` (H,) samples ahead. ``widths``
    (L,) are the distances to the L running means, in usual moves, that count as large. ``centre`` and ``deviation``
    (3 L + 2,) are mean and deviation of the Fourier features' inputs; ``fourier`` (H, 3, M) are the weights of M
    features, in usual moves. ``linear_scale`` (H,) is the factor for the covariances of the linear forecasts. It
    holds after missing samples, too: what a correction gains is measured where none is missing.
    """

    span: int
    usual_m: float
    lowest: float
    highest: float
    largest: float
    gripper_usual_rad: float
    gripper_spread_rad: float
    clock: float
    horizons: Array
    weights: Array
    widths: Array
    centre: Array
    deviation: Array
    fourier: Array
    linear_scale: Array


@dataclass(frozen=True)
class InnovationsModel:
    """The arm's own movement, without its command: a stochastic model in innovations form, in one of two structures.

    About a level that drifts: ``x[k+1] = A x[k] + K e[k]``, ``y[k] = C x[k] + b[k] + e[k]`` with A (n, n), C (3, n),
    K (n, 3), y in m and innovations e of covariance ``Re`` (3, 3), m^2. The level b is a random walk, as the centre
    of a set-up's movements is unknown in advance. Its step has the covariance ``level_step^2 Re``.

    ``integrated``: the same form for the increments, ``y[k] - y[k-1] = C x[k] + e[k]``, without a level: the arm
    returns nowhere. ``isotropic``: all three axes have identical, separate states.

    ``covariance_scale`` (H,) multiplies the covariance of a forecast over ``scale_horizons`` (H,) samples, so that
    95 % ellipsoids hold 95 % of the held-back training rows: real movement alternates between quiet and fast, and the
    errors have heavier tails than a normal distribution. Ones: the model's own covariances.

    ``correction``: what the forecasts add to the linear model's own; None: nothing.
    """

    A: Array
    C: Array
    K: Array
    Re: Array
    level_step: float
    block_rows: int
    singular_values: Array
    scale_horizons: Array
    covariance_scale: Array
    integrated: bool = False
    isotropic: bool = False
    correction: Correction | None = None

    @property
    def order(self) -> int:
        """Number of states n."""
        return len(self.A)


@dataclass(frozen=True)
class InputForecast:
    """The forecast of a command that has not arrived: ``u + v sum_k phi^k psi^(h-k)``, k = 1..h.

    phi is ``damping``, the share of its velocity that a hand keeps from sample to sample; psi is ``persistence``, the
    share of the distance covered that it keeps, as hands return. A forecast therefore ends where it began; with psi
    = 1 it does not return. ``velocity_span`` is the number of samples that v is averaged over. ``growth_m`` (H, 3) is
    the standard deviation of the forecast's error per axis, h = 1..H samples ahead, on the training rows.
    """

    damping: float
    velocity_span: int
    growth_m: Array
    persistence: float = 1.0

    def velocities(self) -> tuple[float, float]:
        """Return two velocities, in units of v, that decay by phi and by psi and whose sum is that of the forecast.

        The sum above is ``phi (psi^h - phi^h) / (psi - phi)``; its differences are two geometric series.
        Oracle: the sum itself.
        """
        phi, psi = self.damping, self.persistence
        if psi == 1.0:
            return 1.0, 0.0
        return (1.0 - phi) / (psi - phi), -phi * (1.0 - psi) / (psi * (psi - phi))


def max_damping(persistence: float) -> float:
    """Return the largest damping for a persistence: a hand returns at most half as fast as it slows down."""
    return 1.0 if persistence == 1.0 else 2.0 * persistence - 1.0


@dataclass(frozen=True)
class FilterModel:
    """A second model of an arm, for an estimator with an identification method of its own.

    Offsets (3,) and ``static`` are as in `ArmModel`.
    """

    space: StateSpace
    noise: NoiseModel
    input_offset_m: Array
    output_offset_m: Array
    static: bool


@dataclass(frozen=True)
class ArmModel:
    """All models of one arm; written to the run folder, and read back by a replay.

    ``input_offset_m`` and ``output_offset_m`` (3,) are the operating point: means over the training rows.
    ``output_low_m`` and ``output_high_m`` (3,) are the training rows' range, the unit of normalised errors.
    ``fit_pct`` is the share of variance, per axis, that a simulation explains on the validation rows.
    ``static``: a gain is the whole relation of arm and command. ``innovations`` and the fields after it are the
    models of further estimators, ``wrist`` those of orientation and gripper; None where they could not be, or were
    not, identified.
    ``trained_on`` are the training rows of each recording; empty in files that do not record them.
    """

    hand: Hand
    arm: Arm
    rate_hz: int
    method: str
    order: int
    block_rows: int
    train: str
    space: StateSpace
    x0: Array
    noise: NoiseModel
    forecast: InputForecast
    input_offset_m: Array
    output_offset_m: Array
    output_low_m: Array
    output_high_m: Array
    singular_values: Array
    fit_pct: tuple[float, ...]
    spectral_radius: float
    pairing: str
    static: bool
    warnings: tuple[str, ...] = field(default=())
    trained_on: tuple[RecordedRows, ...] = ()
    innovations: InnovationsModel | None = None
    n4sid: FilterModel | None = None
    arx: FilterModel | None = None
    autoregression: InnovationsModel | None = None
    direct: DirectModel | None = None
    paper: FilterModel | None = None
    drmf: CompletionModel | None = None
    learned: tuple[LearnedModel, ...] = ()
    wrist: WristModel | None = None

    @property
    def n_lags(self) -> int | None:
        """Return the number of lags of a regression (method arx); None of other models."""
        return self.order // self.space.n_outputs if self.method == "arx" else None


def order_text(model: ArmModel) -> str:
    """Return the order as text, for a regression with its number of lags and outputs."""
    return (
        str(model.order) if model.n_lags is None else f"{model.order} ({model.n_lags} lags x {model.space.n_outputs})"
    )


def with_model(model: ArmModel, own: FilterModel) -> ArmModel:
    """Return the arm with another model of its movement, which starts at that model's operating point."""
    order = own.space.order
    return replace(
        model,
        order=order,
        space=own.space,
        x0=np.zeros(order),
        noise=own.noise,
        input_offset_m=own.input_offset_m,
        output_offset_m=own.output_offset_m,
        spectral_radius=own.space.spectral_radius(),
        static=own.static,
    )
