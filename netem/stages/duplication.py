"""Duplicates: some packets come twice. The copy's delay is a draw of its own, made by the delay's own model."""

from common.scenario.network.pipeline import Duplicate
from common.streams import Address
from netem.draws.chance import Chance


def duplicated(part: Duplicate | None, address: Address) -> Chance:
    """Return which packets come twice (oracle: the binomial distribution, tests/netem/stages/test_duplication)."""
    return Chance(address, "duplicate", 0.0 if part is None else part.p_duplicate)
