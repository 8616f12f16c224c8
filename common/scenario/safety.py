"""Limits of the patient's side: of the samples that it uses, and of the set point that drives the arm."""

from typing import Annotated, Any, Final, Literal, Self

from pydantic import Field, model_validator

from tis.common.scenario.base import Milliseconds, NonNegative, Part, Positive
from tis.common.scenario.security import PersonName
from tis.common.stop_messages import ReleaseRule

MAX_REACH_M: Final = 1e6
"""Largest distance that a limit admits, in m: what moves within it can be stated in a message."""

USUAL_SAMPLES: Final = (2.0, 5.0, 200.0)
"""Reach, speed and acceleration of samples that are not given, far above what hands and arms do, in m, m/s, m/s^2."""

USUAL_SET_POINT: Final = (1.0, 2.0, 200.0)
"""Those of set points."""

USUAL_RESUMED: Final = (0.24, 10.0)
"""Speed and acceleration of set points that resume, in m/s and m/s^2."""

TIMES_RESUMED: Final = 1.5
"""So many times what training rows reach, where limits follow from them: else no set point would meet an estimate."""

TIMES_TRAINED: Final = 4.0
"""What is not given is so many times what a table's training rows reach, if that is more."""

MOST_TRAINED_M: Final = 50.0
"""Largest reach that is believed of training rows: beyond, they are likely in other units."""

Reach = Annotated[float, Field(gt=0, le=MAX_REACH_M)]
Rate = Annotated[float, Field(ge=1e-3, le=1e9)]
"""A speed or an acceleration of a set point: none so small or large that its steps cannot be computed."""

PositiveMs = Annotated[Milliseconds, Field(gt=0)]


def _limit(what: str, usual: float, about: str = "", most_m: float | None = None) -> Any:
    """Return the field of a limit that may follow from a table's training rows."""
    more = f"with a table {TIMES_TRAINED:g} times that of its training rows, if that is more"
    more += f" and at most {most_m:g}" if most_m else ""
    return Field(None, description=f"{what} Not given: {usual:g}{about}; {more}.")


def _resumed(what: str, usual: str, more: str) -> Any:
    """Return the field of a limit while the set point resumes."""
    follows = f"where speed_m_s follows from a table's training rows, {more}"
    return Field(None, description=f"{what} Not given: {usual}; {follows}.")


class Gate(Part):
    """Limits beyond which the patient does not use a sample; far above what hands and arms do.

    After a true jump the samples are used again as soon as the speed allows it: after 0.2 s for 1 m.
    """

    reach_m: Reach | None = _limit(
        "Largest distance from the mean of the training rows, in m.",
        USUAL_SAMPLES[0],
        ", the span of human arms",
        MOST_TRAINED_M,
    )
    speed_m_s: Positive | None = _limit(
        "Largest speed between samples, in m/s.", USUAL_SAMPLES[1], ", recorded trials reach 1.5"
    )
    acceleration_m_s2: Positive | None = _limit(
        "Largest change of velocity over 33 ms, in m/s^2.", USUAL_SAMPLES[2], ", recorded trials reach 43"
    )
    turn_deg_s: Positive = Field(
        4500.0,
        description="Largest speed at which the orientation turns between samples, in degrees/s: 150 degrees in 33 "
        "ms; recorded trials hold a jump of 100, and turn at 570 else.",
    )
    turn_acceleration_deg_s2: Positive = Field(
        180_000.0,
        description="Largest change of this speed over 33 ms, in degrees/s^2; recorded trials reach 88 000.",
    )
    gripper_deg: Positive = Field(
        180.0, description="Largest angle of a gripper, to either side, in degrees; recorded ones reach 111."
    )
    gripper_deg_s: Positive = Field(
        2600.0,
        description="Largest speed at which the arm's gripper moves between samples, in degrees/s; recorded ones "
        "reach 1310. That of the master's drives nothing here, and jumps.",
    )
    on_conflict: Literal["hold", "warn"] | None = Field(
        None,
        description="What follows when three samples within a second came in two versions, which no honest surgeon "
        "sends: hold leads the arm to its safety state hold until a second after the last one, warn goes on and says "
        "so. Not given: hold where the hosts are several, warn on one machine and where the network corrupts "
        "messages. With hold a stranger who reaches the network can hold the arm.",
    )
    lead_ms: NonNegative = Field(
        50.0,
        le=1000,
        description="How far ahead of the patient's clock a sample may lie, beside one period and drift, in ms: the "
        "uncertainty of clocks that were compared over a network.",
    )


