"""Limits that a run is judged by: user-defined ones, or the published network requirements of one application.

The requirements are data: each set with its source and its interpretation.
"""

from typing import Final, Literal, NamedTuple, Self

from pydantic import Field

from tis.common.channels import Direction
from tis.common.scenario.base import Part, Positive, Probability

Metric = Literal[
    "one_way",
    "end_to_end",
    "round_trip",
    "network_round_trip",
    "pdv",
    "age",
    "loss",
    "rmse_3d",
    "contact",
    "energy",
    "hand_to_eye",
    "freeze",
]
Application = Literal[
    "haptics",
    "haptics_highly_dynamic",
    "haptics_dynamic",
    "haptics_fixed",
    "augmented_reality",
    "immersive_reality",
    "tactile_internet",
    "round_trip_1_ms",
    "remote_laparoscopy",
    "felt_delay",
    "telehaptics",
]

P99: Final = 99.0
"""Percentile applied where a source names none: a maximum would depend on the length of the measurement."""


class Requirement(NamedTuple):
    """An upper limit in ms (`loss` %, `rmse_3d` mm, `contact` N, `energy` mJ, `freeze` %), on a percentile or None.

    ``one_way``, ``network_round_trip`` and ``pdv`` concern the network alone; ``end_to_end`` and ``round_trip``
    include the wait for the patient's tick. One that is not ``binding``, the strict end of a range, does not decide.
    """

    metric: Metric
    limit: float
    direction: Direction | None = None
    percentile: float | None = P99
    binding: bool = True


class RequirementSet(NamedTuple):
    """Requirements of one application, and the statement of their source."""

    title: str
    source: str
    requirements: tuple[Requirement, ...]


def _both_ways(metric: Metric, limit: float, binding: bool = True) -> tuple[Requirement, ...]:
    percentile = None if metric == "loss" else P99
    return tuple(Requirement(metric, limit, way, percentile, binding) for way in ("forward", "feedback"))


def _table_row(
    title: str, limit_ms: float, loss_pct: float, words: str, strict_ms: float | None = None
) -> RequirementSet:
    """Return a table row: the delay applies to the network, each way, and to the end-to-end latency.

    Of a range the larger delay decides; ``strict_ms`` is its smaller end.
    """
    strict = () if strict_ms is None else _both_ways("one_way", strict_ms, binding=False)
    delays = (*_both_ways("one_way", limit_ms), Requirement("end_to_end", limit_ms))
    return RequirementSet(title, words, (*delays, *_both_ways("loss", loss_pct), *strict))


_PAPER: Final = "the paper's table of requirements"
_CASES: Final = f"{_PAPER}, cases of haptics by how the remote side moves"

REQUIREMENTS: Final[dict[Application, RequirementSet]] = {
    "haptics": _table_row("haptics (paper)", 2.0, 0.1, f"{_PAPER}: 0.5-2 ms, 99.9 %", 0.5),
    "haptics_highly_dynamic": _table_row(
        "highly dynamic haptics (paper)", 0.5, 0.1, f"{_CASES}: highly dynamic 0.5 ms, 99.9 %"
    ),
    "haptics_dynamic": _table_row("dynamic haptics (paper)", 5.0, 0.1, f"{_CASES}: dynamic 5 ms, 99.9 %"),
    "haptics_fixed": _table_row("fixed haptics (paper)", 50.0, 0.1, f"{_CASES}: fixed 50 ms, 99.9 %"),
    "augmented_reality": _table_row(
        "augmented reality video (paper)", 2.0, 0.001, f"{_PAPER}, video: 0.5-2 ms, 99.999 %", 0.5
    ),
    "immersive_reality": _table_row(
        "immersive 3D audio (paper)", 2.0, 0.1, f"{_PAPER}, 3D audio: 0.5-2 ms, 99.9 %", 0.5
    ),
    "tactile_internet": _table_row(
        "Tactile Internet", 10.0, 1e-5, "the usual statement for the Tactile Internet: 1-10 ms, 99.99999 %", 1.0
    ),
    "round_trip_1_ms": RequirementSet(
        "1 ms round trip (paper)",
        "the paper's introduction, of the Tactile Internet: an end-to-end round-trip latency of 1 ms; ticks included",
        (Requirement("round_trip", 1.0),),
    ),
    "remote_laparoscopy": RequirementSet(
        "remote laparoscopy",
        "requirements for remote laparoscopy: downlink below 50 ms, round trip at most 100 ms, jitter at most "
        "5-10 ms; no reliability stated. Downlink is read as towards the patient, jitter as PDV of RFC 5481",
        (
            Requirement("one_way", 50.0, "forward"),
            Requirement("network_round_trip", 100.0),
            *_both_ways("pdv", 10.0),
            *_both_ways("pdv", 5.0, binding=False),
        ),
    ),
    "felt_delay": RequirementSet(
        "what people accept",
        "people accept at most 100 ms; read as from a movement to the sight of its effect, ticks included",
        (Requirement("round_trip", 100.0),),
    ),
    "telehaptics": RequirementSet(
        "telehaptics",
        "telehaptics: at most 10 % loss and 10 ms jitter; jitter is read as PDV of RFC 5481",
        (*_both_ways("loss", 10.0), *_both_ways("pdv", 10.0)),
    ),
}


