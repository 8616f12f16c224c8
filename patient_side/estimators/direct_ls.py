"""Direct least squares: one regression for each horizon on the past samples that have arrived.

The signal may be anything whose values have displacements in a vector space of d axes: a position, an orientation in
the tangent space at the newest one, the angle of a gripper.
"""

from bisect import bisect_left
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from tis.common.errors import DataError, Fault
from tis.patient_side.estimators.protocol import Estimate
from tis.patient_side.identification.direct_ls import Moved, differences, random_walk, regression
from tis.patient_side.linear_system import Array
from tis.patient_side.movement_models import DirectModel
from tis.patient_side.playout import Playout, SourceBuffer
from tis.patient_side.statespace import ArmModel

_MAX_PATTERNS: Final = 256
"""Patterns of missing samples whose regressions are kept."""
_INTERPOLATION_RATIO: Final = 8
"""Minimum age of an interpolated past sample, in distances to its nearest arrived neighbour."""


class ArrivedPast(NamedTuple):
    """The past samples at L lags that are known (L,), K of them, from arrived ones.

    Sample k lies ``share[k]`` of the way from index ``older[k]`` to ``younger[k]``; one that has arrived is both.
    """

    known: NDArray[np.bool_]
    older: NDArray[np.int64]
    younger: NDArray[np.int64]
    share: Array

    def only(self, kept: NDArray[np.bool_]) -> Self:
        """Return those of the known samples that are ``kept`` (K,)."""
        known = self.known.copy()
        known[known] = kept
        return self._replace(known=known, older=self.older[kept], younger=self.younger[kept], share=self.share[kept])

    def moves(self, now: Array, values: Callable[[NDArray[np.int64]], Array], moved: Moved) -> Array:
        """Return the displacements (L, d) from ``now`` (v,), the newest value; 0 where the past is not known.

        ``values`` returns those (K, v) at indices (K,).
        """
        if not len(self.older):
            return np.zeros((len(self.known), moved(now, now).shape[-1]))
        between = np.flatnonzero(self.share)
        if len(between):
            both = moved(now, values(np.concatenate([self.older, self.younger[between]])))
            found, share = both[: len(self.older)], self.share[between, None]
            found[between] = (1.0 - share) * found[between] + share * both[len(self.older) :]
        else:
            found = moved(now, values(self.older))
        if len(found) == len(self.known):
            return found
        whole = np.zeros((len(self.known), found.shape[-1]))
        whole[self.known] = found
        return whole


def arrived_past(buffer: SourceBuffer, lags: NDArray[np.int64], stride: int) -> ArrivedPast:
    """Return the known samples ``lags`` (L,) steps of ``stride`` samples before the newest.

    A sample that has not arrived is interpolated if its nearest arrived neighbour is within an eighth of the distance
    to the newest one.
    """
    distances = lags * stride
    older = buffer.newest - distances
    known = buffer.arrived(older)
    younger, share = older.copy(), np.zeros(len(lags))
    for i in np.flatnonzero(~known & (older > 0)).tolist():
        index = older.item(i)
        left, right = buffer.newest_before(index), buffer.oldest_after(index)
        if left >= 0 and _INTERPOLATION_RATIO * min(index - left, right - index) <= distances.item(i):
            known[i], older[i], younger[i], share[i] = True, left, right, (index - left) / (right - left)
    return ArrivedPast(known, older[known], younger[known], share[known])


