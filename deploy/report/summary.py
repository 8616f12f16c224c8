"""``summary.json``: the figures of a run. Its names are an interface, and keep their meaning."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

from pydantic import ValidationError

from tis.common.channels import Hand
from tis.common.errors import DataError, Fault, one_line
from tis.deploy.present.numbers import rounded_up
from tis.deploy.report.section import (
    DirectionName,
    EstimatorName,
    HandName,
    KeyName,
    KindName,
    MethodName,
    Section,
    SideName,
    Statistics,
    means,
    statistics,
    with_uncertainty,
)
from tis.deploy.report.subjects.accuracy import Scores
from tis.deploy.report.subjects.age import AgeOfInformation, TickModes
from tis.deploy.report.subjects.clocks import ClockFigures
from tis.deploy.report.subjects.devices import CameraFigures, DeviceFigures
from tis.deploy.report.subjects.display import DisplayFigures
from tis.deploy.report.subjects.identification import IdentifiedModel, PlayedRecording
from tis.deploy.report.subjects.intrusion import Evidence
from tis.deploy.report.subjects.latency import Latency
from tis.deploy.report.subjects.logs import LogState
from tis.deploy.report.subjects.network.link_figures import Link
from tis.deploy.report.subjects.orientation import AngleScores
from tis.deploy.report.subjects.own_estimators import OwnEstimator
from tis.deploy.report.subjects.processors import ProcessorFigures
from tis.deploy.report.subjects.redundancy import KeyTraffic, Redundancy
from tis.deploy.report.subjects.requirements import SetVerdict
from tis.deploy.report.subjects.safety import SafetyFigures
from tis.deploy.report.subjects.sight import SightFigures
from tis.deploy.report.subjects.stretches import Stretch
from tis.deploy.report.subjects.ticks import Ticks
from tis.deploy.report.subjects.touch import TouchFigures
from tis.deploy.report.subjects.tracking import AgeBins, TurnAgeBins


class Summary(Section):
    """The summary of a run; a figure that cannot be computed is None."""

    scenario: str = means("Name of the scenario.")
    seed: int = means("Seed of every random number.")
    mode: str = means("`live`, `twin`, or what else made the logs.")
    run_id: int | None = means("Number of the run, which all its logs carry; `null` for a twin.")
    exit: int | None = means("Exit code that the sides gave the run; `null` in a summary that was computed again.")
    command: str = means("Command line that began the run.")
    duration_s: float = means(
        "Length of the surgeon's movement, up to Ctrl-C where that ended it; the drain is not included."
    )
    source: str = means("Origin of the movement, in words.")
    active_estimator: str = means("Estimator that the patient acts on.")
    active_orientation: str = means("Orientation method whose orientation and gripper the answers carry.")
    links: dict[DirectionName, Link] = means("The two directions of the network.")
    changes: list[str] = means(
        "Changes of the network made while it ran, in words, each with its direction and time.", default=[]
    )
    stretches: dict[HandName, list[Stretch]] = means(
        "The arm in each stretch of constant network, of 0.5 s at least; absent where nobody changed the network.",
        default={},
    )
    latency_ms: Latency = means("Latency of the samples that estimates used.")
    age_ms: Statistics = statistics("Age of the freshest sample at the ticks.")
    age_of_information_ms: AgeOfInformation = means("Age of the freshest sample over time.")
    tick_modes: TickModes = means("What each mode of `patient.tick` would have done.")
    superseded: int | None = means(
        "Samples that arrived, but were replaced by a fresher one before a tick used them."
    )
    repeated: int | None = means("Packets that brought no new sample, since a copy had been faster.")
    recovered: int | None = means("Samples that came by the history of a later packet.")
    surgeon_traffic: dict[KeyName, KeyTraffic] = means("What the surgeon sent.")
    redundancy: Redundancy = means("Copies and history of the samples.")
    security: str = means("Kind of the scenario's security, `none`, `mtls` or `password`.")
    refused: dict[KindName, int | None] = means(
        "Connections and messages that netem and the sides refused, by kind: no_certificate, "
        "foreign_authority, expired, bad_certificate, no_tls, false_netem (a client that did not accept netem's "
        "certificate), unknown_name, no_password, wrong_password, not_permitted (a message that its sender may not "
        "say), other_run (a message of another run), unsigned and wrong_code (a message without the other side's "
        "code), conflicting (another content under a known sequence number, at "
        "the surgeon)."
    )
    quarantined: dict[KindName, int | None] = means(
        "Messages, and earlier samples in them, that the patient received and did not use, by kind: "
        "conflicting (another content came before under that number or instant), ahead (sampled later than now), "
        "number (not that of its sample), place, speed, acceleration, turn_speed, turn_acceleration, gripper (beyond "
        "the limits of patient.gate)."
    )
    evidence: Evidence = means("What only somebody who forges can have caused.")
    rejected: dict[SideName, int | None] = means("Messages on the testbed's keys that the side could not use.")
    devices: dict[HandName, DeviceFigures] = means("The devices of a live source; absent without one.", default={})
    external_arms: dict[HandName, DeviceFigures] = means("External arms; absent without one.", default={})
    external_camera: CameraFigures | None = means("The external camera; absent without one.", default=None)
    safety: dict[HandName, SafetyFigures | None] = means("What drove the arms; `null` without set points.")
    display: dict[HandName, DisplayFigures | None] = means(
        "The surgeon's display; `null` where nothing was displayed."
    )
    touch: dict[HandName, TouchFigures] = means("What the hands felt; absent without touch.", default={})
    sight: SightFigures | None = means("What the surgeon saw; absent without sight.", default=None)
    ticks: Ticks = means("Ticks of the patient.")
    surgeon_ticks: Ticks = means("Sample instants of the surgeon.")
    accuracy: dict[EstimatorName, Scores] = means("Scores of the estimators, of all hands.")
    orientation_deg: dict[HandName, dict[MethodName, AngleScores]] = means(
        "The angle between a method's orientation and the recorded arm's."
    )
    gripper_rad: dict[HandName, dict[MethodName, AngleScores]] = means("The absolute error of the gripper's angle.")
    orientation_by_age: dict[HandName, dict[MethodName, TurnAgeBins]] = means(
        "Errors of the orientation by the age of the freshest sample."
    )
    error_by_age: dict[HandName, dict[EstimatorName, AgeBins]] = means(
        "Errors of the position by the age of the freshest sample."
    )
    recording: PlayedRecording | None = means("Recording that was played.")
    in_sample: list[str] | None = means(
        "Rows that were both played and trained on, in words; empty when there are none."
    )
    own_estimators: dict[EstimatorName, OwnEstimator] = means(
        "Estimators of the user's own; empty when there are none."
    )
    accuracy_by_hand: dict[HandName, dict[EstimatorName, Scores]] = means(
        "The scores again by hand; absent with a single one.", default={}
    )
    identification: IdentifiedModel | None = means("The identified model; absent without one.", default=None)
    identification_by_hand: dict[HandName, IdentifiedModel] = means(
        "The models by hand; absent with a single one.", default={}
    )
    clocks: dict[SideName, ClockFigures] = means("Clocks of the sides; empty in virtual time.")
    uncertainty_ms: dict[str, Statistics] = means(
        "Bound of the error that the clocks leave in each one-way figure, by the figure's path; empty "
        "when all sides share one clock."
    )
    not_resolvable: list[str] = means("Figures whose bound is larger than the figure itself.")
    processors: dict[SideName, ProcessorFigures | None] = means("Use of the processors; `null` in virtual time.")
    logs: dict[SideName, LogState] = means("The logs that were read.")
    verdicts: list[SetVerdict] = means("The run against each set of requirements.")
    problems: list[str] = means("Reasons for which the run is not valid as a measurement.")
    valid: bool = means("True when `problems` is empty; the figures then are what happened.")

    def text(self, place: str, name: str, unit: str = "") -> str:
        """Return the statistic ``name`` at a dotted place with its clock uncertainty, as `with_uncertainty`."""
        return with_uncertainty(self[place][name], self.uncertainty_ms.get(place, {}).get(name), unit)

    @property
    def unresolved_latency(self) -> str | None:
        """Return a sentence when the clock uncertainty exceeds the latency itself, else None."""
        if "latency_ms.end_to_end.p50" not in self.not_resolvable:
            return None
        bound_ms = self.uncertainty_ms["latency_ms.end_to_end"]["p50"] or 0.0
        margin = f"\u00b1 {rounded_up(bound_ms, 2)} ms"
        return f"the latency of the estimates is not resolvable, the clocks are uncertain by {margin}"

    @property
    def scores_by_hand(self) -> dict[Hand, dict[str, Scores]]:
        """Return the scores by hand, without hands that have none."""
        by_hand = self.accuracy_by_hand or dict.fromkeys(self.display, self.accuracy)
        return {hand: scores for hand, scores in by_hand.items() if scores}


_NO_SUCH_VALUE: Final = (LookupError, TypeError, ValueError, AttributeError, OverflowError)
"""Exceptions of a table or page that a value of another kind than expected can cause."""


def summary_in(content: Mapping[str, Any], path: Path) -> Summary:
    """Return the summary in a file, which anybody may have written.

    Raises `DataError` when it lacks a name that every summary of this version has, or holds a value of another kind.
    """
    try:
        return Summary.model_validate(content)
    except ValidationError as error:
        faults = error.errors(include_url=False, include_input=False)
        absent = sorted({_place(one["loc"]) for one in faults if one["type"] == "missing"})
        if absent:
            more = f" and {len(absent) - 6} more" if len(absent) > 6 else ""
            rule = f"is no summary of this version: it has no {', '.join(absent[:6])}{more}; see tis summarize"
        else:
            rule = f"cannot be shown ({_place(faults[0]['loc'])}: {faults[0]['msg']}); see tis summarize"
        raise DataError(Fault(str(path), "", rule)) from None


def _place(steps: tuple[int | str, ...]) -> str:
    return " ".join(".".join(map(str, steps)).split())


@contextmanager
def readable(path: Path) -> Iterator[None]:
    """Raise `DataError` when what is made of a summary within the block fails: it holds a value of another kind."""
    try:
        yield
    except _NO_SUCH_VALUE as error:
        raise DataError(Fault(str(path), "", f"cannot be shown ({one_line(error)}); see tis summarize")) from None
