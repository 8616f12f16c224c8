"""Commands that stand in for missing arm samples of the same instants, where a gain alone relates the two."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from tis.patient_side.filters.innovations_filter import AXES
from tis.patient_side.linear_system import Array
from tis.patient_side.playout import Playout
from tis.patient_side.statespace import ArmModel

PAIRS = 4
"""Samples over which the offset between arm and command is averaged: few, as it changes with the clutch."""

_NOTHING = np.zeros(AXES)


class Offset(NamedTuple):
    """The arm less the gain times the command (3,) in m, and the covariance (3, 3) of the arm about this relation."""

    offset_m: Array
    error_m2: Array


@dataclass(frozen=True, eq=False)
class StandIn:
    """The relation ``arm = gain command + offset``, with a first guess at the offset.

    ``errors_m2[n]`` (3, 3) is the covariance of the arm about it when the offset is a mean over n samples.
    """

    gain: Array
    guess: Offset
    errors_m2: tuple[Array, ...]

    @property
    def error_m2(self) -> Array:
        """Return the relation's own error (3, 3), for a known offset."""
        return self.errors_m2[0]

    @classmethod
    def of(cls, model: ArmModel) -> "StandIn | None":
        """Return the relation of an arm to its command, None where it is more than a gain.

        The offset of a model of other trials belongs to their set-ups: its error may be as large as the arm's range.
        """
        if not model.static:
            return None
        gain, error = model.space.D, model.noise.R
        unknown = np.zeros(AXES) if model.train == "own_head" else model.output_high_m - model.output_low_m
        guess = Offset(model.output_offset_m - gain @ model.input_offset_m, error + np.diag(unknown**2))
        # A mean over n samples has an error of its own, 1/n of a sample's.
        means = tuple((1.0 + 1.0 / n) * error for n in range(1, PAIRS + 1))
        return cls(gain, guess, (error, *means))

    def offset(self, pairs: tuple[int, ...], playout: Playout) -> Offset:
        """Return the mean offset at the samples ``pairs`` that both streams have; without any, the first guess."""
        of_arm, of_command, n = playout.arm.get, playout.command.get, 0
        arms = commands = _NOTHING
        for i in pairs:
            arm, command = of_arm(i), of_command(i)
            if arm is not None and command is not None:
                arms, commands, n = (arms + arm, commands + command, n + 1) if n else (arm, command, 1)
        return Offset((arms - self.gain.dot(commands)) / n, self.errors_m2[n]) if n else self.guess
