"""The methods for orientation and gripper by name: hold, and least squares in the tangent space.

Least squares in the tangent space: `direct_ls` for orientation and gripper.

At the newest orientation R the past is ``log(R^-1 R_past)`` and the future ``log(R^-1 R_future)``, rotation vectors
in the body frame of R. One regression for each horizon forecasts d, and the estimate is ``R exp(d)``.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from math import isnan
from types import MappingProxyType
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from tis.common.scenario.patient import OrientationMethod
from tis.patient_side.estimators.direct_ls import ArrivedPast, DirectForecast, arrived_past
from tis.patient_side.identification.direct_ls import differences
from tis.patient_side.linear_system import Array
from tis.patient_side.movement_models import DirectModel, WristModel
from tis.patient_side.orientation.wrist import NOTHING, WristEstimate, WristMethod
from tis.patient_side.playout import SourceBuffer
from tis.patient_side.rotations import at_end, turned, turned_by


@dataclass(frozen=True)
class Hold:
    """No estimate while no sample of the arm has arrived, and no covariance."""

    name: Literal["hold"] = "hold"

    def estimate(self, arm: SourceBuffer, age_samples: float) -> WristEstimate:  # noqa: ARG002  protocol
        """Return the freshest orientation and gripper angle."""
        return WristEstimate(arm.orientation(arm.newest), None, arm.gripper_rad(arm.newest))


@dataclass(frozen=True)
class TangentLs:
    """No estimate while no sample of the arm has arrived.

    Samples that have not arrived are replaced as `DirectForecast` does. Oracles: numpy's least squares row by row, an
    arm that turns at a constant speed, and coverage on synthetic movements.
    """

    orientation: DirectModel
    gripper: DirectModel
    name: Literal["tangent_ls"] = "tangent_ls"
    _orientation: DirectForecast = field(init=False, repr=False)
    _gripper: DirectForecast = field(init=False, repr=False)
    _distances: NDArray[np.int64] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        distances = np.concatenate([[0], self.orientation.lags * self.orientation.stride])
        object.__setattr__(self, "_distances", distances)
        object.__setattr__(self, "_orientation", DirectForecast(self.orientation))
        object.__setattr__(self, "_gripper", DirectForecast(self.gripper))

    def estimate(self, arm: SourceBuffer, age_samples: float) -> WristEstimate:
        """Return the forecast from the newest sample, and its covariances."""
        steps = age_samples / self.orientation.stride
        n_lags = max(self._orientation.n_lags(steps), self._gripper.n_lags(steps))
        indices = arm.newest - self._distances[: 1 + n_lags]
        if arm.all_arrived(indices):  # as nearly always
            rows = arm.wrists(indices)
            found = self._ahead(steps, rows[0], turned(rows[0, :4], rows[1:, :4]), rows[1:, 4:] - rows[0, 4], None)
            if found.orientation is not None:
                return found
        return self._of_some(arm, steps, n_lags)

    def _of_some(self, arm: SourceBuffer, steps: float, n_lags: int) -> WristEstimate:
        """Return the estimate where samples of the past are missing, or have no orientation."""
        if arm.newest < 0:
            return NOTHING
        (now,) = arm.wrists(arm.newest - self._distances[:1])
        past = self._past(arm, n_lags)
        if not past.known.all():  # then others serve instead
            past = self._past(arm, len(self.orientation.lags))
        turns = past.moves(now[:4], lambda indices: arm.wrists(indices)[:, :4], turned)
        openings = past.moves(now[4:], lambda indices: arm.wrists(indices)[:, 4:], differences)
        return self._ahead(steps, now, turns, openings, past.known)

    def _past(self, arm: SourceBuffer, n_lags: int) -> ArrivedPast:
        """Return the known ones of the first past samples, each with an orientation."""
        past = arrived_past(arm, self.orientation.lags[:n_lags], self.orientation.stride)
        return past.only(~np.isnan(arm.wrists(past.older)[:, 0] + arm.wrists(past.younger)[:, 0]))

    def _ahead(
        self, steps: float, now: Array, turns: Array, openings: Array, known: NDArray[np.bool_] | None
    ) -> WristEstimate:
        """Return the estimate from the newest wrist (5,), and the displacements from it to the past ones (L, d)."""
        moved, covariance = self._orientation.ahead(steps, turns, known)
        at = turned_by(now[:4], moved)
        if isnan(at.item(0)):
            return NOTHING
        opened, variance = self._gripper.ahead(steps, openings, known)
        gripper_rad, turned_covariance = now.item(4) + opened.item(0), at_end(moved, covariance)
        if isnan(gripper_rad):
            return WristEstimate(at, turned_covariance)
        return WristEstimate(at, turned_covariance, gripper_rad, variance.item(0))


def _tangent_ls(model: WristModel) -> WristMethod | None:
    if model.direct is None or model.gripper_direct is None:
        return None
    return TangentLs(model.direct, model.gripper_direct)


METHODS: Final[Mapping[OrientationMethod, Callable[[WristModel], WristMethod | None]]] = MappingProxyType(
    {"hold": lambda _: Hold(), "tangent_ls": _tangent_ls}
)


def build_methods(names: Iterable[OrientationMethod], model: WristModel | None) -> tuple[WristMethod, ...]:
    """Return the methods called ``names``, without those that the model has nothing for; hold needs nothing.

    So a model file from before orientations were estimated serves as it did: its arm's orientation is held.
    """
    built = (METHODS[name](WristModel() if model is None else model) for name in names)
    return tuple(method for method in built if method is not None)
