"""Samples on the wire: copies of each, history in each packet, and the noise of the sensors."""

from typing import Annotated, Final, Self

from pydantic import Field, model_validator

from tis.common.messages import MAX_HISTORY
from tis.common.scenario.base import Part

MAX_COPY_DELAY_MS: Final = 5000
"""Age up to which the patient forecasts from a sample (`tis.patient_side.horizon`); later copies are useless."""

MAX_PACKETS_PER_S: Final = 50_000
"""Two thirds of the emulator's measured throughput."""

MAX_MB_PER_S: Final = 100
"""Below the 125 MB/s of a gigabit link, which include the headers of lower layers."""

_POSE_BYTES: Final = 250
_ATTACHMENT_BYTES: Final = 20

Copies = Annotated[int, Field(strict=True, ge=1, le=64)]
History = Annotated[int, Field(strict=True, ge=0, le=MAX_HISTORY)]
SensorNoise = Annotated[float, Field(ge=0, le=100)]
CopySpacing = Annotated[float, Field(ge=0, le=MAX_COPY_DELAY_MS)]


class SurgeonPart(Part):
    """Redundancy of the surgeon's transmissions, and the noise of the sensors."""

    copies: Copies = Field(
        1, description="Number of times that each sample is sent; each copy is a packet with its own loss and delay."
    )
    copy_spacing_ms: CopySpacing = Field(
        0.0,
        description="Time between the copies of a sample, in ms. 0, all at once, is best where packets are delayed "
        "independently. Where delays are correlated, spread the copies over a sample period; with a wider spacing "
        f"newer samples overtake them. The last copy must leave within {MAX_COPY_DELAY_MS} ms of its sample.",
    )
    history: History = Field(0, description="Number of preceding samples that each packet carries as well.")
    sensor_noise_mm: SensorNoise = Field(
        0.0,
        description="Standard deviation of an error that is added to each axis of each position that is sent, of "
        "command and arm, in mm: normal, independent from sample to sample, and the same in all copies. The truth "
        "that estimates are scored against stays as recorded; `identification.sensor_noise_mm` is that of the rows "
        "that models are identified on.",
    )

    @model_validator(mode="after")
    def _last_copy_in_time(self) -> Self:
        last_ms = (self.copies - 1) * self.copy_spacing_ms
        if last_ms > MAX_COPY_DELAY_MS:
            raise ValueError(
                f"copy_spacing_ms must let the last of {self.copies} copies leave within {MAX_COPY_DELAY_MS} ms of "
                f"its sample, after which nothing is forecast from it: at most "
                f"{MAX_COPY_DELAY_MS / (self.copies - 1):.4g}, or fewer copies (got {last_ms:g} ms)"
            )
        return self

    def packets_per_s(self, rate_hz: int, n_hands: int) -> int:
        """Return the number of packets sent per second, on two keys per hand."""
        return self.copies * rate_hz * 2 * n_hands

    def mb_per_s(self, rate_hz: int, n_hands: int) -> float:
        """Return the approximate rate of payload and attachment bytes, in MB/s."""
        each = _ATTACHMENT_BYTES + _POSE_BYTES * (1 + self.history)
        return self.packets_per_s(rate_hz, n_hands) * each / 1e6

    def warnings(self) -> list[str]:
        """Return warnings of settings without effect; they are no faults, since sweeps vary the copies alone."""
        if self.copy_spacing_ms and self.copies == 1:
            return ["surgeon.copy_spacing_ms has no effect: each sample is sent once (surgeon.copies is 1)"]
        return []
