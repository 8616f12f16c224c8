"""Where the surgeon's movement comes from."""

from typing import Annotated, Any, Final, Literal

from pydantic import AfterValidator, Field, SerializerFunctionWrapHandler, StringConstraints, model_serializer

from common.channels import Hand
from common.scenario.base import InWords, NonNegative, Part, Positive, Probability

Start = Annotated[
    Annotated[int, Field(ge=0, strict=True)] | Literal["auto"],
    InWords("must be a row number (an integer >= 0) or 'auto'"),
]
Trial = Annotated[
    str, StringConstraints(pattern=r"^[A-Z]\d{3}$"), InWords("must be a letter and three digits, like D002")
]


SYNTHETIC_SUBJECT: Final = "S"
"""The letter of trials that are computed; the people recorded in JIGSAWS are B to I."""


def _without_twins(hands: tuple[Hand, ...]) -> tuple[Hand, ...]:
    if len(set(hands)) != len(hands):
        raise ValueError("each hand at most once")
    return hands


Hands = Annotated[tuple[Hand, ...], Field(min_length=1, max_length=2), AfterValidator(_without_twins)]


class JigsawsSource(Part):
    """A recorded trial of JIGSAWS, in the folder layout of the original distribution."""

    kind: Literal["jigsaws"] = Field(description="jigsaws: a recorded trial.")
    path: str | None = Field(
        None,
        description="Folder that holds Suturing/, Knot_Tying/, ...; not given: what the environment variable "
        "TIS_JIGSAWS names, or else data/jigsaws.",
    )
    task: Literal["Suturing", "Knot_Tying", "Needle_Passing"] = Field("Suturing", description="The surgical task.")
    trial: Trial = Field("D002", description="Subject and repetition, like D002.")
    hands: Hands = Field(("left",), description="Masters to play: left, right or both.")
    pairing: Literal["auto", "cross", "same_name"] = Field(
        "auto",
        description="Which arm follows a master: the one found in the data, the crossed or the like-named.",
    )
    start: Start = Field(
        "auto", description="Row of the trial that becomes sample 0; auto: after the training rows, else 0."
    )

    @property
    def synthetic(self) -> bool:
        """Tell whether the trial is one that `tis synth` wrote."""
        return self.trial.startswith(SYNTHETIC_SUBJECT)


NULL_IS_A_VALUE: Final = ("recorder_hz",)
"""Fields whose null is not their default: it is kept where others are left out."""


class SyntheticSource(Part):
    """A synthetic surgeon, by default as quick as recorded suturing. Not a recording of a person."""

    kind: Literal["synthetic"] = Field(description="synthetic: computed movements, no data needed.")
    hands: Hands = Field(("left",), description="Masters to play: left, right or both.")
    movement_s: float = Field(0.7, ge=0.05, le=60, description="Mean duration of one movement, in s.")
    pause_s: NonNegative = Field(
        0.2, le=60, description="Mean pause between two movements that do not overlap, in s."
    )
    reach_mm: Positive = Field(13.0, le=1000, description="Median length of one movement of the master, mm.")
    coupling: Probability = Field(
        0.35, description="Share of its movements that a hand makes together with the other one, at the same time."
    )
    drift_mm: NonNegative = Field(
        0.5, le=100, description="Standard deviation of the hand's slow drift, in mm of the master."
    )
    tremor_mm: NonNegative = Field(
        0.02, le=10, description="Standard deviation of the hand's tremor, in mm of the master."
    )
    tremor_hz: Positive = Field(9.0, le=14, description="Centre frequency of the tremor, in Hz.")
    clutch_per_min: NonNegative = Field(
        0.0,
        le=30,
        description="How often a minute the masters are moved back while the arms hold; 0 as in the recordings.",
    )
    arm_bandwidth_hz: Positive | None = Field(
        None,
        le=100,
        description="The arm lags behind its command as a servo of second order of this natural frequency, in Hz; "
        "left out: it is half the command at once, as in the recordings.",
    )
    arm_damping: Positive = Field(0.7, le=10, description="Damping ratio of that servo; 1 is critical.")
    recorder_hz: Positive | None = Field(
        51.33,
        le=1_000_000,
        description="A row shows the latest sample of a recorder of this rate, in Hz, as the rows of JIGSAWS do; "
        "null: the movement at the row's own instant, for smooth paths and high rates.",
    )
    start: Start = Field(
        "auto",
        description="Row of the trajectory that becomes sample 0; auto: after the training rows, else 0.",
    )

    @model_serializer(mode="wrap")
    def _with_null(self, handler: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """Keep a null that means something: files leave out all others, and give back defaults for them."""
        dumped: dict[str, Any] = handler(self)
        return dumped if self.recorder_hz is not None else dumped | {"recorder_hz": None}

    @property
    def synthetic(self) -> bool:
        """Return True."""
        return True


Source = Annotated[JigsawsSource | SyntheticSource, Field(discriminator="kind")]
