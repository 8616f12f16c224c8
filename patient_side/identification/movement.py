"""Reach, speed and acceleration of the positions of training rows, from which limits of a run follow."""

from collections.abc import Sequence
from dataclasses import astuple
from typing import Final

import numpy as np

from tis.common.scenario import Scenario
from tis.common.units import NS_PER_S
from tis.patient_side.linear_system import Array
from tis.patient_side.safety.gate import BASE_NS
from tis.patient_side.safety.trained_limits import Three
from tis.patient_side.statespace import Movement

_SHARE: Final = 0.999
"""Share of the rows that count: a jump of a recorder is no movement."""


def movement_of(positions_m: Sequence[Array], offset_m: Array, rate_hz: int) -> Movement:
    """Return the movement of trials' positions (N, 3) about ``offset_m``, at ``rate_hz`` rows per second.

    Velocities are over the time of the gate, which measures the samples of a run. Oracle: a circle and a jump,
    test_movement.
    """
    rows = max(1, round(BASE_NS * rate_hz / NS_PER_S))
    speeds, changes = [], []
    for position_m in positions_m:
        velocity = (position_m[rows:] - position_m[:-rows]) * (rate_hz / rows)
        speeds.append(np.linalg.norm(velocity, axis=1))
        changes.append(np.linalg.norm(velocity[rows:] - velocity[:-rows], axis=1) * (rate_hz / rows))
    reaches = [np.linalg.norm(position_m - offset_m, axis=1) for position_m in positions_m]
    return Movement(*(_most(parts) for parts in (reaches, speeds, changes)))


def trained(scenario: Scenario, movement: Movement | None) -> Three | None:
    """Return the movement of training rows from which limits of a run follow; None unless it plays a table.

    An arm outside the testbed keeps the usual limits until a person gives others: a table says nothing of its room.
    """
    is_played = scenario.source.kind == "table" and scenario.patient.plant.kind != "external"
    return astuple(movement) if is_played and movement else None


def _most(parts: Sequence[Array]) -> float:
    values = np.concatenate(parts)
    return float(np.quantile(values, _SHARE, method="lower")) if len(values) else 0.0
