"""The topics of a merged file: every record of the three logs once, and what viewers draw beside them.

A side's own topic T is ``/SIDE/T``: two sides log the same keys. What viewers draw is of the scenario's first hand
under the plain name, and of the second under ``NAME/HAND``.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from common.channels import FOLLOWER, Arm, Hand, HandChannels, Side, hand_channels
from common.scenario import Scenario

MTM: Final = "/mtm"
PSM: Final = "/psm"
PLANT_ARM: Final = "/plant"
ESTIMATE: Final = "/estimates"
PATH: Final = "/paths"
TRANSFORMS: Final = "/tf"
LOG: Final = "/log"
ERROR: Final = "/metrics/error"
AGE: Final = "/metrics/age"
DELAY: Final = "/metrics/delay"
TRUTH_NAME: Final = "truth"


def merged_topic(side: Side, topic: str) -> str:
    """Return the topic of a side's record in the merged file."""
    return f"/{side}/{topic.lstrip('/')}"


@dataclass(frozen=True)
class RunTopics:
    """The run as its topics need it: its channels by hand, the first hand first."""

    session: str
    rate_hz: int
    channels: Sequence[HandChannels]

    @classmethod
    def of(cls, scenario: Scenario, arms: Mapping[Hand, Arm]) -> "RunTopics":
        """Return a scenario's; ``arms`` says which arm each hand drives, where that is known."""
        rows = [hand_channels(hand, arms.get(hand, FOLLOWER[hand])) for hand in scenario.source.hands]
        return cls(scenario.session, scenario.rate_hz, rows)

    def of_hand(self, topic: str, hand: Hand) -> str:
        """Return a drawn topic's name for one hand."""
        return topic if hand == self.channels[0].hand else f"{topic}/{hand}"

    @property
    def hands(self) -> tuple[Hand, ...]:
        """Return the hands in the scenario's order."""
        return tuple(row.hand for row in self.channels)
