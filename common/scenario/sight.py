"""Sight: the camera on the patient's side, its stream, and the surgeon's screen."""

from typing import Final, Literal, Self

from pydantic import Field, model_validator

from tis.common.scenario.base import NonNegative, Part
from tis.common.units import NS_PER_S, ms_to_ns, sample_index, sample_instant_ns

CELL: Final = 16
"""Side of a stamp's cell, in pixels, of which width and height are multiples."""

MAX_WIDTH: Final = 1920
MAX_HEIGHT: Final = 1088


class SightPart(Part):
    """A camera shows the patient's arms, its picture crosses the network, and a screen shows what arrives."""

    camera: Literal["drawn", "external"] = Field(
        "drawn",
        description="drawn: the testbed draws the arms; external: another program publishes the frames on "
        "SESSION/ECM/camera, encoded with `codec`, of any size up to 1920 x 1088 pixels in all.",
    )
    fps: int = Field(
        30,
        ge=1,
        le=240,
        strict=True,
        description="Frames per second; of an external camera up to twice as many are taken.",
    )
    width: int = Field(640, ge=320, le=MAX_WIDTH, multiple_of=CELL, description="Width of the picture, in pixels.")
    height: int = Field(480, ge=240, le=MAX_HEIGHT, multiple_of=CELL, description="Height of the picture, in pixels.")
    codec: Literal["jpeg", "h264"] = Field(
        "jpeg",
        description="jpeg: each frame by itself, needs the extra report; h264: key frames and differences between "
        "frames, needs the extra video. Both on the hosts of patient and surgeon.",
    )
    quality: int = Field(70, ge=1, le=95, strict=True, description="Quality of jpeg, 1 to 95.")
    bit_rate_kbit_s: float = Field(
        2000.0, ge=100, le=100_000, description="Bit rate of h264, which no frame exceeds for long, in kbit/s."
    )
    key_every: int = Field(
        30,
        ge=1,
        le=10_000,
        strict=True,
        description="Distance of two key frames of h264, in frames; 1: only key frames.",
    )
    intra_refresh: bool = Field(
        False,
        description="h264 without key frames but the first: each frame renews a part of the picture, all of it "
        "within key_every frames.",
    )
    fragment_bytes: int = Field(
        1200,
        ge=1,
        le=65_000,
        strict=True,
        description="Bytes of a frame in a message; a frame is sent as so many messages as it takes.",
    )
    camera_phase_ms: NonNegative = Field(
        5.0, description="Offset of the frames from the beginning of the run, in ms, within one period of fps."
    )
    display_hz: int = Field(60, ge=1, le=1000, strict=True, description="Refresh rate of the screen, in Hz.")
    display_phase_ms: NonNegative = Field(
        0.0, description="Offset of the screen's refreshes from the beginning of the run, in ms, within one period."
    )

    @model_validator(mode="after")
    def _phases_within_periods(self) -> Self:
        for phase, ms, rate in (
            ("camera_phase_ms", self.camera_phase_ms, self.fps),
            ("display_phase_ms", self.display_phase_ms, self.display_hz),
        ):
            if ms * rate >= 1000:
                raise ValueError(f"{phase} must be less than one period ({1000 / rate:g} ms)")
        return self

    @model_validator(mode="after")
    def _of_the_drawn_camera(self) -> Self:
        given = {name: getattr(self, name) for name in _DRAWN if getattr(self, name) != _DEFAULTS[name]}
        if self.camera == "external" and given:
            rule = "must be left out with camera external, which draws and encodes by itself"
            raise ValueError("\n".join(f"{name} {rule} ({value})" for name, value in given.items()))
        return self

    @property
    def is_external(self) -> bool:
        """Tell whether another program is the camera."""
        return self.camera == "external"

    @property
    def max_pixels(self) -> int:
        """Return the number of pixels of the largest picture that is decoded."""
        return MAX_WIDTH * MAX_HEIGHT if self.is_external else self.width * self.height

    def is_of_size(self, width: int, height: int) -> bool:
        """Tell whether a picture may have this size: that of the scenario, or any of an external camera."""
        if self.is_external:
            return 0 < width * height <= self.max_pixels
        return (width, height) == (self.width, self.height)

    def last_frame(self, t_ns: int) -> int:
        """Return the highest number that a frame may have at a run time."""
        return sample_index(t_ns, self.fps * (2 if self.is_external else 1)) + 1

    def n_due(self, until_ns: int) -> int:
        """Return how many frames are captured before a run time, in ns."""
        return max(0, ((until_ns - ms_to_ns(self.camera_phase_ms)) * self.fps - 1) // NS_PER_S + 1)

    def captured_ns(self, frame: int) -> int:
        """Return the run time at which a frame is captured, in ns."""
        return sample_instant_ns(frame, self.fps) + ms_to_ns(self.camera_phase_ms)

    def refresh_ns(self, number: int) -> int:
        """Return the run time of a refresh of the screen, in ns."""
        return sample_instant_ns(number, self.display_hz) + ms_to_ns(self.display_phase_ms)


_DRAWN: Final = ("width", "height", "quality", "bit_rate_kbit_s", "camera_phase_ms")
"""Fields of the camera of ours, and of its encoder."""
_DEFAULTS: Final = {name: SightPart.model_fields[name].default for name in _DRAWN}
