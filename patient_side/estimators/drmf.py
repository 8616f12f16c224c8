"""Direct robust matrix factorisation: the Hankel matrix of recent positions, its late and lost entries filled."""

from dataclasses import dataclass, field
from math import ceil
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tis.common.errors import DataError, Fault
from tis.patient_side.estimators.protocol import Estimate
from tis.patient_side.filters.hankel_completion import column_moments, complete
from tis.patient_side.filters.input_path import known_point
from tis.patient_side.linear_system import Array
from tis.patient_side.movement_models import CompletionModel
from tis.patient_side.playout import Playout, SourceBuffer
from tis.patient_side.statespace import ArmModel

_INTERPOLATION_RATIO: Final = 4
"""Minimum length of a step in which a sample is interpolated, in distances to its nearest arrived neighbour."""


def drmf(model: ArmModel) -> "Drmf":
    """Return the estimator; raises `DataError` where the model file holds no such model."""
    if model.drmf is None:
        raise DataError(Fault("model", "drmf", "drmf needs a model of the arm's movement; the file holds none"))
    return Drmf(model.drmf)


@dataclass(frozen=True)
class Drmf:
    """No estimate while no sample of the arm has arrived.

    The matrix ends at the tick: what has not arrived by then, samples between two that have and those after the
    newest, are missing entries. The last of them is the forecast. Between two steps it is interpolated, as truth is
    between samples, and so is the covariance, which is then an upper bound. Beyond the longest forecast it stays
    constant; beyond the last horizon the covariance grows like that of a random walk. Every tick factorises anew, so
    there is no state. Oracle: a movement of exactly low rank.
    """

    model: CompletionModel
    name: str = "drmf"
    _prior: Array = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "_prior", column_moments(self.model.moves_m2))

    def initial(self) -> None:
        """Return the state: there is none."""

    def step(self, state: None, playout: Playout, now_ns: int) -> tuple[None, Estimate]:  # noqa: ARG002  protocol
        """Return the completed position at ``now_ns``, and the covariance of its error."""
        arm, model = playout.arm, self.model
        newest = arm.get(arm.newest)
        if newest is None:
            return None, Estimate(None)
        steps = max(playout.age_samples(arm.newest, now_ns) / model.stride, 0.0)
        ahead = max(1, min(ceil(steps), model.longest))
        path, known = self._recent(arm, newest, ahead)
        done = complete(path, known, self._prior, model.prior_columns, model.factorisation)
        # The newest sample itself is known, unless it is taken for an outlier.
        below, above = done.filled[-2] if ahead == 1 else done.newest[-2], done.newest[-1]
        share = min(steps, model.longest) - (ahead - 1)
        position = newest + (1.0 - share) * below + share * above
        return None, Estimate(position, self._covariance(steps))

    def _recent(self, arm: SourceBuffer, newest: Array, ahead: int) -> tuple[Array, NDArray[np.bool_]]:
        """Return the positions (W, 3) relative to the newest, up to ``ahead`` steps after it, and which are known."""
        n_steps, stride = self.model.n_steps, self.model.stride
        path, known = np.zeros((n_steps, 3)), np.zeros(n_steps, dtype=bool)
        for back in range(n_steps - ahead):
            index = arm.newest - back * stride
            sample = arm.get(index)
            if sample is None and stride >= _INTERPOLATION_RATIO and arm.newest_before(index) >= 0:
                point = known_point(arm, index)
                sample = point.position_m if _INTERPOLATION_RATIO * point.distance <= stride else None
            if sample is not None:
                place = n_steps - ahead - 1 - back
                path[place], known[place] = sample - newest, True
        return path, known

    def _covariance(self, steps: float) -> Array:
        """Return the covariance (3, 3) of an error ``steps`` after the newest sample."""
        horizons, covariances = self.model.horizons, self.model.covariance_m2
        upper = min(int(np.searchsorted(horizons, steps)), len(horizons) - 1)
        above = float(horizons[upper])
        if steps > above:
            return np.asarray(covariances[upper] * (steps / above))
        if upper == 0:
            # Up to the first horizon: the sample itself is certain, and errors grow in proportion.
            return np.asarray(covariances[0] * (steps / above) ** 2)
        share = (steps - horizons[upper - 1]) / (above - horizons[upper - 1])
        return np.asarray((1.0 - share) * covariances[upper - 1] + share * covariances[upper])
