"""The summary of a run from its logs, and the columns that several of its subjects share."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Self, get_args

import numpy as np

from tis.common.channels import Arm, Direction, Hand
from tis.common.metrics.latency import Instants, LatencyParts, latency_ms
from tis.common.metrics.percentiles import summarise
from tis.common.scenario import Scenario
from tis.common.scenario.limits import Metric
from tis.common.units import NS_PER_MS
from tis.deploy.logs.read.load import RunLogs
from tis.deploy.logs.read.recorded import run_id_in
from tis.deploy.report.subjects.accuracy import accuracy_of_track, actuation_ms, pooled_accuracy, with_failures
from tis.deploy.report.subjects.age import TICK_MODES, age_of_information_ms, ages_ns, freshest_arrivals, tick_modes
from tis.deploy.report.subjects.clocks import clock_figures, not_resolvable, one_way_uncertainty
from tis.deploy.report.subjects.devices import devices_summary, is_foreign
from tis.deploy.report.subjects.display import display_summary
from tis.deploy.report.subjects.identification import identified, recording_figures, source_label, two_recordings
from tis.deploy.report.subjects.intrusion import count_of, evidence_summary, quarantined, refused
from tis.deploy.report.subjects.latency import (
    Latency,
    UsedSamples,
    network_round_trips,
    round_trips,
    sample_latency,
    used_samples,
)
from tis.deploy.report.subjects.logs import log_states
from tis.deploy.report.subjects.measured_values import measured_values
from tis.deploy.report.subjects.network.link_summary import link_summary
from tis.deploy.report.subjects.network.requested import Requested
from tis.deploy.report.subjects.orientation import gripper_rad, orientation_by_age, orientation_deg, wrist_track
from tis.deploy.report.subjects.own_estimators import own_estimators
from tis.deploy.report.subjects.processors import processors_summary
from tis.deploy.report.subjects.redundancy import redundancy, surgeon_traffic
from tis.deploy.report.subjects.requirements import verdicts
from tis.deploy.report.subjects.safety import safety_summary
from tis.deploy.report.subjects.ticks import active_duration_s, tick_figures
from tis.deploy.report.subjects.tracking import HandTrack, errors_by_age, track_of_hand
from tis.deploy.report.summary import Summary
from tis.deploy.report.validity import invalidities
from tis.patient_side.statespace import ArmModel


@dataclass(frozen=True)
class MeasuredRun:
    """The logs and the scenario of a run, the arm of each hand, and the identified models."""

    logs: RunLogs
    scenario: Scenario
    arms: dict[Hand, Arm]
    models: Sequence[ArmModel] = ()

    @classmethod
    def of(cls, logs: RunLogs, scenario: Scenario, models: Sequence[ArmModel]) -> Self:
        """Return the run with the arms that its models are of."""
        return cls(logs, scenario, {model.hand: model.arm for model in models}, models)

    @cached_property
    def used(self) -> UsedSamples:
        """Return each sample at its first use."""
        return used_samples(self.logs, self.scenario.session, self.arms)

    @cached_property
    def latency(self) -> LatencyParts:
        """Return the latency of each used sample by part."""
        return sample_latency(self.used)

    @cached_property
    def round_trips_ns(self) -> Instants:
        """Return the round trip of each command that an estimate answers."""
        return round_trips(self.logs, self.scenario.session, self.arms)

    @cached_property
    def requests(self) -> dict[Direction, Requested]:
        """Return the requested network of each direction."""
        return {way: Requested.of(self.scenario, way, self.logs) for way in get_args(Direction)}


def build_summary(
    logs: RunLogs, scenario: Scenario, models: Sequence[ArmModel], mode: str, exit_code: int | None, command: str
) -> dict[str, Any]:
    """Return the content of ``summary.json``."""
    return summary_of(MeasuredRun.of(logs, scenario, models), mode, exit_code, command).as_json()


def summary_of(run: MeasuredRun, mode: str, exit_code: int | None, command: str) -> Summary:
    """Return the summary of a run from its logs; a figure that cannot be computed is None.

    ``problems`` lists what makes the run invalid as a measurement; ``valid`` is true without any.
    """
    logs, scenario = run.logs, run.scenario
    found = {direction: link_summary(logs, direction, scenario) for direction in get_args(Direction)}
    problems = logs.problems() + two_recordings(logs) + [text for _, faults in found.values() for text in faults]
    tracks = {model.hand: track_of_hand(logs, scenario, model.hand) for model in run.models}
    traffic = surgeon_traffic(logs, active_duration_s(logs, "surgeon", scenario))
    repeats = redundancy(logs, scenario, run.arms, traffic)
    durations_ns: dict[Metric, Instants] = {
        "age": ages_ns(logs),
        "round_trip": run.round_trips_ns,
        "network_round_trip": network_round_trips(run.used),
    }
    draft = Summary(
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
        links={direction: link for direction, (link, _) in found.items()},
        superseded=count_of(logs, "patient", "superseded"),
        repeated=count_of(logs, "patient", "repeated"),
        recovered=count_of(logs, "patient", "recovered"),
        surgeon_traffic=traffic,
        redundancy=repeats,
        security=scenario.security.kind,
        refused=refused(logs),
        quarantined=quarantined(logs),
        evidence=evidence_summary(logs, scenario),
        rejected={side: count_of(logs, side, "rejected") for side in logs.sides if side != "netem"},
        **devices_summary(logs, scenario),
        safety=safety_summary(logs, scenario, tracks),
        display=display_summary(logs, tracks),
        ticks=tick_figures(logs, "patient", scenario),
        surgeon_ticks=tick_figures(logs, "surgeon", scenario),
        **_latency_and_age(run, durations_ns, tracks),
        **_estimation(run, tracks),
        **recording_figures(logs, scenario, run.models),
        processors=processors_summary(logs),
        logs=log_states(logs),
        verdicts=[],
        problems=[],
        valid=True,
    )
    # the rest judges these figures
    problems += invalidities(draft, scenario, logs)
    values = measured_values(
        logs, scenario, run.used, run.latency, durations_ns, list(tracks.values()), repeats.loss_text
    )
    judged = verdicts(values, scenario.limits, _over_s(logs, scenario))
    return draft.model_copy(update={"verdicts": judged, "problems": problems, "valid": not problems})


def _latency_and_age(
    run: MeasuredRun, durations_ns: Mapping[Metric, Instants], tracks: Mapping[Hand, HandTrack]
) -> dict[str, Any]:
    """Return latencies and ages, and what the clocks leave open of them."""
    logs, scenario = run.logs, run.scenario
    actuation_ns = [
        NS_PER_MS * actuation_ms(track, scenario.active_estimator, scenario.rate_hz) for track in tracks.values()
    ]
    others = {"actuation": np.concatenate([np.empty(0), *actuation_ns])}
    others |= {name: durations_ns[name] for name in ("round_trip", "network_round_trip")}
    arrivals = freshest_arrivals(logs, scenario.session, run.arms)
    latency, age_ms = Latency(**latency_ms(run.latency, others)), summarise(durations_ns["age"] / NS_PER_MS)
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


def _estimation(run: MeasuredRun, tracks: Mapping[Hand, HandTrack]) -> dict[str, Any]:
    """Return the scores of the estimators, their origin, and the identified models."""
    logs, scenario, models = run.logs, run.scenario, run.models
    scores = {model.hand: accuracy_of_track(logs, scenario, tracks[model.hand], model) for model in models}
    each = [(tracks[model.hand], model) for model in models]
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


def _over_s(logs: RunLogs, scenario: Scenario) -> float | None:
    """Return the duration of the measurement; None when a log is damaged."""
    lacking = (log for log in logs.sides.values() if not log.coverage.whole)
    return None if any(lacking) else active_duration_s(logs, "surgeon", scenario)
