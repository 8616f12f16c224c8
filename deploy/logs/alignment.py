"""The sides' clocks, as merging needs them."""

from collections.abc import Mapping

from common.channels import Side
from common.clocks.model import SHARED, ClockModel

Clocks = Mapping[Side, ClockModel]


def clock_of(clocks: Clocks, side: Side) -> ClockModel:
    """Return a side's model against the reference, which is netem's; without one it is taken to be the reference."""
    return clocks.get(side, SHARED)