class Safety(Part):
    """Limits of the set point. In tracking it equals the active estimate; the defaults shape no usual estimate.

    When the data become unsound (too old, too uncertain, or no estimate at all) the set point first holds, then comes
    to a stop, then stands still. After that, and after each break in the data, it resumes slowly.
    """

    enabled: bool = Field(
        True, strict=True, description="false: there are no set points, and the active estimate drives the plant."
    )
    hold_age_ms: PositiveMs = Field(
        1500.0,
        description="Age of the newest sample beyond which the set point follows no estimate but holds the last one, "
        "in ms: the horizon of forecasts for the arm.",
    )
    slow_stop_age_ms: PositiveMs = Field(
        3000.0, description="Age beyond which the set point gives up its target and comes to a stop, in ms."
    )
    safe_age_ms: PositiveMs = Field(5000.0, description="Age beyond which the arm counts as safe: it stands, in ms.")
    max_std_mm: Positive = Field(
        200.0, description="Largest standard deviation of a followed estimate, per axis, in mm; usual ones reach 70."
    )
    workspace_m: Reach | None = _limit(
        "Largest distance of the set point from the mean of the training rows, in m.",
        USUAL_SET_POINT[0],
        most_m=MOST_TRAINED_M,
    )
    speed_m_s: Rate | None = _limit(
        "Largest speed of the set point in tracking, over 33 ms at least, in m/s.", USUAL_SET_POINT[1]
    )
    acceleration_m_s2: Rate | None = _limit(
        "Largest change of its velocity in tracking, and with which it comes to a stop, in m/s^2.",
        USUAL_SET_POINT[2],
        ", a stop from 2 m/s takes 10 mm",
    )
    correction_mm: NonNegative = Field(
        5.0,
        description="Corrections of an estimate that the set point in tracking makes at once, as no movement that "
        "goes on, in mm within 33 ms: a part of what the speed allows in that time, at most a quarter.",
    )
    turn_deg_s: Rate = Field(
        2400.0,
        description="Largest speed at which the set point turns in tracking, and its gripper opens or closes, over "
        "33 ms at least, in degrees/s: 80 degrees a tick at 30 Hz.",
    )
    turn_acceleration_deg_s2: Rate = Field(
        240_000.0, description="Largest change of these speeds in tracking and when it stops, in degrees/s^2."
    )
    turn_correction_deg: NonNegative = Field(
        20.0, description="As correction_mm, for orientation and gripper, in degrees within 33 ms."
    )
    break_ms: PositiveMs = Field(
        400.0,
        description="Time without a fresher sample that counts as a break, in ms; when the data come back the set "
        "point resumes slowly. At least three periods; networks with longer usual gaps need more.",
    )
    resume_ms: Milliseconds = Field(
        1000.0,
        description="Time for which the set point resumes slowly at least, in ms; then until it meets the estimate.",
    )
    cautious_ms: Milliseconds = Field(
        10_000.0,
        description="Time after a break for which the limits of resuming bound the set point in tracking, too, "
        "in ms.",
    )
    resume_speed_m_s: Rate | None = _resumed(
        "Largest speed of the set point while it resumes or holds, in m/s.",
        f"{USUAL_RESUMED[0]:g}, 8 mm a tick at 30 Hz",
        f"{TIMES_RESUMED:g} times theirs",
    )
    resume_acceleration_m_s2: Rate | None = _resumed(
        "Largest change of its velocity while it resumes, and goes to the last estimate in hold, in m/s^2.",
        f"{USUAL_RESUMED[1]:g}",
        "more in proportion to resume_speed_m_s",
    )
    resume_turn_deg_s: Rate = Field(
        240.0,
        description="Largest speed at which the set point turns, and its gripper opens or closes, while it resumes "
        "and for cautious_ms after, in degrees/s; recorded arms are slower in 99 % of the time.",
    )
    latch: bool = Field(
        False,
        strict=True,
        description="true: a safe arm resumes only after a release (tis stop --release), not by itself.",
    )
    release: ReleaseRule = Field(
        "anyone",
        description="Who may end an emergency stop. anyone: whoever may stop; stopper: who knows the stop's secret, "
        "which tis stop prints; named: the clients in releasers.",
    )
    releasers: tuple[PersonName, ...] = Field(
        (), description="Names of the clients that may end an emergency stop, by certificate or password, with named."
    )

    @model_validator(mode="after")
    def _in_order(self) -> Self:
        if not self.hold_age_ms < self.slow_stop_age_ms < self.safe_age_ms:
            raise ValueError("hold_age_ms, slow_stop_age_ms and safe_age_ms must ascend")
        _, usual_speed, usual_acceleration = USUAL_SET_POINT
        if (self.resume_speed_m_s or 0.0) > (usual_speed if self.speed_m_s is None else self.speed_m_s):
            raise ValueError("resume_speed_m_s must not exceed speed_m_s")
        most = usual_acceleration if self.acceleration_m_s2 is None else self.acceleration_m_s2
        if (self.resume_acceleration_m_s2 or 0.0) > most:
            raise ValueError("resume_acceleration_m_s2 must not exceed acceleration_m_s2")
        if self.resume_turn_deg_s > self.turn_deg_s:
            raise ValueError("resume_turn_deg_s must not exceed turn_deg_s")
        if self.release == "named" and not self.releasers:
            raise ValueError("releasers must not be empty with release: named, or nobody could end a stop")
        if self.release != "named" and self.releasers:
            raise ValueError("releasers must be empty unless release is named, as others may release, too")
        return self
