"""``summary.json``: the figures of a run. Its names are an interface, and keep their meaning."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

import numpy as np
from pydantic import ValidationError

from tis.common.channels import Hand
from tis.common.errors import DataError, Fault, one_line
from tis.common.metrics.latency import latency_ms
from tis.common.metrics.percentiles import summarise
from tis.common.units import NS_PER_MS
from tis.deploy.logs.read.load import run_id_in
from tis.deploy.present.numbers import rounded_up
from tis.deploy.report.measured_run import MeasuredRun
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
from tis.deploy.report.subjects.accuracy import Scores, pooled_accuracy, with_failures
from tis.deploy.report.subjects.age import (
    TICK_MODES,
    AgeOfInformation,
    TickModes,
    age_of_information_ms,
    freshest_arrivals,
    tick_modes,
)
from tis.deploy.report.subjects.clocks import ClockFigures, clock_figures, not_resolvable, one_way_uncertainty
from tis.deploy.report.subjects.devices import DeviceFigures, devices_summary, is_foreign
from tis.deploy.report.subjects.display import DisplayFigures, display_summary
from tis.deploy.report.subjects.identification import (
    IdentifiedModel,
    PlayedRecording,
    identified,
    recording_figures,
    source_label,
    two_recordings,
)
from tis.deploy.report.subjects.intrusion import Evidence, evidence_summary, quarantined, refused
from tis.deploy.report.subjects.latency import (
    Latency,
)
from tis.deploy.report.subjects.logs import LogState, count_of, log_states
from tis.deploy.report.subjects.network.link_figures import Link
from tis.deploy.report.subjects.offsets import actuation_ms
from tis.deploy.report.subjects.orientation import (
    AngleScores,
    gripper_rad,
    orientation_by_age,
    orientation_deg,
    wrist_track,
)
from tis.deploy.report.subjects.own_estimators import OwnEstimator, own_estimators
from tis.deploy.report.subjects.processors import ProcessorFigures, processors_summary
from tis.deploy.report.subjects.redundancy import KeyTraffic, Redundancy, redundancy, surgeon_traffic
from tis.deploy.report.subjects.requirements import SetVerdict
from tis.deploy.report.subjects.safety import SafetyFigures, safety_summary
from tis.deploy.report.subjects.ticks import Ticks, active_duration_s, tick_figures
from tis.deploy.report.subjects.tracking import AgeBins, TurnAgeBins, errors_by_age


class Summary(Section):
    """The summary of a run; a figure that cannot be computed is None."""

    scenario: str = means("Name of the scenario.")
    seed: int = means("Seed of every random number.")
    mode: str = means("`live`, `twin`, or what else made the logs.")
    run_id: int | None = means("Number of the run, which all its logs carry; `null` for a twin.")
    exit: int | None = means("Exit code that the sides gave the run; `null` in a summary that was computed again.")
    command: str = means("Command line that began the run.")
    duration_s: float = means("Length of the surgeon's movement; the drain is not included.")
    source: str = means("Origin of the movement, in words.")
    active_estimator: str = means("Estimator that the patient acts on.")
    active_orientation: str = means("Orientation method whose orientation and gripper the answers carry.")
    links: dict[DirectionName, Link] = means("The two directions of the network.")
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
        "say), other_run (a message of another run), conflicting (another content under a known sequence number, at "
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
    safety: dict[HandName, SafetyFigures | None] = means("What drove the arms; `null` without set points.")
    display: dict[HandName, DisplayFigures | None] = means(
        "The surgeon's display; `null` where nothing was displayed."
    )
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

    def scores_by_hand(self, single: Hand) -> dict[Hand, dict[str, Scores]]:
        """Return the scores by hand, without hands that have none; ``single`` is the hand where there is one."""
        by_hand = self.accuracy_by_hand or {single: self.accuracy}
        return {hand: scores for hand, scores in by_hand.items() if scores}


def measured(run: MeasuredRun, mode: str, exit_code: int | None, command: str) -> Summary:
    """Return the figures of a run, not judged yet: its problems are only those of logs and books."""
    logs, scenario = run.logs, run.scenario
    traffic = surgeon_traffic(logs, active_duration_s(logs, "surgeon", scenario))
    return Summary(
        scenario=scenario.name,
        seed=scenario.seed,
        mode=mode,
        run_id=run_id_in(logs),
        exit=exit_code,
        command=command,
        duration_s=scenario.duration_s,
        source=source_label(scenario, is_foreign(logs)),
        active_estimator=scenario.active_estimator,
        active_orientation=scenario.patient.orientation.active,
        links={direction: link for direction, (link, _) in run.links.items()},
        superseded=count_of(logs, "patient", "superseded"),
        repeated=count_of(logs, "patient", "repeated"),
        recovered=count_of(logs, "patient", "recovered"),
        surgeon_traffic=traffic,
        redundancy=redundancy(logs, scenario, run.arms, traffic),
        security=scenario.security.kind,
        refused=refused(logs),
        quarantined=quarantined(logs),
        evidence=evidence_summary(logs, scenario),
        rejected={side: count_of(logs, side, "rejected") for side in logs.sides if side != "netem"},
        **devices_summary(logs, scenario),
        safety=safety_summary(logs, scenario, run.tracks),
        display=display_summary(logs, run.tracks),
        ticks=tick_figures(logs, "patient", scenario),
        surgeon_ticks=tick_figures(logs, "surgeon", scenario),
        **_latency_and_age(run),
        **_estimation(run),
        **recording_figures(logs, scenario, run.models),
        processors=processors_summary(logs),
        logs=log_states(logs),
        verdicts=[],
        problems=logs.problems()
        + two_recordings(logs)
        + [text for _, faults in run.links.values() for text in faults],
        valid=False,
    )


def _latency_and_age(run: MeasuredRun) -> dict[str, Any]:
    """Return latencies and ages, and what the clocks leave open of them."""
    logs, scenario = run.logs, run.scenario
    actuation_ns = [
        NS_PER_MS * actuation_ms(track, scenario.active_estimator, scenario.rate_hz) for track in run.tracks.values()
    ]
    others = {"actuation": np.concatenate([np.empty(0), *actuation_ns])}
    others |= {name: run.durations_ns[name] for name in ("round_trip", "network_round_trip")}
    arrivals = freshest_arrivals(logs, scenario.session, run.arms)
    latency, age_ms = Latency(**latency_ms(run.latency, others)), summarise(run.durations_ns["age"] / NS_PER_MS)
    over_time, modes = age_of_information_ms(logs, arrivals), tick_modes(logs, scenario, arrivals)
    figures = {
        "latency_ms.network": latency.network,
        "latency_ms.end_to_end": latency.end_to_end,
        "age_ms": age_ms,
        "age_of_information_ms": {"mean": over_time.mean},
        "age_of_information_ms.peak": over_time.peak,
        **{f"tick_modes.{name}.age_when_used_ms": modes[name].age_when_used_ms for name in TICK_MODES},
    }
    bounds = one_way_uncertainty(figures, logs, run.used)
    return {
        "latency_ms": latency,
        "age_ms": age_ms,
        "age_of_information_ms": over_time,
        "tick_modes": modes,
        "clocks": clock_figures(logs),
        "uncertainty_ms": bounds,
        "not_resolvable": not_resolvable(figures, bounds),
    }


def _estimation(run: MeasuredRun) -> dict[str, Any]:
    """Return the scores of the estimators, their origin, and the identified models."""
    logs, scenario, models, tracks = run.logs, run.scenario, run.models, run.tracks
    each = [(tracks[model.hand], model) for model in models]
    scores = {one[1].hand: pooled_accuracy(logs, scenario, [one]) for one in each}
    pooled = scores[models[0].hand] if len(models) == 1 else pooled_accuracy(logs, scenario, each)
    own = own_estimators(logs, scenario)
    wrists = {hand: wrist_track(logs, scenario, track, hand) for hand, track in tracks.items()}
    found: dict[str, Any] = {
        "accuracy": with_failures(pooled, own),
        "orientation_deg": {hand: orientation_deg(logs, tracks[hand], wrist, hand) for hand, wrist in wrists.items()},
        "gripper_rad": {hand: gripper_rad(tracks[hand], wrist) for hand, wrist in wrists.items()},
        "orientation_by_age": {
            hand: orientation_by_age(logs, tracks[hand], wrist, hand) for hand, wrist in wrists.items()
        },
        "error_by_age": {model.hand: errors_by_age(logs, tracks[model.hand], model.hand) for model in models},
        "own_estimators": own,
    }
    if models:
        found["identification"] = identified(models[0], scenario)
    if len(models) > 1:
        found["accuracy_by_hand"] = {hand: with_failures(one, own) for hand, one in scores.items()}
        found["identification_by_hand"] = {model.hand: identified(model, scenario) for model in models}
    return found


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
