"""Models of how an arm moves by itself, beside its linear model: one for each kind of forecast.

A new one is a `StoredModel` here and a field of `tis.patient_side.statespace.ArmModel`; model files follow from both.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Annotated, Any, Final

import numpy as np
from pydantic import Field, model_validator

from tis.common.scenario.patient import OrientationMethod
from tis.patient_side.model_fields import (
    AXES,
    Count,
    Floats,
    Integers,
    Matrices,
    Matrix,
    NotNegative,
    Number,
    Numbers,
    Positive,
    Rising,
    RisingCounts,
    Shape,
    Share,
    StoredModel,
    ThreeNumbers,
    Vector,
    check,
    integers,
    lists,
    of_axes,
    rises,
)

MEANS_S: Final = (0.07, 0.15, 0.35, 1.0, 3.0, 10.0)
"""Time constants of the running means in a hand's recent past."""
N_INCREMENTS: Final = 4
"""Last increments in a hand's recent past, and in an arm's."""
N_HEAD_INPUTS: Final = (36, 61)
"""Inputs of the heads on a `Correction`, in the movement's frame and in the base's."""
N_PARTS: Final = 8
"""Parts of the recent past that a `Correction` weighs."""
N_TERMS: Final = 15
"""Terms of the state of movement with which their coefficients vary."""

Positives = Annotated[Floats, lists(list[Positive])]


@dataclass(frozen=True)
class Head(StoredModel):
    """One head on what a `Correction` leaves: see `tis.patient_side.filters.heads`.

    ``centre`` and ``deviation`` (I,) are mean and deviation of its inputs, ``landmarks`` (M, I) some of those that it
    was trained on, in deviations about the mean; ``weights`` (H, 3, M) are those of the M features at the horizons of
    the correction.
    """

    centre: Vector
    deviation: Positives
    weights: Matrices
    landmarks: Matrix = field(default_factory=lambda: np.zeros((0, 0)))

    def faults(self) -> Iterator[str]:
        """Yield lengths that do not fit."""
        if len(self.centre) != len(self.deviation):
            yield "centre and deviation must be equally long"

    def misfits(self, n_inputs: int, n_horizons: int) -> Iterator[str]:
        """Yield what does not fit a correction's horizons and the inputs of its place."""
        if len(self.centre) != n_inputs:
            yield f"centre must have {n_inputs} elements, one for each input"
        if self.weights.ndim != 3 or self.weights.shape[:2] != (n_horizons, AXES):
            yield f"weights must have the shape ({n_horizons}, {AXES}, features)"
        elif self.landmarks.shape != (self.weights.shape[2], n_inputs):
            yield f"landmarks must have the shape (features, {n_inputs})"


