"""Duplicates: some packets come twice. The copy's delay is a draw of its own, made by the delay's own model."""

from common.address import Address
from common.scenario.network.pipeline import Duplicate
from netem.draws.blocks import SelectionBlocks


def duplicated(part: Duplicate | None, address: Address) -> SelectionBlocks:
    """Return which packets come twice (oracle: the binomial distribution, tests/netem/stages/test_duplication)."""
    return SelectionBlocks(address, "duplicate", 0.0 if part is None else part.p_duplicate)
