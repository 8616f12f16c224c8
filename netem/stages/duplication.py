"""Duplication: some packets arrive twice. The delay of a copy is another draw from the same delay model."""

from tis.common.scenario.network.pipeline import Duplicate
from tis.common.streams import Address
from tis.netem.draws.blocks import SelectionBlocks


def duplicated(part: Duplicate | None, address: Address) -> SelectionBlocks:
    """Return the selection of duplicated packets (oracle: binomial, tests/netem/stages/test_duplication)."""
    return SelectionBlocks(address, "duplicate", 0.0 if part is None else part.p_duplicate)
