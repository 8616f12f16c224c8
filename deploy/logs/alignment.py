"""Clock models of the sides, for merging."""

from collections.abc import Mapping

from tis.common.channels import Side
from tis.common.clocks import SHARED, ClockModel

Clocks = Mapping[Side, ClockModel]


def clock_of(clocks: Clocks, side: Side) -> ClockModel:
    """Return a side's model against the reference, which is netem's clock; a side without one is the reference."""
    return clocks.get(side, SHARED)
