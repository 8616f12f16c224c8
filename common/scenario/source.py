"""Sources of the surgeon's movement."""

from typing import Annotated, Final, Literal

from pydantic import Field, StringConstraints

from tis.common.scenario.base import (
    HANDS_MEANING,
    START_MEANING,
    AnySource,
    Hands,
    NonNegative,
    Positive,
    Probability,
    RuleText,
    Start,
)
from tis.common.scenario.live_source import LiveSource
from tis.common.scenario.table_source import TableSource

Trial = Annotated[
    str, StringConstraints(pattern=r"^[A-Z]\d{3}$"), RuleText("must be a letter and three digits, like D002")
]


SYNTHETIC_SUBJECTS: Final = "STUVWXYZ"
"""Subject letters of synthetic trials, one a person; the subjects of JIGSAWS are B to I."""


def is_synthetic(trial: str) -> bool:
    """Tell from its name whether `tis synth` wrote a trial, like S001 or T002."""
    return trial[0] in SYNTHETIC_SUBJECTS


class JigsawsSource(AnySource):
    """A recorded trial of JIGSAWS, in the folder layout of the original distribution."""

    kind: Literal["jigsaws"] = Field(description="jigsaws: a recorded trial.")
    path: str | None = Field(
        None,
        description="Folder that contains Suturing/, Knot_Tying/, ...; not given: the folder that the environment "
        "variable TIS_JIGSAWS names, or data/jigsaws.",
    )
    task: Literal["Suturing", "Knot_Tying", "Needle_Passing"] = Field("Suturing", description="Surgical task.")
    trial: Trial = Field("D002", description="Subject letter and three digits of the repetition, like D002.")
    hands: Hands = Field(("left",), description=HANDS_MEANING)
    pairing: Literal["auto", "cross", "same_name"] = Field(
        "auto",
        description="Arm that follows each master. auto: the one found in the training data; cross: PSM2 for the "
        "left, PSM1 for the right; same_name: PSM1 for the left, PSM2 for the right.",
    )
    clock: Literal["auto", "as_recorded"] = Field(
        "auto",
        description="Instants of the rows, which are the latest samples of a recorder at another rate. auto: found, "
        "and the rows interpolated at even ones; as_recorded: the rows as they are, as if they were even.",
    )
    start: Start = Field("auto", description=START_MEANING)

    @property
    def synthetic(self) -> bool:
        """Tell whether `tis synth` wrote the trial."""
        return is_synthetic(self.trial)

    @property
    def label(self) -> str:
        """Return the trial's task and name, and whether a person moved."""
        return f"{'synthetic' if self.synthetic else 'recorded'} {self.task} {self.trial}"

    def rules(self, session: str, rate_hz: int, train: str, plant: str) -> dict[str, bool]:
        """Return the rule of the recorder's rate, and those of every recorded movement."""
        rule = "rate_hz must be 30, the rate at which JIGSAWS trials were recorded"
        return {rule: rate_hz == 30, **super().rules(session, rate_hz, train, plant)}


class SyntheticSource(AnySource):
    """A synthetic surgeon whose default speeds are those of recorded suturing; not a recording of a person."""

    kind: Literal["synthetic"] = Field(description="synthetic: computed movements, no data needed.")
    hands: Hands = Field(("left",), description=HANDS_MEANING)
    movement_s: float = Field(0.7, ge=0.05, le=60, description="Mean duration of a movement, in s.")
    pause_s: NonNegative = Field(
        0.2, le=60, description="Mean pause between two movements that do not overlap, in s."
    )
    reach_mm: Positive = Field(13.0, le=1000, description="Median length of a movement of the master, in mm.")
    turn_deg: NonNegative = Field(
        19.0, le=90, description="Median angle by which a movement turns the hand, in degrees."
    )
    coupling: Probability = Field(
        0.35, description="Share of movements that both hands make at the same time, 0 to 1."
    )
    drift_mm: NonNegative = Field(
        0.5, le=100, description="Standard deviation of the hand's slow drift, in mm of the master, per axis."
    )
    tremor_mm: NonNegative = Field(
        0.02, le=10, description="Standard deviation of the hand's tremor, in mm of the master, per axis."
    )
    tremor_hz: Positive = Field(9.0, le=14, description="Centre frequency of the tremor, in Hz.")
    gripper_open_rad: NonNegative = Field(
        0.8, le=3.2, description="Angle of the open gripper, in rad; closed it is 0."
    )
    gripper_hold_s: Positive = Field(
        3.0, le=600, description="Mean time between two openings or closings of the gripper, in s."
    )
    clutch_per_min: NonNegative = Field(
        0.0,
        le=30,
        description="Clutch actions per minute, in which the masters move back while the arms hold. The recordings "
        "have none.",
    )
    arm_bandwidth_hz: Positive | None = Field(
        None,
        le=100,
        description="Natural frequency of the second-order servo by which the arm follows its command, in Hz; not "
        "given: the arm follows without lag, as in the recordings.",
    )
    arm_damping: Positive = Field(0.7, le=10, description="Damping ratio of that servo; 1: critically damped.")
    recorder_hz: Positive | None = Field(
        None,
        le=1_000_000,
        description="Rate of a simulated recorder, in Hz, such as that of JIGSAWS, 51.33: each row shows its latest "
        "sample. Not given: each row shows the movement at its own instant, as a device's samples do.",
    )
    start: Start = Field("auto", description=START_MEANING)

    @property
    def synthetic(self) -> bool:
        """Return True."""
        return True

    @property
    def label(self) -> str:
        """Return what moves."""
        return "synthetic surgeon"

    def rules(self, session: str, rate_hz: int, train: str, plant: str) -> dict[str, bool]:
        """Return the rule of the training: there is one person only."""
        rule = "identification.train must be own_head or a model file: a synthetic source has no other subjects"
        return {rule: train != "others", **super().rules(session, rate_hz, train, plant)}


RecordedSource = JigsawsSource | TableSource
"""Sources that are files: they have an end."""

Source = Annotated[RecordedSource | SyntheticSource | LiveSource, Field(discriminator="kind")]
