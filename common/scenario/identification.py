"""Identification of the arm's model before a run, training of learned methods, and the estimators of a run."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated, Final, Literal, Self

from pydantic import AfterValidator, Field, model_validator

from tis.common.errors import Fault, InputError
from tis.common.estimators import LEARNED, short_name
from tis.common.order_rules import OrderRule
from tis.common.scenario.base import Part, Positive, RuleText
from tis.common.scenario.estimator_names import AnyEstimatorName, LearnedName, each_once, is_learned
from tis.common.units import MM_PER_M


class Learning(Part):
    """Training of learned methods (gpr, srlsmf, srlsmf_l1, transformer, informer, cnn)."""

    seed: int = Field(
        1,
        strict=True,
        ge=0,
        lt=1 << 31,
        description="Seed of all that training draws: networks, first weights, order of the examples. It also "
        "selects whom training is judged on.",
    )
    passes: int = Field(
        2, strict=True, ge=1, le=20, description="Number of drawn networks through which each trial is seen."
    )
    epochs: int = Field(
        16, strict=True, ge=1, le=1000, description="Maximum number of epochs of a network's training."
    )
    patience: int = Field(
        8,
        strict=True,
        ge=1,
        le=1000,
        description="Number of epochs without a better held-out error after which training ends.",
    )


Order = Annotated[
    Annotated[int, Field(ge=0, strict=True)] | OrderRule,
    RuleText("must be an integer >= 0 or one of auto, energy, gap, criterion, validation"),
]


def _position_and_more(inputs: tuple[str, ...]) -> tuple[str, ...]:
    if "position" not in inputs or len(set(inputs)) != len(inputs):
        raise ValueError("must contain position, and each input at most once")
    return inputs


def is_model_file(train: str) -> bool:
    """Tell whether ``identification.train`` is the path of a model file."""
    return train.endswith((".json", ".safetensors"))


def _model_file_or_name(train: str) -> str:
    if train not in ("own_head", "others", "synthetic") and not is_model_file(train):
        raise ValueError(
            "must be own_head, others, synthetic or the path of a model file ending in .json or .safetensors"
        )
    return train


LinearMethod = Literal["moesp", "pi_moesp", "n4sid", "cva", "arx", "moesp_paper", "narx"]


if TYPE_CHECKING:
    _Method = str
else:
    _Method = Literal[LinearMethod, LearnedName]


MIN_TRAIN_SAMPLES: Final = 60
"""Fewest training rows of own_head."""


class Identification(Part):
    """Identification of the arm's model before the run."""

    method: _Method = Field(
        "moesp",
        description="Method of identification. moesp: past-output MOESP; pi_moesp: MOESP with past inputs as "
        "instruments, for coloured noise; n4sid: oblique projection; cva: canonical variates; arx: least squares. "
        "All of these estimate D and x0. moesp_paper: the paper's Algorithm 2, as printed. narx: a polynomial NARX "
        f"model, in `tis identify` only. {', '.join(LEARNED)}: moesp, and the model of "
        "the estimator of that name is trained.",
    )
    inputs: Annotated[tuple[Literal["position", "velocity"], ...], AfterValidator(_position_and_more)] = Field(
        ("position",),
        description="Inputs of the model, taken from the commands: position, and in `tis identify` also velocity, "
        "the linear velocity columns of JIGSAWS, which look ahead.",
    )
    allow_lookahead: bool = Field(
        False, strict=True, description="true: inputs may depend on later frames, as smoothed velocities do."
    )
    train: Annotated[str, AfterValidator(_model_file_or_name)] = Field(
        "own_head",
        description="Training data. own_head: the first train_samples rows of the same trial; others: all trials of "
        "the same task by other subjects, for a table the tables of other people beside it; synthetic: a synthetic "
        "hand in the places of a live source, no data needed; or the path of a model file written by `tis identify`.",
    )
    train_samples: int = Field(
        1240,
        strict=True,
        ge=MIN_TRAIN_SAMPLES,
        description="Number of training rows at the trial's beginning, for own_head.",
    )
    block_rows: int = Field(
        10,
        strict=True,
        ge=2,
        le=100,
        description="Number of block rows of the Hankel matrices, for past and future each (moesp_paper: in all); "
        "arx: maximum number of lags.",
    )
    order: Order = Field(
        "auto",
        description="Number of states (arx: lags), or the rule that chooses it. energy: 85 % of the sum of singular "
        "values; gap: the largest ratio of successive singular values; criterion: an information criterion; "
        "validation: the prediction of held-back rows; auto: validation, for moesp_paper energy. 0: a static gain.",
    )
    # The paper calls both "small positive constants" and gives no value. The filter's gain depends on their ratio
    # only (except for P = I at the start), and nothing in the paper sets one above the other.
    epsilon_q: Positive = Field(
        1e-3,
        le=1e6,
        description="moesp_paper: initial process noise covariance Q = epsilon_q I, in normalised units squared.",
    )
    epsilon_r: Positive = Field(
        1e-3,
        le=1e6,
        description="moesp_paper: initial measurement noise covariance R = epsilon_r I, in normalised units squared.",
    )

    sensor_noise_mm: Annotated[float, Field(ge=0, le=100)] = Field(
        0.0,
        description="Standard deviation of an error that is added to each axis of the positions in the training "
        "rows, of command and arm, in mm, as `surgeon.sensor_noise_mm` adds it to what is sent.",
    )
    learning: Learning = Field(Learning(), description="Training of learned methods.")

    @model_validator(mode="after")
    def _no_future(self) -> Self:
        if self.looks_ahead and not self.allow_lookahead:
            raise ValueError(
                "inputs must not contain velocity, whose columns look ahead (they are smoothed over later frames), "
                "unless allow_lookahead is true"
            )
        return self

    @property
    def linear_method(self) -> str:
        """Return the method of the linear model, which learned methods need, too."""
        return "moesp" if is_learned(self.method) else self.method

    @property
    def sensor_noise_m(self) -> float:
        """`sensor_noise_mm` in m."""
        return self.sensor_noise_mm / MM_PER_M

    @property
    def looks_ahead(self) -> bool:
        """True when an input depends on later frames."""
        return "velocity" in self.inputs

    def check_for_live_runs(self, estimators: Sequence[str]) -> None:
        """Raise `InputError` when these settings do not work in a live run with the ``estimators``.

        Nobody waits for minutes of training at the beginning of a run.
        """
        self.check_for_runs()
        untrained = [] if is_model_file(self.train) else [name for name in estimators if is_learned(name)]
        untrained = [short_name(name) for name in untrained]
        if untrained:
            rule = (
                f"must be a model file in a live run with {' and '.join(untrained)}, as training takes minutes: "
                f"`tis identify --set identification.method={untrained[0]} --out FILE.safetensors`"
            )
            raise InputError(Fault("identification", "train", rule, self.train))

    def check_for_runs(self) -> None:
        """Raise `InputError` when these settings work in `tis identify` only; a model file works everywhere."""
        if is_model_file(self.train):
            return
        faults = []
        if self.method == "narx":
            rule = "must not be narx in a run, whose filters need a linear model; narx works in tis identify only"
            faults.append(Fault("identification", "method", rule))
        if self.looks_ahead:
            rule = "must be position in a run, whose filters receive no velocity; velocity works in tis identify only"
            faults.append(Fault("identification", "inputs", rule))
        if faults:
            raise InputError(faults)


Estimators = Annotated[tuple[AnyEstimatorName, ...], Field(min_length=1), AfterValidator(each_once)]
