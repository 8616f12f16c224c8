"""How the surgeon's side puts samples on the wire: how often each one goes out, and what rides along."""

from typing import Annotated, Final, Self

from pydantic import Field, model_validator

from common.scenario.base import Part

LAST_COPY_WITHIN_MS: Final = 5000
"""After so long a patient's forecast stays where it is (`patient_side.horizon`): a later copy brings nothing."""

MOST_PACKETS_PER_S: Final = 50_000
"""Two thirds of what the emulator was measured to pass on."""

MOST_MB_PER_S: Final = 100
"""A gigabit link carries 125, headers below Zenoh's included."""

_POSE_BYTES: Final = 250
_ATTACHMENT_BYTES: Final = 20

Copies = Annotated[int, Field(strict=True, ge=1, le=64)]
History = Annotated[int, Field(strict=True, ge=0, le=256)]
CopySpacing = Annotated[float, Field(ge=0, le=LAST_COPY_WITHIN_MS)]


class SurgeonPart(Part):
    """How the surgeon's side puts samples on the wire."""

    copies: Copies = Field(
        1, description="How often each sample is sent, each time as a packet of its own with a fate of its own."
    )
    copy_spacing_ms: CopySpacing = Field(
        0.0,
        description="Time between the copies of a sample, in ms; 0: all at once, which is best where packets are "
        "delayed independently. Where delays hang together, copies spread over the sample period meet different "
        "moments of the network; further apart newer samples overtake them. The last copy must leave within "
        f"{LAST_COPY_WITHIN_MS} ms of its sample.",
    )
    history: History = Field(0, description="How many of the samples before it ride in each packet.")

    @model_validator(mode="after")
    def _last_copy_in_time(self) -> Self:
        last_ms = (self.copies - 1) * self.copy_spacing_ms
        if last_ms > LAST_COPY_WITHIN_MS:
            raise ValueError(
                f"copy_spacing_ms must let the last of {self.copies} copies leave within {LAST_COPY_WITHIN_MS} ms of "
                f"its sample, after which nothing is forecast from it: at most "
                f"{LAST_COPY_WITHIN_MS / (self.copies - 1):.4g}, or fewer copies (got {last_ms:g} ms)"
            )
        return self

    def packets_per_s(self, rate_hz: int, n_hands: int) -> int:
        """Return how many packets a second go out, on two keys a hand."""
        return self.copies * rate_hz * 2 * n_hands

    def mb_per_s(self, rate_hz: int, n_hands: int) -> float:
        """Return about how many MB a second these are, payload and attachment."""
        each = _ATTACHMENT_BYTES + _POSE_BYTES * (1 + self.history)
        return self.packets_per_s(rate_hz, n_hands) * each / 1e6

    def warnings(self) -> list[str]:
        """Return what is set and has no effect, in words; no fault, since sweeps over copies keep their spacing."""
        if self.copy_spacing_ms and self.copies == 1:
            return ["surgeon.copy_spacing_ms has no effect: each sample is sent once (surgeon.copies is 1)"]
        return []
