"""Inputs of the learned methods: the recent path in units of the hand's activity, and the age of the forecast.

All inputs and outputs are relative to the newest sample and in units of how fast the hand moves at present, so that
a model that was trained on fast people serves slow ones.
"""

from typing import Any, Final, NamedTuple

import numpy as np

from tis.patient_side.learned.layers import Array
from tis.patient_side.learned.window import COARSE, N_FINE, Window
from tis.patient_side.learned_model import Singles
from tis.patient_side.model_fields import Floats

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
