"""Topics of a merged file: the records of the three logs, and messages for viewers.

A side's topic T becomes ``/SIDE/T``, as two sides log the same keys. Messages for viewers have a plain name for the
scenario's first hand, and ``NAME/HAND`` for the second.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from tis.common.channels import FOLLOWER, Arm, Hand, HandChannels, Side, hand_channels
from tis.common.scenario import Scenario

MTM: Final = "/mtm"
PSM: Final = "/psm"
PLANT_ARM: Final = "/plant"
SET_POINT: Final = "/set_point"
ESTIMATE: Final = "/estimates"
PATH: Final = "/paths"
TRANSFORMS: Final = "/tf"
LOG: Final = "/log"
ERROR: Final = "/metrics/error"
TURN_ERROR: Final = "/metrics/orientation_error"
AGE: Final = "/metrics/age"
DELAY: Final = "/metrics/delay"
TRUTH_NAME: Final = "truth"


def merged_topic(side: Side, topic: str) -> str:
    """Return the topic of a side's record in the merged file."""
    return f"/{side}/{topic.lstrip('/')}"


@dataclass(frozen=True)
class RunTopics:
    """The channels of a run by hand, the first hand first."""

    session: str
    rate_hz: int
    channels: Sequence[HandChannels]
    active_orientation: str = "hold"

    @classmethod
    def of(cls, scenario: Scenario, arms: Mapping[Hand, Arm]) -> "RunTopics":
        """Return a scenario's topics; ``arms`` maps hands to the arms that they drive, where known."""
        rows = [hand_channels(hand, arms.get(hand, FOLLOWER[hand])) for hand in scenario.source.hands]
        return cls(scenario.session, scenario.rate_hz, rows, scenario.patient.orientation.active)

    def of_hand(self, topic: str, hand: Hand) -> str:
        """Return a drawn topic's name for one hand."""
        return topic if hand == self.channels[0].hand else f"{topic}/{hand}"

    @property
    def hands(self) -> tuple[Hand, ...]:
        """Return the hands in the scenario's order."""
        return tuple(row.hand for row in self.channels)
