"""How the patient's side ticks, moves its arm and estimates."""

from typing import Annotated, Literal, Self

from pydantic import AfterValidator, Field, model_validator

from common.errors import Fault, InputError
from common.scenario.base import InWords, NonNegative, Part, Positive
from common.scenario.estimator_names import AnyEstimatorName, each_once

OrderRule = Literal["auto", "energy", "gap", "criterion", "validation"]
Order = Annotated[
    Annotated[int, Field(ge=0, strict=True)] | OrderRule,
    InWords("must be an integer >= 0 or one of auto, energy, gap, criterion, validation"),
]


class ReplayPlant(Part):
    """The arm does what the recorded arm did; only for feedback, estimators never see it."""

    kind: Literal["replay"] = Field(description="replay: the arm does what it did in the recording.")


class ServoPlant(Part):
    """An arm that executes the active estimate: a second-order servo, the same on each axis."""

    kind: Literal["servo"] = Field(description="servo: the arm executes the active estimate.")
    bandwidth_hz: Positive = Field(10.0, le=1000, description="Natural frequency of the servo, in Hz.")
    damping: Positive = Field(1.0, le=10, description="Damping ratio; 1: critically damped.")
    sensor_noise_mm: NonNegative = Field(0.0, description="Standard deviation of the measured position, mm.")


TickMode = Literal["free", "phase_locked", "on_arrival"]

Plant = Annotated[ReplayPlant | ServoPlant, Field(discriminator="kind")]


class PatientPart(Part):
    """The patient's side."""

    tick: TickMode = Field(
        "free",
        description="free: ticks run at rate_hz from the epoch; phase_locked: their phase moves to just behind the "
        "usual arrival of samples; on_arrival: as free, and the active estimator also answers at each arrival of a "
        "fresher sample.",
    )
    tick_phase_ms: NonNegative = Field(
        2.0,
        description="Offset of the ticks from the sample instants, in ms: an arrival on an edge is chance. For "
        "phase_locked that at the start.",
    )
    plant: Plant = Field(ReplayPlant(kind="replay"), description="What moves on the patient's side.")


def _position_and_more(inputs: tuple[str, ...]) -> tuple[str, ...]:
    if "position" not in inputs or len(set(inputs)) != len(inputs):
        raise ValueError("must hold position, and each input at most once")
    return inputs


def _model_file_or_name(train: str) -> str:
    if train not in ("own_head", "others") and not train.endswith(".json"):
        raise ValueError("must be own_head, others or a model file that ends in .json")
    return train


class Identification(Part):
    """How the arm's model is found before the run."""

    method: Literal["moesp", "pi_moesp", "n4sid", "cva", "arx", "moesp_paper", "narx"] = Field(
        "moesp",
        description="moesp: past-output MOESP; pi_moesp: past inputs as instruments, for coloured noise; n4sid: "
        "oblique projection; cva: canonical variates; arx: least squares; all with D and x0. moesp_paper: the "
        "paper's Algorithm 2, as printed. narx: a polynomial, for `tis identify` alone.",
    )
    inputs: Annotated[tuple[Literal["position", "velocity"], ...], AfterValidator(_position_and_more)] = Field(
        ("position",),
        description="What of the commands goes in: position; with velocity, for `tis identify` alone, also the "
        "linear velocity columns of JIGSAWS, which look ahead.",
    )
    allow_lookahead: bool = Field(
        False,
        strict=True,
        description="Accept inputs smoothed over frames after their own: they see the future.",
    )
    train: Annotated[str, AfterValidator(_model_file_or_name)] = Field(
        "own_head",
        description="own_head: the first train_samples of the same trial; others: the same task, all other "
        "subjects; or a model file written by `tis identify`.",
    )
    train_samples: int = Field(
        1240, strict=True, ge=60, description="Training rows of the trial itself, for own_head."
    )
    block_rows: int = Field(
        10,
        strict=True,
        ge=2,
        le=100,
        description="Block rows of the Hankel matrices, of past and future each but for moesp_paper; for arx the "
        "largest number of lags.",
    )
    order: Order = Field(
        "auto",
        description="States of the model, for arx lags, or the rule that chooses them; energy: 85 % of the singular "
        "values' sum; gap: the largest ratio of one to the next; criterion: an information criterion; validation: "
        "prediction of held-back rows; auto: validation, for moesp_paper energy; 0: a static relation.",
    )
    # The paper calls both "small positive constants" and names no value. The filter's gain depends on their ratio
    # alone (but for P = I at the start), and nothing in the paper sets one above the other.
    epsilon_q: Positive = Field(
        1e-3, le=1e6, description="moesp_paper: first guess of the process noise, Q = epsilon_q I, normalised units."
    )
    epsilon_r: Positive = Field(
        1e-3,
        le=1e6,
        description="moesp_paper: first guess of the measurement noise, R = epsilon_r I, normalised units.",
    )

    @model_validator(mode="after")
    def _no_future(self) -> Self:
        if self.looks_ahead and not self.allow_lookahead:
            raise ValueError(
                "inputs must not hold velocity, whose columns look ahead (smoothed over frames after their own), "
                "unless allow_lookahead is true"
            )
        return self

    @property
    def looks_ahead(self) -> bool:
        """Whether an input sees frames after its own."""
        return "velocity" in self.inputs

    def check_for_runs(self) -> None:
        """Raise `InputError` when what is asked for serves `tis identify` alone; a model file serves anywhere."""
        if self.train.endswith(".json"):
            return
        faults = []
        if self.method == "narx":
            rule = "must be another one for a run, whose filters need a linear model: narx is for tis identify alone"
            faults.append(Fault("identification", "method", rule))
        if self.looks_ahead:
            rule = "must be position for a run, whose filters get no velocity: that is for tis identify alone"
            faults.append(Fault("identification", "inputs", rule))
        if faults:
            raise InputError(faults)


Estimators = Annotated[tuple[AnyEstimatorName, ...], Field(min_length=1), AfterValidator(each_once)]
