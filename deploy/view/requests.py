"""Requests of a page to netem and to the patient: the message, checked like all from outside, and who acts on it."""

from collections.abc import Callable
from typing import Annotated, Final, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

from tis.deploy.view.steering import Steering

Ask = Literal["stop", "release", "reset", "outage", "delay", "loss", "profile", "task"]

MAX_OUTAGE_MS: Final = 60_000.0
MAX_DELAY_MS: Final = 10_000.0
RANGES: Final[dict[Ask, tuple[float, float]]] = {
    "outage": (1.0, MAX_OUTAGE_MS),
    "delay": (0.0, MAX_DELAY_MS),
    "loss": (0.0, 100.0),
    "task": (0.0, MAX_DELAY_MS),
}
"""Smallest and largest value by request: ms, of loss percent; of a task the delay there and back."""


class PageRequest(BaseModel):
    """A request of a page; ``task`` is the scenario's own network with a delay that both ways share."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)

    ask: Ask
    way: Literal["both", "forward", "feedback"] = "both"
    value: Annotated[float | None, Field(allow_inf_nan=False)] = None
    profile: Annotated[str, Field(max_length=100, pattern=r"^\w*$")] = ""

    @model_validator(mode="after")
    def _has_its_value(self) -> Self:
        if self.ask in RANGES:
            low, high = RANGES[self.ask]
            if self.value is None or not low <= self.value <= high:
                raise ValueError(f"value of {self.ask} must be a number from {low:g} to {high:g}")
        return self


def ask(steering: Steering, request: PageRequest, on_answer: Callable[[str], None]) -> None:
    """Do what a page asks; ``on_answer`` gets the answer in words, in another thread.

    Oracle: calls noted by a stand-in, tests/deploy/view/test_requests.
    """
    value = request.value or 0.0
    match request.ask:
        case "stop":
            steering.stop(on_answer)
        case "release":
            steering.release(on_answer)
        case "reset":
            steering.reset(on_answer)
        case "outage":
            steering.outage(request.way, value, on_answer)
        case "delay":
            steering.set_stage(request.way, f"delay.delay_ms={value:g}", on_answer)
        case "loss":
            steering.set_stage(request.way, f"loss.p_loss={value / 100:g}", on_answer)
        case "profile":
            steering.profile(request.profile, on_answer)
        case "task":
            steering.only_delay(value / 2, on_answer)