@dataclass(frozen=True)
class DirectForecast:
    """The regressions of a `DirectModel`; with missing samples, those on the others, from the same second moments.

    Between two horizons the forecast is interpolated, as truth is between samples, and so is the covariance, which is
    then an upper bound. Beyond the last horizon the forecast stays constant, and the covariance grows like that of a
    random walk. Oracles: numpy's least squares on the arrived samples, the predictor of a known process.
    """

    model: DirectModel
    _walk: Array = field(init=False, repr=False)
    _fits: tuple[tuple[Array, Array], ...] = field(init=False, repr=False)
    _horizons: list[int] = field(init=False, repr=False)
    _n_lags: list[int] = field(init=False, repr=False)
    _partial: dict[tuple[int, bytes], tuple[Array, Array]] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        direct = self.model
        walk = random_walk(direct.past, direct.lags)
        object.__setattr__(self, "_walk", walk)
        fits = [self._fit(j, slice(direct.axes * n_lags)) for j, n_lags in enumerate(direct.n_lags.tolist())]
        object.__setattr__(self, "_fits", tuple(fits))
        object.__setattr__(self, "_horizons", direct.horizons.tolist())
        of_both = np.maximum(direct.n_lags, np.concatenate([direct.n_lags[:1], direct.n_lags[:-1]]))
        object.__setattr__(self, "_n_lags", of_both.tolist())
        object.__setattr__(self, "_partial", {})

    def _fit(self, horizon: int, kept: slice | NDArray[np.int64]) -> tuple[Array, Array]:
        """Return the weights (d, n) of a horizon on some regressors, and the covariance (d, d) that they leave."""
        direct = self.model
        weights, left = regression(direct, self._walk, direct.penalty[horizon], horizon, kept)
        return np.ascontiguousarray(weights.T), direct.covariance_scale[horizon] * left

    def n_lags(self, steps: float) -> int:
        """Return how many of the lags the forecast over ``steps`` uses."""
        return self._n_lags[min(bisect_left(self._horizons, steps), len(self._horizons) - 1)]

    def ahead(self, steps: float, moves: Array, known: NDArray[np.bool_] | None = None) -> tuple[Array, Array]:
        """Return the displacement (d,) ``steps`` >= 0 steps after the newest sample, and its covariance (d, d).

        ``moves`` (L, d) are the displacements to the first L past samples, at least `n_lags` of them, of which
        ``known`` (L,) are known; None: all.
        """
        past, horizons = moves.reshape(-1), self._horizons
        known_axes = None if known is None or known.all() else np.repeat(known, self.model.axes)
        upper = min(bisect_left(horizons, steps), len(horizons) - 1)
        moved, covariance = self._forecast(upper, past, known_axes)
        above = horizons[upper]
        if steps > above:
            return moved, covariance * (steps / above)
        if upper == 0:
            # Up to the first horizon: the sample itself is certain, and errors grow in proportion.
            share = steps / above
            return share * moved, share**2 * covariance
        below = horizons[upper - 1]
        share = (steps - below) / (above - below)
        moved_below, covariance_below = self._forecast(upper - 1, past, known_axes)
        return (
            (1.0 - share) * moved_below + share * moved,
            (1.0 - share) * covariance_below + share * covariance,
        )

    def _forecast(self, horizon: int, past: Array, known: NDArray[np.bool_] | None) -> tuple[Array, Array]:
        """Return the displacement (d,) up to a horizon, and its covariance (d, d)."""
        weights, covariance = self._fits[horizon]
        n = weights.shape[1]
        if known is None or known[:n].all():
            return weights.dot(past[:n]), covariance
        # Some regressors are missing: the regression on the others follows from the same second moments.
        kept = np.flatnonzero(known)[:n]
        pattern = horizon, kept.tobytes()
        if pattern not in self._partial:
            if len(self._partial) >= _MAX_PATTERNS:
                self._partial.clear()
            self._partial[pattern] = self._fit(horizon, kept)
        weights, covariance = self._partial[pattern]
        return weights.dot(past[kept]), covariance


def direct_ls(model: ArmModel) -> "DirectLs":
    """Return the estimator; raises `DataError` where the model file holds no such model."""
    if model.direct is None:
        raise DataError(
            Fault("model", "direct", "direct_ls needs moments of the arm's movement; the file holds none")
        )
    return DirectLs(model.direct)


@dataclass(frozen=True)
class DirectLs:
    """No estimate while no sample of the arm has arrived; forecasts and missing samples: see `DirectForecast`."""

    model: DirectModel
    name: str = "direct_ls"
    _forecast: DirectForecast = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "_forecast", DirectForecast(self.model))

    def initial(self) -> None:
        """Return the state: there is none."""

    def step(self, state: None, playout: Playout, now_ns: int) -> tuple[None, Estimate]:  # noqa: ARG002  protocol
        """Return the forecast from the freshest sample of the arm to ``now_ns``, and its covariance."""
        arm, direct = playout.arm, self.model
        newest = arm.get(arm.newest)
        if newest is None:
            return None, Estimate(None)
        steps = max(playout.age_samples(arm.newest, now_ns) / direct.stride, 0.0)
        past = arrived_past(arm, direct.lags, direct.stride)
        moved, covariance = self._forecast.ahead(steps, past.moves(newest, arm.positions_m, differences), past.known)
        return None, Estimate(newest + moved, covariance)
