"""Inputs of the learned methods: the recent path in units of the hand's activity, and the age of the forecast.

All inputs and outputs are relative to the newest sample and in units of how fast the hand moves at present, so that
a model that was trained on fast people serves slow ones.
"""

from collections.abc import Callable
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tis.patient_side.learned.layers import Array
from tis.patient_side.learned_model import Singles
from tis.patient_side.model_fields import Floats

# The recent path of the arm as learned methods read it: samples at fixed lags, and which of them have arrived.

Bools = NDArray[np.bool_]

STEP_HZ: Final = 30
N_FINE: Final = 64
"""Increments of one step each; older samples are read at growing distances, 10 s back."""
N_RECENT: Final = 8
COARSE: Final = (70, 80, 95, 110, 130, 150, 180, 210, 250, 300)
LAGS: Final = np.array([*range(N_FINE + 1), *COARSE])
N_LAGS: Final = len(LAGS)
_LAGS: Final[list[int]] = LAGS.tolist()


class Window(NamedTuple):
    """The path before B newest samples, at the N_LAGS lags `LAGS`, in steps back; lag 0 is the newest sample.

    ``way_m`` (B, N_LAGS, 3) are positions and ``gripper_rad`` (B, N_LAGS) angles, relative to the newest sample's;
    ``present`` (B, N_LAGS) marks those that have arrived. The others are interpolated: see `filled`.
    """

    way_m: Floats
    gripper_rad: Floats
    present: Bools


def stride_of(rate_hz: int) -> int:
    """Return the number of samples in a step: a 30th of a second, or a sample where that is longer."""
    return max(1, round(rate_hz / STEP_HZ))


def has_gap(present: Bools) -> Bools:
    """Return which recent paths (B,), the last eight steps of ``present`` (B, N_LAGS), lack a sample."""
    return np.asarray(~np.all(present[:, : N_RECENT + 1], axis=1))


def window_before(
    newest: int,
    stride: int,
    sample: Callable[[int], Floats | None],
    gripper_rad: Callable[[int], float | None],
) -> Window:
    """Return the window (B = 1) before source index ``newest``, whose sample is known.

    ``sample`` returns the position (3,) at a source index, None for one that is missing, ``gripper_rad`` the angle.
    Oracle: `window_of_rows` on the same arrivals.
    """
    here, angle = sample(newest), gripper_rad(newest)
    assert here is not None, "the newest sample is known"
    places, angles_rad, present = [], [], []
    for lag in _LAGS:
        index = newest - lag * stride
        there = sample(index) if index >= 0 else None
        present.append(there is not None)
        places.append(here if there is None else there)
        then = None if there is None or angle is None else gripper_rad(index)
        angles_rad.append(0.0 if then is None or angle is None else then - angle)
    # one array from all: each write into an array would cost as much as reading a sample
    way_m = np.concatenate(places).reshape(1, N_LAGS, -1) - here
    return filled(way_m, np.array([angles_rad]), np.array([present]))


def window_of_rows(
    position_m: Floats, gripper_rad: Floats, arrival: Floats, newest: NDArray[np.int64], now: Floats, stride: int = 1
) -> Window:
    """Return the windows before rows ``newest`` (B,) at the instants ``now`` (B,), as a patient would see them.

    ``position_m`` (N, 3) and ``gripper_rad`` (N,) are a trial's rows, of which row i arrives at ``arrival`` (N,);
    instants are in samples.
    """
    index = newest[:, None] - LAGS * stride
    row = np.maximum(index, 0)
    present = (index >= 0) & (arrival[row] <= now[:, None])
    way_m = np.where(present[:, :, None], position_m[row] - position_m[newest][:, None], 0.0)
    angle = np.where(present, gripper_rad[row] - gripper_rad[newest][:, None], 0.0)
    return filled(way_m, angle, present)


