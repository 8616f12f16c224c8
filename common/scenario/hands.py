"""Fields that all sources share: the hands that move, and the row at which a run begins."""

from typing import Annotated, Final, Literal

from pydantic import AfterValidator, Field

from tis.common.channels import Hand
from tis.common.scenario.base import RuleText

Start = Annotated[
    Annotated[int, Field(ge=0, strict=True)] | Literal["auto"],
    RuleText("must be a row number (an integer >= 0) or 'auto'"),
]

START_MEANING: Final = (
    "Row that becomes sample 0, from 0; auto: the first row after the training rows of own_head, else row 0."
)
HANDS_MEANING: Final = "Masters that move: left, right or both."


def _distinct(hands: tuple[Hand, ...]) -> tuple[Hand, ...]:
    if len(set(hands)) != len(hands):
        raise ValueError("must name each hand at most once")
    return hands


Hands = Annotated[tuple[Hand, ...], Field(min_length=1, max_length=2), AfterValidator(_distinct)]
