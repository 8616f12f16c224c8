"""Direct least squares: one regression for each horizon on the arm's past positions that have arrived."""

from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

from common.errors import DataError, Fault
from patient_side.estimators.protocol import Estimate
from patient_side.filters.input_path import known_point
from patient_side.identification.second_moments import random_walk, regression
from patient_side.playout import Playout, SourceBuffer
from patient_side.statespace import ArmModel, Array, DirectModel

_INTERPOLATION_RATIO: Final = 8
"""Minimum age of an interpolated past sample, in distances to its nearest arrived neighbour."""


def direct_ls(model: ArmModel) -> "DirectLs":
    """Return the estimator; raises `DataError` where the model file holds no such model."""
    if model.direct is None:
        raise DataError(
            Fault("model", "direct", "direct_ls needs moments of the arm's movement; the file holds none")
        )
    return DirectLs(model.direct)


@dataclass(frozen=True)
class DirectLs:
    """No estimate while no sample of the arm has arrived.

    A past sample that has not arrived is replaced by older ones, with the regression on these; one that lies far back
    may be interpolated, if its nearest arrived neighbour is within an eighth of the distance to the freshest sample.
    Between two horizons the forecast is interpolated, as truth is between samples, and so is the covariance, which is
    then an upper bound. Beyond the last horizon the forecast stays constant, and the covariance grows like that of a
    random walk. Oracles: numpy's least squares on the arrived samples, the predictor of a known process.
    """

    model: DirectModel
    name: str = "direct_ls"
    _walk: Array = field(init=False, repr=False)
    _fits: tuple[tuple[Array, Array], ...] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        direct = self.model
        walk = random_walk(direct.past, direct.lags)
        object.__setattr__(self, "_walk", walk)
        fits = [
            regression(direct, walk, direct.penalty[j], j, slice(3 * n_lags))
            for j, n_lags in enumerate(direct.n_lags.tolist())
        ]
        object.__setattr__(self, "_fits", tuple(fits))

    def initial(self) -> None:
        """Return the state: there is none."""

    def step(self, state: None, playout: Playout, now_ns: int) -> tuple[None, Estimate]:  # noqa: ARG002  protocol
        """Return the forecast from the freshest sample of the arm to ``now_ns``, and its covariance."""
        arm, direct = playout.arm, self.model
        newest = arm.get(arm.newest)
        if newest is None:
            return None, Estimate(None)
        steps = max(playout.age_samples(arm.newest, now_ns) / direct.stride, 0.0)
        past, known = self._past(arm, newest)
        upper = min(int(np.searchsorted(direct.horizons, steps)), len(direct.horizons) - 1)
        moved, covariance = self._forecast(upper, past, known)
        above = float(direct.horizons[upper])
        if steps > above:
            return None, Estimate(newest + moved, covariance * (steps / above))
        if upper == 0:
            # Up to the first horizon: the sample itself is certain, and errors grow in proportion.
            share = steps / above
            return None, Estimate(newest + share * moved, share**2 * covariance)
        below = float(direct.horizons[upper - 1])
        share = (steps - below) / (above - below)
        moved_below, covariance_below = self._forecast(upper - 1, past, known)
        return None, Estimate(
            newest + (1.0 - share) * moved_below + share * moved,
            (1.0 - share) * covariance_below + share * covariance,
        )

    def _past(self, arm: SourceBuffer, newest: Array) -> tuple[Array, NDArray[np.bool_]]:
        """Return the past positions relative to the freshest (3 L,), and which of them are known (3 L,)."""
        lags = self.model.lags
        past, known = np.zeros((len(lags), 3)), np.zeros(len(lags), dtype=bool)
        for i, lag in enumerate(lags.tolist()):
            distance = lag * self.model.stride
            index = arm.newest - distance
            sample = arm.get(index)
            if sample is None and arm.newest_before(index) >= 0:
                point = known_point(arm, index)
                sample = point.position_m if _INTERPOLATION_RATIO * point.distance <= distance else None
            if sample is not None:
                past[i], known[i] = sample - newest, True
        return past.reshape(-1), np.repeat(known, 3)

    def _forecast(self, horizon: int, past: Array, known: NDArray[np.bool_]) -> tuple[Array, Array]:
        """Return the arm's movement (3,) up to a horizon, and its covariance (3, 3)."""
        direct = self.model
        weights, left = self._fits[horizon]
        if known[: len(weights)].all():
            kept = np.arange(len(weights))
        else:
            kept = np.flatnonzero(known)[: len(weights)]
            # Some regressors are missing: the regression on the others follows from the same second moments.
            weights, left = regression(direct, self._walk, direct.penalty[horizon], horizon, kept)
        return weights.T @ past[kept], direct.covariance_scale[horizon] * left