@dataclass(frozen=True)
class Correction(StoredModel):
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
    holds after missing samples, too: what a correction gains is measured where none is missing. ``heads`` are none,
    or one of the movement's frame and one of the base's.
    """

    span: Count
    usual_m: Positive
    lowest: Number
    highest: Number
    largest: Positive
    gripper_usual_rad: Number
    gripper_spread_rad: NotNegative
    clock: Annotated[Number, Field(ge=0, le=0.5)]
    horizons: Rising
    weights: Matrices
    widths: Positives
    centre: Vector
    deviation: Positives
    fourier: Matrices
    linear_scale: Positives
    heads: list[Head] = field(default_factory=list)

    @property
    def has_former_heads(self) -> bool:
        """Whether the heads are of a form before this one, whose features nobody computes any more."""
        return any(not head.landmarks.size for head in self.heads)

    def shapes(self) -> Mapping[str, Shape]:
        """Return the shapes of the weights of both corrections."""
        n, first = len(self.horizons), self.fourier[:1]
        n_features = len(first[0][0]) if first.size and len(first[0]) else 0
        return {"weights": (n, N_PARTS, N_TERMS), "fourier": (n, AXES, n_features)}

    def faults(self) -> Iterator[str]:
        """Yield lengths that do not fit, and limits out of order."""
        if len(self.widths) != len(MEANS_S):
            yield f"widths must have {len(MEANS_S)} elements, one for each running mean"
        n_inputs = AXES * len(MEANS_S) + 2
        if len(self.centre) != n_inputs or len(self.deviation) != n_inputs:
            yield f"centre and deviation must have {n_inputs} elements, one for each input of the features"
        if len(self.linear_scale) != len(self.horizons):
            yield "linear_scale must be as long as horizons"
        if not rises(self.horizons):
            yield "horizons must rise"
        if self.lowest > self.highest:
            yield "lowest must be at most highest"
        if not self.has_former_heads:
            for i, (head, n) in enumerate(zip(self.heads, N_HEAD_INPUTS, strict=False)):
                yield from (f"heads.{i}: {fault}" for fault in head.misfits(n, len(self.horizons)))
        if len(self.heads) not in (0, len(N_HEAD_INPUTS)):
            yield f"heads must be none or {len(N_HEAD_INPUTS)}"


@dataclass(frozen=True)
class ArmResponse(StoredModel):
    """How an arm follows its command: a regression of its increments on its own last ones and on the command's.

    With p = ``gain`` (3, 3) times the command, in m,
    ``dy[k+1] = sum_i own[i] dy[k-i] + sum_i command[i] dp[k+1-i] + pull z[k] + w[k+1]``; the variance of w is
    ``noise`` times that of the command's innovations.

    ``z = p - y + c`` is the way that the arm has yet to go, and ``pull`` the share of it per sample, by which an arm
    comes to rest where its command is. The offset c between the two is a random walk, whose step has ``drift`` times
    the variance of w. Without pull, 0, increments alone tell where the arm is. Samples of the arm have an error of
    their own, whose variance is ``error`` times that of the command's innovations.
    """

    gain: Matrix
    own: Vector
    command: Vector
    noise: Positive
    pull: Share = 0.0
    drift: NotNegative = 0.0
    error: NotNegative = 0.0

    def shapes(self) -> Mapping[str, Shape]:
        """Return the shape of the gain."""
        return {"gain": (AXES, AXES)}

    def faults(self) -> Iterator[str]:
        """Yield numbers of coefficients that do not fit the states of the filter."""
        if len(self.own) != N_INCREMENTS or len(self.command) != N_INCREMENTS + 1:
            yield f"own must have {N_INCREMENTS} elements, and command one more"


@dataclass(frozen=True)
class InnovationsModel(StoredModel):
    """The arm's own movement, without its command: a stochastic model in innovations form, in one of two structures.

    About a level that drifts: ``x[k+1] = A x[k] + K e[k]``, ``y[k] = C x[k] + b[k] + e[k]`` with A (n, n), C (3, n),
    K (n, 3), y in m and innovations e of covariance ``Re`` (3, 3), m^2. The level b is a random walk, as the centre
    of a set-up's movements is unknown in advance. Its step has the covariance ``level_step^2 Re``.

    ``integrated``: the same form for the increments, ``y[k] - y[k-1] = C x[k] + e[k]``, without a level: the arm
    returns nowhere. ``isotropic``: all three axes have identical, separate states.

    ``covariance_scale`` (H,) multiplies the covariance of a forecast over ``scale_horizons`` (H,) samples, so that
    95 % ellipsoids hold 95 % of the held-back training rows: real movement alternates between quiet and fast, and the
    errors have heavier tails than a normal distribution. Ones: the model's own covariances.

    ``correction``: what the forecasts add to the linear model's own; None: nothing. With a ``response`` all that
    moves by itself is the command, in units of the arm, and the forecasts are those of the arm that follows it.
    """

    A: Matrix
    C: Matrix
    K: Matrix
    Re: Matrix
    level_step: Positive
    block_rows: Count
    singular_values: Vector
    scale_horizons: Annotated[Floats, lists(Annotated[Numbers, Field(min_length=1)])]
    covariance_scale: Annotated[Floats, lists(Annotated[Numbers, Field(min_length=1)])]
    integrated: bool = False
    isotropic: bool = False
    correction: Correction | None = None
    response: ArmResponse | None = None

    @property
    def order(self) -> int:
        """Number of states n."""
        return len(self.A)

    def shapes(self) -> Mapping[str, Shape]:
        """Return the shapes of the matrices."""
        n = len(self.A)
        return {"A": (n, n), "C": (AXES, n), "K": (n, AXES)}

    def faults(self) -> Iterator[str]:
        """Yield lengths that do not fit."""
        if len(self.covariance_scale) != len(self.scale_horizons):
            yield "covariance_scale must be as long as scale_horizons"

    def covariances(self) -> Mapping[str, Floats]:
        """Return that of the innovations."""
        return {"Re": self.Re}


@dataclass(frozen=True)
class InputForecast(StoredModel):
    """The forecast of a command that has not arrived: ``u + v sum_k phi^k psi^(h-k)``, k = 1..h.

    phi is ``damping``, the share of its velocity that a hand keeps from sample to sample; psi is ``persistence``, the
    share of the distance covered that it keeps, as hands return. A forecast therefore ends where it began; with psi
    = 1 it does not return. ``velocity_span`` is the number of samples that v is averaged over. ``growth_m`` (H, 3) is
    the standard deviation of the forecast's error per axis, h = 1..H samples ahead, on the training rows.
    """

    damping: Share
    velocity_span: Count
    growth_m: Annotated[Floats, lists(Annotated[list[ThreeNumbers], Field(min_length=1)])]
    persistence: Annotated[Number, Field(gt=0.5, le=1)] = 1.0

    def faults(self) -> Iterator[str]:
        """Yield a damping that is too large for the persistence."""
        if self.damping > max_damping(self.persistence):
            yield "damping must be at most 2 persistence - 1 where persistence is below 1"

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
class DirectModel(StoredModel):
    """Second moments of a signal's past and future, relative to the present, for least squares on them.

    The signal has d axes: positions in m (3), an orientation in the tangent space at the present one in rad (3), a
    gripper's angle in rad (1). Past: L samples ``lags`` steps ago; future: H samples ``horizons`` steps ahead; a step
    is ``stride`` samples. ``past`` (d L, d L), ``cross`` (H, d L, d) and ``future`` (H, d, d) are in the unit's
    square, axes innermost. Each horizon uses its first ``n_lags`` (H,) lags, and its ``penalty`` (H,) times a random
    walk's moments is added to ``past``; ``covariance_scale`` (H,) multiplies the residuals' moment, so that 95 %
    ellipsoids hold 95 % of the held-back training rows.
    """

    stride: Count
    lags: RisingCounts
    horizons: RisingCounts
    past: Matrix
    cross: Matrices
    future: Matrices
    n_lags: Annotated[Integers, lists(list[Count], integers)]
    penalty: Positives
    covariance_scale: Positives

    def check_axes(self, axes: int) -> None:
        """Raise `ValueError` with all faults of a model of so many axes."""
        d, n = axes * len(self.lags), len(self.horizons)
        shapes = {"past": (d, d), "cross": (n, d, axes), "future": (n, axes, axes)}
        wrong = [
            f"{name} must have {n} elements, one for each horizon"
            for name in ("n_lags", "penalty", "covariance_scale")
            if len(getattr(self, name)) != n
        ]
        if not rises(self.lags) or not rises(self.horizons):
            wrong.append("lags and horizons must rise")
        if max(self.n_lags, default=1) > len(self.lags):
            wrong.append(f"n_lags must be at most {len(self.lags)}, the number of lags")
        check(self, shapes, wrong, {})

    @property
    def axes(self) -> int:
        """Number of axes d."""
        return int(self.future.shape[-1])


@dataclass(frozen=True)
class Factorisation(StoredModel):
    """Numbers of a factorisation: ``rank`` K of L, ``ridge`` of its coefficients, ``n_outliers`` e of S.

    An outlier is a position and takes all its axes and all its entries on an antidiagonal; none is below
    ``least_outlier_m``. ``least_noise_m2`` is the least noise of the ridge. The steps are taken by turns until no
    missing position moves by more than ``tolerance_m``, at most ``max_turns`` times.
    """

    rank: Count
    ridge: NotNegative
    n_outliers: Annotated[int, Field(ge=0)]
    least_outlier_m: NotNegative
    least_noise_m2: Positive
    tolerance_m: NotNegative
    max_turns: Annotated[int, Field(ge=1, le=100)]


@dataclass(frozen=True)
class CompletionModel(StoredModel):
    """How `drmf` completes the Hankel matrix of an arm's recent positions; a step is ``stride`` samples.

    The matrix has ``n_columns`` columns of R steps. ``moves_m2`` (R,) is the mean square move of the training rows
    over 0 .. R - 1 steps, per axis, from which follow the second moments of their columns; these stand for
    ``prior_columns`` columns beside the recent ones. Nothing is forecast over more than ``longest`` steps.
    ``covariance_m2`` (H, 3, 3) is that of the forecast's error over ``horizons`` (H,) steps, on rows held out,
    widened so that 95 % ellipsoids hold 95 % of them.
    """

    stride: Count
    n_columns: Annotated[int, Field(ge=1, le=1000)]
    moves_m2: Annotated[Floats, lists(Annotated[list[NotNegative], Field(min_length=3, max_length=1000)])]
    prior_columns: NotNegative
    factorisation: Factorisation
    longest: Count
    horizons: RisingCounts
    covariance_m2: Matrices

    def faults(self) -> Iterator[str]:
        """Yield sizes that do not fit."""
        n_rows, n = len(self.moves_m2), len(self.horizons)
        if self.factorisation.rank > n_rows - 2:
            yield f"factorisation.rank must be at most {n_rows - 2}, two less than moves_m2 has elements"
        if self.longest >= n_rows:
            yield f"longest must be below {n_rows}, the number of elements of moves_m2"
        if not rises(self.horizons):
            yield "horizons must rise"
        if len(self.covariance_m2) != n:
            yield f"covariance_m2 must have {n} elements, one for each horizon"

    def covariances(self) -> Mapping[str, Floats]:
        """Return those of the forecast's error."""
        return {f"covariance_m2.{i}": each for i, each in enumerate(self.covariance_m2)}

    @property
    def n_steps(self) -> int:
        """Number of steps in the matrix: R + C - 1."""
        return len(self.moves_m2) + self.n_columns - 1


