"""Estimators without a filter: the arm holds, goes on at its velocity, or follows a gain."""

from dataclasses import dataclass, field

import numpy as np

from tis.patient_side.estimators.protocol import Estimate
from tis.patient_side.filters.input_path import continued, newest_velocity
from tis.patient_side.horizon import horizon_samples
from tis.patient_side.linear_system import Array, StateSpace
from tis.patient_side.playout import Playout
from tis.patient_side.statespace import ArmModel


@dataclass(frozen=True)
class Hold:
    """The arm stays at its freshest sample; no estimate while none has arrived, and no covariance."""

    name: str = "hold"

    def initial(self) -> None:
        """Return the state: there is none."""

    def step(self, state: None, playout: Playout, now_ns: int) -> tuple[None, Estimate]:  # noqa: ARG002  protocol
        """Return the freshest position of the arm, as it was sent."""
        arm = playout.arm
        even = arm.uneven.get(arm.newest) if arm.uneven else None
        return None, Estimate(arm.get(arm.newest) if even is None else even.position_m)


@dataclass(frozen=True)
class HoldLastArrived:
    """The arm stays at the sample that arrived last, however old it is; no covariance.

    This is a receiver that ignores source stamps: an overtaken packet moves the arm back in time. No estimate while
    no sample of the arm has arrived.
    """

    name: str = "hold_last_arrived"

    def initial(self) -> None:
        """Return the state: there is none."""

    def step(self, state: None, playout: Playout, now_ns: int) -> tuple[None, Estimate]:  # noqa: ARG002  protocol
        """Return the position of the arm that arrived last."""
        return None, Estimate(playout.arm.get(playout.arm.last_arrived))


@dataclass(frozen=True)
class Velocity:
    """No estimate while no sample of the arm has arrived; constant after 5 s; no covariance.

    Where the sample before the freshest has not arrived, the nearest one replaces it, at its true distance.
    """

    name: str = "velocity"

    def initial(self) -> None:
        """Return the state: there is none."""

    def step(self, state: None, playout: Playout, now_ns: int) -> tuple[None, Estimate]:  # noqa: ARG002  protocol
        """Return the freshest position of the arm extrapolated to ``now_ns`` at the last velocity."""
        arm = playout.arm
        newest = arm.get(arm.newest)
        if newest is None:
            return None, Estimate(None)
        age = min(max(playout.age_samples(arm.newest, now_ns), 0.0), float(horizon_samples(playout.rate_hz)))
        return None, Estimate(newest + newest_velocity(arm, 1) * age)


@dataclass(frozen=True)
class DampedVelocity:
    """No estimate while no sample of the arm has arrived.

    Its covariance is the error growth of the command's forecast through the gain D, as the arm of a static model
    moves like its command; between whole samples the growth is interpolated. There is none for a model with states,
    and none beyond the horizon of the known growth.
    """

    model: ArmModel
    name: str = "damped_velocity"
    _std_m: Array = field(init=False, repr=False)

    def __post_init__(self) -> None:
        # Deviation of the command's forecast 0 .. H samples ahead; H is repeated as the interpolation's right end.
        growth_m, std_m = self.model.forecast.growth_m, np.empty((0, 3))
        if self.model.space.order == 0:
            std_m = np.vstack([np.zeros((1, 3)), growth_m, growth_m[-1:]])
        object.__setattr__(self, "_std_m", std_m)

    def initial(self) -> None:
        """Return the state: there is none."""

    def step(self, state: None, playout: Playout, now_ns: int) -> tuple[None, Estimate]:  # noqa: ARG002  protocol
        """Return the forecast from the freshest position of the arm to ``now_ns``."""
        arm = playout.arm
        if arm.newest < 0:
            return None, Estimate(None)
        age = playout.age_samples(arm.newest, now_ns)
        age = min(max(age, 0.0), float(horizon_samples(playout.rate_hz)))
        return None, Estimate(continued(arm, self.model.forecast, age), self._covariance(age))

    def _covariance(self, age: float) -> Array | None:
        if age > len(self.model.forecast.growth_m) or not len(self._std_m):
            return None
        after = int(age)
        fraction = age - after
        std_m = (1.0 - fraction) * self._std_m[after] + fraction * self._std_m[after + 1]
        gain = self.model.space.D
        return np.asarray((gain * std_m**2).dot(gain.T))


_MAX_PAIRS_TRIED = 100


def dc_gain(space: StateSpace) -> Array:
    """Return ``D + C (I - A)^-1 B`` (p, m), the response to a constant input; D for a static relation.

    Where A has an eigenvalue 1 there is no steady state, and the result is the least-squares solution.
    Oracle: a long simulation.
    """
    n = space.order
    return np.asarray(space.D + space.C @ np.linalg.lstsq(np.eye(n) - space.A, space.B)[0])


@dataclass(frozen=True)
class StaticGain:
    """No estimate while no command has arrived, and no covariance.

    Where a gain is the whole relation, it holds about the freshest instant whose command and position have both
    arrived, as set-ups differ and a clutch moves the offset. Otherwise, and before, about the operating point.
    """

    model: ArmModel
    name: str = "static_gain"
    _gain: Array = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "_gain", dc_gain(self.model.space))

    def initial(self) -> None:
        """Return the state: there is none."""

    def step(self, state: None, playout: Playout, now_ns: int) -> tuple[None, Estimate]:  # noqa: ARG002  protocol
        """Return the position at which the freshest command would hold the arm."""
        command = playout.command.get(playout.command.newest)
        if command is None:
            return None, Estimate(None)
        known_command, known_arm = self._known(playout)
        return None, Estimate(self._gain @ (command - known_command) + known_arm)

    def _known(self, playout: Playout) -> tuple[Array, Array]:
        """Return a command (3,) and the position (3,) at which it holds the arm."""
        if self.model.static:
            index = min(playout.arm.newest, playout.command.newest)
            for _ in range(_MAX_PAIRS_TRIED):
                arm, command = playout.arm.get(index), playout.command.get(index)
                if arm is not None and command is not None:
                    return command, arm
                index = playout.arm.newest_before(index)
        return self.model.input_offset_m, self.model.output_offset_m