def filled(way_m: Floats, gripper_rad: Floats, present: Bools) -> Window:
    """Return the window with linear interpolation between arrived samples; before the oldest one nothing moves."""
    if present.all():
        return Window(way_m, gripper_rad, present)
    # The arrived sample at or after each lag, which lag 0 always has, and the one at or before it.
    order = np.arange(N_LAGS)
    after = np.maximum.accumulate(np.where(present, order, 0), axis=1)
    before = np.minimum.accumulate(np.where(present, order, N_LAGS)[:, ::-1], axis=1)[:, ::-1]
    before = np.where(before == N_LAGS, after, before)
    span = LAGS[before] - LAGS[after]
    share = np.where(span > 0, (LAGS - LAGS[after]) / np.maximum(span, 1), 0.0)
    row = np.arange(len(present))[:, None]
    ways = (1.0 - share)[:, :, None] * way_m[row, after] + share[:, :, None] * way_m[row, before]
    angles = (1.0 - share) * gripper_rad[row, after] + share * gripper_rad[row, before]
    return Window(ways, angles, present)


N_STEP: Final = 8
"""Inputs of a step: increment (3), way (3), presence, gripper."""
N_CONTEXT: Final = 5 * len(COARSE) + 2
N_AGE: Final = 7
N_BASE: Final = 3

_FLOOR: Final = 0.02
"""Square of the activity of a hand at rest, in units of the usual one."""
_INCREMENT: Final = 2.0
_WAY: Final = 0.25


class Scaled(NamedTuple):
    """A window in units of the hand's activity: see `scaled`.

    ``way`` (B, N_LAGS, 3), ``gripper`` (B, N_LAGS), ``present`` (B, N_LAGS), and ``pace`` (B,), the logarithm of the
    activity.
    """

    way: Array
    gripper: Array
    present: Array
    pace: Array


class Inputs(NamedTuple):
    """``steps`` (B, 64, 8), the newest first, and ``context`` (B, 52) of older samples, gripper and activity."""

    steps: Array
    context: Array


def activity_of(window: Window, usual_m: float) -> Floats:
    """Return how fast the hand moves (B,), in units of the usual size of an increment: an rms over two seconds."""
    increments = np.diff(window.way_m[:, : N_FINE + 1], axis=1) / usual_m
    return np.asarray(np.sqrt(np.sum(increments**2, axis=(1, 2)) / N_FINE + _FLOOR))


def scaled(window: Window, activity: Floats, usual_m: float, spread_rad: float) -> Scaled:
    """Return windows in single precision, in units of ``activity`` (B,) and of the gripper's spread, if it moves."""
    way = (window.way_m / (usual_m * activity)[:, None, None]).astype(np.float32)
    gripper = (window.gripper_rad / spread_rad if spread_rad > 0 else 0.0 * window.gripper_rad).astype(np.float32)
    return Scaled(way, gripper, window.present.astype(np.float32), np.log(activity).astype(np.float32))


def inputs_of(xp: Any, window: Scaled, *, zero_lost: bool) -> Inputs:
    """Return the inputs of windows, on arrays of the library ``xp``; ``zero_lost``: all of a missing sample is 0.

    Inverse hyperbolic sines bound the effect of large moves.
    """
    way, gripper, present, pace = window
    increments = xp.arcsinh(_INCREMENT * (way[:, :N_FINE] - way[:, 1 : N_FINE + 1]))
    ways = xp.arcsinh(_WAY * way) / 2.0
    # The opening itself is known by the way from the window's oldest fine sample.
    opening = -gripper[:, N_FINE, None]
    if zero_lost:
        both = present[:, :N_FINE] * present[:, 1 : N_FINE + 1]
        increments, ways, gripper = increments * both[:, :, None], ways * present[:, :, None], gripper * present
    steps = xp.concatenate(
        [increments, ways[:, :N_FINE], present[:, :N_FINE, None], gripper[:, :N_FINE, None]], axis=2
    )
    old = slice(N_FINE + 1, None)
    older = ways[:, old].reshape(len(way), -1)
    context = xp.concatenate([older, present[:, old], gripper[:, old], opening, pace[:, None]], axis=1)
    return Inputs(steps, context)


def age_inputs(ages: Floats) -> Singles:
    """Return the inputs (..., 7) that describe ages (...), in steps: their logarithm, phase within a step, decays."""
    x = np.log(ages / 6.0)
    turn = 2.0 * np.pi * ages
    found = [
        x / 2.0,
        np.tanh(x),
        np.sin(turn),
        np.cos(turn),
        np.exp(-ages / 3),
        np.exp(-ages / 10),
        np.exp(-ages / 30),
    ]
    return np.stack(found, axis=-1).astype(np.float32)