@dataclass(frozen=True)
class WristModel(StoredModel):
    """Models of orientation and gripper; None where they were not requested or the rows do not allow them.

    ``direct`` is of the orientation in the tangent space at the newest sample, in its body frame, three axes in rad;
    ``gripper_direct`` of the gripper's angle, one axis in rad.
    """

    direct: Annotated[DirectModel, of_axes(AXES)] | None = None
    gripper_direct: Annotated[DirectModel, of_axes(1)] | None = None

    def faults(self) -> Iterator[str]:
        """Yield the first reason why orientation and gripper have no models that fit each other."""
        one, other = self.direct, self.gripper_direct
        if (one is None) != (other is None):
            yield "direct and gripper_direct must both be given, or neither"
        elif one and other and (one.stride, one.lags.tolist()) != (other.stride, other.lags.tolist()):
            yield "direct and gripper_direct must have the same stride and lags"

    def serves(self, method: OrientationMethod) -> bool:
        """Tell whether the models that an orientation method needs are there."""
        return method == "hold" or None not in (self.direct, self.gripper_direct)

    @model_validator(mode="before")
    @classmethod
    def _without_rates(cls, stored: Any) -> Any:
        """Leave out the models of `constant_rate`, a method of before, which older files have."""
        if isinstance(stored, dict):
            return {name: part for name, part in stored.items() if name not in ("rate", "gripper_rate")}
        return stored
