"""Pairing of masters and arms: found in the data, or configured and then checked against the data.

A da Vinci arm repeats its master's movement scaled and shifted, so the arm that follows is the one whose movement a
static affine map of the master's positions explains almost completely. The labels left and right do not determine it.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final, Literal

import numpy as np
import scipy

from tis.common.channels import FOLLOWER, MASTER, SAME_NAME, Arm, Hand
from tis.common.sources.trajectory import Array, HandRecording
from tis.common.units import MM_PER_M

Requested = Literal["auto", "cross", "same_name"]

FOLLOWS_BELOW: Final = 0.2
"""Residual ratio above which no arm follows: true pairs lie below 0.01, false ones above 0.5."""
CLEARLY_BETTER: Final = 2.0
"""Ratio of two residual ratios from which one arm follows clearly better than the other."""

_ARMS: Final[tuple[Arm, Arm]] = ("PSM1", "PSM2")
_EXACT: Final = 1e-6  # smaller ratios are rounding errors (fewer rows than the map has parameters)
_LAGS_HZ: Final = (None, 1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 10.0, 20.0)
_FINER_LAGS_HZ: Final = (*_LAGS_HZ, *(1.05**k for k in range(1, 61)))
"""With those between; one of them is within 2.5 % of any lag."""
_MOST_ROWS: Final = 5000
_CLEARLY_LESS: Final = 0.99
_LATEST_S: Final = 0.5
_LITTLE_LEFT: Final = 0.05
_DELAY_STEP_S: Final = 0.02
"""A delay between two steps is wrong by 10 ms at most: 13 % of a movement of 2 Hz."""
_STILL_M: Final = 1e-6  # the recordings' resolution: an arm that moves less stands still


@dataclass(frozen=True)
class ArmFit:
    """Residual of a static affine map from master to arm, rms of its length; ``ratio`` is over the movement's."""

    arm: Arm
    residual_rms_m: float
    ratio: float

    def __str__(self) -> str:
        return f"{self.residual_rms_m * MM_PER_M:.3f} mm rms of {self.arm} ({100 * self.ratio:.1f} %)"


@dataclass(frozen=True)
class LateFit:
    """The fit of a gain behind the first-order lag and the delay that leave least; ``lag_hz`` None without a lag."""

    fit: ArmFit
    lag_hz: float | None
    delay_s: float

    def __str__(self) -> str:
        parts = [] if self.lag_hz is None else [f"a lag of {self.lag_hz:.2g} Hz"]
        parts += [f"a delay of {1000 * self.delay_s:.0f} ms"] if self.delay_s or not parts else []
        return f"behind {' and '.join(parts)} {self.fit}"


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


Positions = tuple[Mapping[Hand, Array], Mapping[Arm, Array]]
"""Positions (N, 3) in m of the masters, by hand, and of the arms, in one recording."""


def fit_arm(command_m: Array, arm_m: Array, arm: Arm) -> ArmFit:
    """Fit ``arm ~ G command + c`` by least squares (G 3x3) to positions (N, 3) in m.

    The ratio of an arm that stands still is 1. Oracle: maps and noise that the tests generate.
    """
    return _pooled_fit([(command_m, arm_m)], arm)


