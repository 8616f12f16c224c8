"""Where a random number belongs: seed, direction, key, stage. Nothing else decides it."""

from typing import NamedTuple

from common.channels import Direction
from common.streams import Stream


class Address(NamedTuple):
    """A key in one direction of a run."""

    seed: int
    direction: Direction
    key: str

    def stream(self, stage: str, across_keys: bool = False) -> Stream:
        """Return the random numbers of one stage; ``across_keys``: those that all keys of the direction share."""
        return Stream.named(self.seed, f"{self.direction}/{'*' if across_keys else self.key}/{stage}")
