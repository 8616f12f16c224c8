"""Pairing of masters and arms: found in the data, or configured and then checked against the data.

A da Vinci arm repeats its master's movement scaled and shifted, so the arm that follows is the one whose movement a
static affine map of the master's positions explains almost completely. The labels left and right do not determine it.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np

from common.channels import FOLLOWER, MASTER, SAME_NAME, Arm, Hand
from common.sources.trajectory import Array
from common.units import MM_PER_M

Requested = Literal["auto", "cross", "same_name"]

FOLLOWS_BELOW: Final = 0.2
"""Residual ratio above which no arm follows: true pairs lie below 0.01, false ones above 0.5."""
CLEARLY_BETTER: Final = 2.0
"""Ratio of two residual ratios from which one arm follows clearly better than the other."""

_EXACT: Final = 1e-6  # smaller ratios are rounding errors (fewer rows than the map has parameters)
_STILL_M: Final = 1e-6  # the recordings' resolution: an arm that moves less stands still


@dataclass(frozen=True)
class ArmFit:
    """Residual of a static affine map from master to arm; ``ratio`` is residual rms / the arm's std."""

    arm: Arm
    residual_rms_m: float
    ratio: float

    def __str__(self) -> str:
        return f"{self.residual_rms_m * MM_PER_M:.3f} mm rms of {self.arm} ({100 * self.ratio:.1f} %)"


@dataclass(frozen=True)
class Pairing:
    """The arm chosen for a hand, the fits of PSM1 and PSM2, and warnings about the choice."""

    hand: Hand
    arm: Arm
    requested: Requested
    fits: tuple[ArmFit, ArmFit]
    warnings: tuple[str, ...] = ()

    def __str__(self) -> str:
        return f"{MASTER[self.hand]} -> {self.arm} ({self.requested}; {_residuals(self.fits)})"


def fit_arm(command_m: Array, arm_m: Array, arm: Arm) -> ArmFit:
    """Fit ``arm ~ G command + c`` by least squares (G 3x3) to positions (N, 3) in m.

    The ratio of an arm that stands still is 1. Oracle: maps and noise that the tests generate.
    """
    centred = arm_m - arm_m.mean(axis=0)
    moves_m = float(np.sqrt(np.mean(centred**2)))
    if moves_m < _STILL_M:
        return ArmFit(arm, moves_m, 1.0)
    regressors = command_m - command_m.mean(axis=0)
    gain, *_ = np.linalg.lstsq(regressors, centred)
    residual_m = float(np.sqrt(np.mean((centred - regressors @ gain) ** 2)))
    return ArmFit(arm, residual_m, residual_m / moves_m)


def pair_hands(
    requested: Requested, hands: Sequence[Hand], commands_m: Mapping[Hand, Array], arms_m: Mapping[Arm, Array]
) -> tuple[Pairing, ...]:
    """Return the arm of each hand, from positions (N, 3) in m; they must not include scored rows.

    ``auto`` takes the arm with the smaller residual ratio. If both hands would get the same arm, both are crossed
    instead, with a warning.
    """
    pairings = tuple(_pair(requested, hand, commands_m[hand], arms_m) for hand in hands)
    if len({pairing.arm for pairing in pairings}) == len(pairings):
        return pairings
    clash = f"both masters seem to drive {pairings[0].arm}: crossed instead"
    return tuple(
        Pairing(p.hand, FOLLOWER[p.hand], p.requested, p.fits, (f"{clash}; {_residuals(p.fits)}",)) for p in pairings
    )


def _pair(requested: Requested, hand: Hand, command_m: Array, arms_m: Mapping[Arm, Array]) -> Pairing:
    fits = (fit_arm(command_m, arms_m["PSM1"], "PSM1"), fit_arm(command_m, arms_m["PSM2"], "PSM2"))
    better, worse = sorted(fits, key=lambda fit: fit.ratio)
    clear = worse.ratio > CLEARLY_BETTER * max(better.ratio, _EXACT)
    warnings = []
    if requested == "auto":
        arm = better.arm
        if better.ratio > FOLLOWS_BELOW:
            warnings.append(f"no arm follows {MASTER[hand]}: {_residuals(fits)}; {arm} is used")
        elif not clear:
            warnings.append(f"both arms follow {MASTER[hand]} about equally: {_residuals(fits)}; {arm} is used")
    else:
        arm = (FOLLOWER if requested == "cross" else SAME_NAME)[hand]
        if arm == worse.arm and clear:
            warnings.append(
                f"{arm} is used for {MASTER[hand]} as told (pairing: {requested}), "
                f"but {better.arm} follows it: {_residuals(fits)}"
            )
    return Pairing(hand, arm, requested, fits, tuple(warnings))


def _residuals(fits: Sequence[ArmFit]) -> str:
    return "a static gain leaves " + " and ".join(str(fit) for fit in fits)