def fit_late_arm(command_m: Array, arm_m: Array, arm: Arm, rate_hz: float) -> LateFit:
    """Fit ``arm ~ G late command + c`` to positions (N, 3) in m, over lags of 1 to 20 Hz and delays up to 0.5 s.

    Lags in finer steps, each with the rows of delay that make the arm as late, follow on coarse ones with coarse
    delays. The first rows, half a second and at most a quarter, only fill lag and delay. Oracle: arms that lag, in
    the tests.
    """
    n_skipped = min(round(_LATEST_S * rate_hz), len(command_m) // 4)
    step, every = max(1, round(_DELAY_STEP_S * rate_hz)), max(1, len(command_m) // _MOST_ROWS)
    followed_m = arm_m[n_skipped::every]

    def best(candidates: Iterable[tuple[float | None, Iterable[int]]]) -> LateFit:
        behind = [
            LateFit(fit_arm(late_m[n_skipped - k : len(late_m) - k : every], followed_m, arm), lag_hz, k / rate_hz)
            for lag_hz, delays in candidates
            for late_m in [_lagged(command_m, lag_hz, rate_hz)]
            for k in delays
        ]
        return min(behind, key=lambda one: one.fit.ratio)

    def near(lag_hz: float | None) -> range:
        k = round((late_s - _lateness_s(lag_hz)) * rate_hz)
        return range(max(0, k - step), min(n_skipped, k + step) + 1, max(1, step // 4))

    found = best((lag_hz, range(0, n_skipped + 1, step)) for lag_hz in _LAGS_HZ)
    late_s = found.delay_s + _lateness_s(found.lag_hz)
    finer = best([(found.lag_hz, [round(found.delay_s * rate_hz)]), *((lag, near(lag)) for lag in _FINER_LAGS_HZ)])
    return finer if finer.fit.ratio < _CLEARLY_LESS * found.fit.ratio else found


def _lateness_s(lag_hz: float | None) -> float:
    """Return how late slow movements are behind a lag."""
    return 0.0 if lag_hz is None else 1.0 / (2.0 * np.pi * lag_hz)


def lead_s(command_m: Array, arm_m: Array, arm: Arm, rate_hz: float) -> float:
    """Return for how long the arm (N, 3) moves before its command does; 0 where it is not clearly so.

    Clearly: what the arm did explains the command with at most half of what any delay of the command leaves of the
    arm, and that is not little. Of a periodic movement either explains the other.
    """
    n_skipped = min(round(_LATEST_S * rate_hz), len(arm_m) // 4)
    delays = range(0, n_skipped + 1, max(1, round(_DELAY_STEP_S * rate_hz)))

    def left(before_m: Array, after_m: Array) -> dict[int, float]:
        n = len(before_m)
        return {k: fit_arm(before_m[n_skipped - k : n - k], after_m[n_skipped:], arm).ratio for k in delays}

    late, early = min(left(command_m, arm_m).values()), left(arm_m, command_m)
    best = min(early, key=early.__getitem__)
    return best / rate_hz if late > _LITTLE_LEFT and early[best] < min(FOLLOWS_BELOW, late / 2.0) else 0.0


def follows(hand: HandRecording, rows: range, rate_hz: float) -> tuple[str, list[str]]:
    """Return how well the arm follows in these rows, and warnings where it does not."""
    command_m, arm_m = (track.position_m[rows.start : rows.stop] for track in (hand.command, hand.follower))
    fit = fit_arm(command_m, arm_m, hand.arm)
    text, warnings = f"a static gain leaves {fit}", []
    among = f"in rows {rows.start} to {rows.stop - 1}"
    if fit.ratio > FOLLOWS_BELOW:
        late = fit_late_arm(command_m, arm_m, hand.arm, rate_hz)
        text += f", {late}"
        if late.fit.ratio > FOLLOWS_BELOW:
            warnings = [f"{hand.arm} does not follow {MASTER[hand.hand]}, not even late: {text}, {among}"]
    if early_s := lead_s(command_m, arm_m, hand.arm, rate_hz):
        ms = round(1000 * early_s)
        warnings += [f"{hand.arm} moves {ms} ms before {MASTER[hand.hand]}, which commands it, {among}"]
    return text, warnings


def _lagged(command_m: Array, lag_hz: float | None, rate_hz: float) -> Array:
    """Return positions behind a first-order lag that begins at rest at the first one."""
    if lag_hz is None:
        return command_m
    kept = float(np.exp(-2.0 * np.pi * lag_hz / rate_hz))
    moved_m = scipy.signal.lfilter([1.0 - kept], [1.0, -kept], command_m - command_m[:1], axis=0)
    return np.asarray(command_m[:1] + moved_m)


def pair_over(requested: Requested, hands: Sequence[Hand], recordings: Sequence[Positions]) -> tuple[Pairing, ...]:
    """Return the arm of each hand, from recordings that each have a map of their own: set-ups differ.

    They must not include scored rows. ``auto`` takes the arm with the smaller residual ratio. If both hands would get
    the same arm, both are crossed instead, with a warning.
    """
    pairings = tuple(_pair(requested, hand, _fits(hand, recordings)) for hand in hands)
    if len({pairing.arm for pairing in pairings}) == len(pairings):
        return pairings
    clash = f"both masters seem to drive {pairings[0].arm}: crossed instead"
    return tuple(
        Pairing(p.hand, FOLLOWER[p.hand], p.requested, p.fits, (f"{clash}; {_residuals(p.fits)}",)) for p in pairings
    )


def contradictions(pairings: Sequence[Pairing], recording: Positions, why: str) -> tuple[Pairing, ...]:
    """Return the pairings with a warning where another arm follows clearly better in ``recording``."""
    return tuple(
        replace(pairing, warnings=(*pairing.warnings, *_contradiction(pairing.hand, pairing.arm, fits, why)))
        for pairing in pairings
        for fits in [_fits(pairing.hand, [recording])]
    )


def _pooled_fit(pairs: Sequence[tuple[Array, Array]], arm: Arm) -> ArmFit:
    left, moved, n_rows = 0.0, 0.0, 0
    for command_m, arm_m in pairs:
        # Centring both removes the constant c from the fit.
        centred, regressors = arm_m - arm_m.mean(axis=0), command_m - command_m.mean(axis=0)
        gain, *_ = np.linalg.lstsq(regressors, centred)
        left += float(np.sum((centred - regressors @ gain) ** 2))
        moved += float(np.sum(centred**2))
        n_rows += len(centred)
    moves_m, residual_m = (moved / n_rows) ** 0.5, (left / n_rows) ** 0.5
    if moves_m < _STILL_M:
        return ArmFit(arm, moves_m, 1.0)
    return ArmFit(arm, residual_m, residual_m / moves_m)


def _fits(hand: Hand, recordings: Sequence[Positions]) -> tuple[ArmFit, ArmFit]:
    first, second = (
        _pooled_fit([(commands_m[hand], arms_m[arm]) for commands_m, arms_m in recordings], arm) for arm in _ARMS
    )
    return first, second


def _pair(requested: Requested, hand: Hand, fits: tuple[ArmFit, ArmFit]) -> Pairing:
    if requested != "auto":
        arm = (FOLLOWER if requested == "cross" else SAME_NAME)[hand]
        return Pairing(hand, arm, requested, fits, _contradiction(hand, arm, fits, f"told (pairing: {requested})"))
    better, worse = sorted(fits, key=lambda fit: fit.ratio)
    warnings = []
    if better.ratio > FOLLOWS_BELOW:
        warnings.append(f"no arm follows {MASTER[hand]}: {_residuals(fits)}; {better.arm} is used")
    elif not _is_clear(better, worse):
        warnings.append(f"both arms follow {MASTER[hand]} about equally: {_residuals(fits)}; {better.arm} is used")
    return Pairing(hand, better.arm, requested, fits, tuple(warnings))


def _contradiction(hand: Hand, arm: Arm, fits: tuple[ArmFit, ArmFit], why: str) -> tuple[str, ...]:
    better, worse = sorted(fits, key=lambda fit: fit.ratio)
    if arm == better.arm or not _is_clear(better, worse):
        return ()
    return (f"{arm} is used for {MASTER[hand]} as {why}, but {better.arm} follows it: {_residuals(fits)}",)


def _is_clear(better: ArmFit, worse: ArmFit) -> bool:
    return worse.ratio > CLEARLY_BETTER * max(better.ratio, _EXACT)


def _residuals(fits: Sequence[ArmFit]) -> str:
    return "a static gain leaves " + " and ".join(str(fit) for fit in fits)