_METRIC_OF: Final[dict[str, Metric]] = {
    "end_to_end_p99_ms": "end_to_end",
    "one_way_p99_ms": "one_way",
    "round_trip_p99_ms": "round_trip",
    "pdv_p99_ms": "pdv",
    "age_p99_ms": "age",
    "p_loss_max": "loss",
    "rmse_3d_max_mm": "rmse_3d",
    "contact_max_n": "contact",
    "energy_max_mj": "energy",
    "hand_to_eye_p99_ms": "hand_to_eye",
    "freeze_max_pct": "freeze",
}
_EACH_WAY: Final[tuple[Metric, ...]] = ("one_way", "pdv", "loss")
MAXIMA: Final[tuple[Metric, ...]] = ("contact", "energy", "freeze")
"""Metrics of which the largest value of this run counts."""
_NO_PERCENTILE: Final[tuple[Metric, ...]] = ("loss", "rmse_3d", *MAXIMA)
_PER_CENT: Final = 100.0
_DIGITS: Final = 12
"""Digits of a limit in per cent: 100 * 0.29 would be just below 29."""


class Limits(Part):
    """Limits of the run; the summary's verdicts state whether they are met. They change no exit code."""

    preset: Application | None = Field(
        None,
        description="Limits that the literature states for an application; limits given beside it take precedence. "
        + "; ".join(f"{name}: {needed.source}" for name, needed in REQUIREMENTS.items())
        + ".",
    )
    end_to_end_p99_ms: Positive | None = Field(
        None,
        description="Upper limit of the 99th percentile of the end-to-end latency, from a sample's instant to the "
        "published estimate, in ms. Any limit that is not given is the preset's, if it has one.",
    )
    one_way_p99_ms: Positive | None = Field(
        None, description="Upper limit of the 99th percentile of the network's one-way delay, in ms, per direction."
    )
    round_trip_p99_ms: Positive | None = Field(
        None,
        description="Upper limit of the 99th percentile of the round trip, in ms: from a command to its first "
        "feedback on the surgeon's clock, the wait for the patient's tick included.",
    )
    pdv_p99_ms: Positive | None = Field(
        None,
        description="Upper limit of the 99th percentile of the packet delay variation, the one-way delay above the "
        "smallest (PDV, RFC 5481), in ms, per direction.",
    )
    age_p99_ms: Positive | None = Field(
        None, description="Upper limit of the 99th percentile of the freshest sample's age at the ticks, in ms."
    )
    p_loss_max: Probability | None = Field(
        None,
        description="Upper limit of the share of packets lost, 0 to 1, per direction; each copy of a sample counts "
        "as a packet. 0: no packet of this run may be lost.",
    )
    rmse_3d_max_mm: Positive | None = Field(
        None, description="Upper limit of the 3D root mean square error of the active estimator's position, in mm."
    )

    contact_max_n: Positive | None = Field(
        None, description="Upper limit of the force on what the arms touch in this run, in N; with touch."
    )
    energy_max_mj: Positive | None = Field(
        None,
        description="Upper limit of the energy that the coupling gives to a hand beyond what it has put in, in mJ; "
        "with touch.",
    )
    hand_to_eye_p99_ms: Positive | None = Field(
        None,
        description="Upper limit of the 99th percentile of the time from a command's sample to the picture that "
        "shows it, by the surgeon's clock, in ms; with sight.",
    )
    freeze_max_pct: float | None = Field(
        None, ge=0, le=100, description="Upper limit of the time in which the picture stands still, in %; with sight."
    )

    def resolved(self) -> Self:
        """Return the limits, completed by those of the preset."""
        if self.preset is None:
            return self
        # A preset may require different values per direction; a limit applies to both, so the smaller one counts.
        needed = [one for one in REQUIREMENTS[self.preset].requirements if one.binding]
        limits = {
            field: min((one.limit / _unit(metric) for one in needed if one.metric == metric), default=None)
            for field, metric in _METRIC_OF.items()
            if getattr(self, field) is None
        }
        return self.model_copy(update=limits)

    def requirements(self) -> tuple[Requirement, ...]:
        """Return the given limits, and the preset's requirements on all other metrics."""
        given = {metric: getattr(self, field) for field, metric in _METRIC_OF.items()}
        own = tuple(
            Requirement(metric, round(limit * _unit(metric), _DIGITS), way, None if metric in _NO_PERCENTILE else P99)
            for metric, limit in given.items()
            if limit is not None
            for way in _ways(metric)
        )
        if self.preset is None:
            return own
        rest = REQUIREMENTS[self.preset].requirements
        return own + tuple(one for one in rest if given.get(one.metric) is None)


def _unit(metric: Metric) -> float:
    """Return how much of a requirement's unit is 1 in that of the field: a share's limit is in %."""
    return _PER_CENT if metric == "loss" else 1.0


def _ways(metric: Metric) -> tuple[Direction | None, ...]:
    return ("forward", "feedback") if metric in _EACH_WAY else (None,)
