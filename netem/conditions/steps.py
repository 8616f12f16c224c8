"""A delay in steps: on top of the pipeline's, with another value at equal intervals of run time."""

from collections.abc import Iterable, Sequence
from typing import Final

import numpy as np

from tis.common.channels import Direction
from tis.common.scenario.network.conditions import Steps
from tis.common.scenario.network.delay import UniformDelay
from tis.common.streams import Stream
from tis.common.units import NS_PER_MS, s_to_ns
from tis.netem.draws import grid
from tis.netem.draws.blocks import Floats
from tis.netem.draws.grid import Path, Stretch

_LEVELS: Final = 32


class StepPath(Path):
    """The added delay in ns at each run time; uniform k of its stream decides value k, so in any order of access.

    Each nominal edge moves to its nearest cell by itself. Oracle: cell by cell, tests/netem/conditions/test_steps.
    """

    def __init__(self, part: Steps, stream: Stream) -> None:
        self._part = part
        self._stream = stream
        self._every_ns = s_to_ns(part.every_s)
        self._first_ns = self._every_ns if part.first_s is None else s_to_ns(part.first_s)

    def at(self, cell: int) -> Stretch:
        """Return the stretch of one value that contains ``cell`` >= 0."""
        number = max(0, (grid.deciding_ns(cell) - self._first_ns) // self._every_ns + 1)
        end_ns = self._first_ns + number * self._every_ns
        begin = grid.nearest_cell(end_ns - self._every_ns) if number else 0
        value_ms = float(quantiles_ms(self._part, np.array([self._stream.uniform(number)]))[0])
        return Stretch(begin, grid.nearest_cell(end_ns), round(value_ms * NS_PER_MS))


def steps_of(parts: Iterable[Steps], direction: Direction, seed: int) -> tuple[StepPath, ...]:
    """Return the steps of one direction; those of both directions draw from one shared stream."""
    return tuple(
        StepPath(part, Stream.named(seed, f"{part.direction}/*/steps/{index}"))
        for index, part in enumerate(parts)
        if part.direction in (direction, "both")
    )


def quantiles_ms(part: Steps, u: Floats) -> Floats:
    """Return the values in ms for uniforms, same shape."""
    of = part.delay
    if isinstance(of, UniformDelay):
        return of.low_ms + u * (of.high_ms - of.low_ms)
    return np.interp(u, [point.p for point in of.points], [point.delay_ms for point in of.points])


def levels_ms(parts: Sequence[Steps], direction: Direction) -> Floats:
    """Return 32 equally likely values of the sum of all steps of a direction, in ms; a single 0 without any.

    The mean is that of the steps but for bends of their distributions.
    """
    shares = (np.arange(_LEVELS) + 0.5) / _LEVELS
    total = np.zeros(1)
    for part in parts:
        if part.direction in (direction, "both"):
            every = np.sort(np.add.outer(total, quantiles_ms(part, shares)).ravel())
            total = every.reshape(_LEVELS, -1).mean(axis=1)
    return total
