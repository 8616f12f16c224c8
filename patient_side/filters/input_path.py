"""A stream at a tick: arrived samples, interpolation between them, and a forecast by damped velocity and return.

A sample that has not arrived never repeats the last one: a moving hand continues to move.
"""

from typing import NamedTuple

import numpy as np

from tis.patient_side.linear_system import Array
from tis.patient_side.movement_models import InputForecast
from tis.patient_side.playout import SourceBuffer


class PathPoint(NamedTuple):
    """A position (3,) in m, and the distance in samples to the nearest arrived one: 0 when it is one itself."""

    position_m: Array
    distance: int


def damped_steps(damping: float, horizon: float) -> float:
    """Return ``phi + phi^2 + ... + phi^h`` in closed form, so that h >= 0 may be a fraction; h for phi = 1.

    Oracle: the sum itself for whole h.
    """
    if damping >= 1.0:
        return horizon
    return float(damping * (1.0 - damping**horizon) / (1.0 - damping))


def forecast_steps(forecast: InputForecast, horizon: float) -> float:
    """Return the distance that a forecast covers in ``horizon`` >= 0 samples, fractions included, in units of v.

    Oracle: the sum that defines `InputForecast`, for whole h.
    """
    going, returning = forecast.velocities()
    return going * damped_steps(forecast.damping, horizon) + returning * damped_steps(forecast.persistence, horizon)


def newest_velocity(buffer: SourceBuffer, span: int) -> Array:
    """Return the velocity (3,) at the newest arrived sample, in m per sample; zero when it is the only one.

    It is the mean over ``span`` samples, or, where that sample has not arrived, back to the arrived one nearest to
    it (of two equally near ones the older, whose difference is less noisy), at the true distance.
    """
    newest = buffer.newest
    wanted = newest - span
    older, younger = buffer.newest_before(wanted + 1), buffer.oldest_after(wanted)
    other = older if older >= 0 and (younger == newest or wanted - older <= younger - wanted) else younger
    here, there = buffer.get(newest), buffer.get(other)
    if here is None or there is None or other == newest:
        return np.zeros(3)
    return (here - there) / (newest - other)


def known_point(buffer: SourceBuffer, index: int) -> PathPoint:
    """Return the stream at ``index``, at or before its newest sample; at least one must have arrived.

    Between arrived samples it is interpolated linearly; before the oldest it equals the oldest.
    """
    arrived = buffer.get(index)
    if arrived is not None:
        return PathPoint(arrived, 0)
    older, younger = buffer.newest_before(index), buffer.oldest_after(index)
    left, right = buffer.get(older), buffer.get(younger)
    assert right is not None, "nothing has arrived at or after this index"
    if left is None:
        return PathPoint(right, younger - index)
    weight = (index - older) / (younger - older)
    return PathPoint((1.0 - weight) * left + weight * right, min(index - older, younger - index))


def continued(buffer: SourceBuffer, forecast: InputForecast, horizon: float) -> Array:
    """Return the forecast (3,) ``horizon`` samples, fractions included, after the newest: see `InputForecast`."""
    newest = buffer.get(buffer.newest)
    assert newest is not None, "nothing has arrived"
    return newest + newest_velocity(buffer, forecast.velocity_span) * forecast_steps(forecast, horizon)
