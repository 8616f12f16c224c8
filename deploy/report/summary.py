"""``summary.json``: latency, loss and accuracy of a run. Its names are an interface."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any, Final, get_args

import numpy as np

from tis.common.channels import Arm, Direction, Hand, Side
from tis.common.metrics.latency import Instants, LatencyParts, latency_ms, tick_summary
from tis.common.metrics.percentiles import summarise
from tis.common.records import COUNTERS, TICKS
from tis.common.safety_records import QUARANTINED
from tis.common.scenario import Scenario
from tis.common.scenario.limits import Metric
from tis.common.sources.provenance import RECORDING_FILE, parse_played
from tis.common.units import NS_PER_MS
from tis.deploy.logs.read.load import RunLogs
from tis.deploy.logs.read.recorded import run_id_in
from tis.deploy.logs.read.side_columns import SideLog
from tis.deploy.report.link_summary import link_summary
from tis.deploy.report.measures.devices import devices_summary, is_foreign
from tis.deploy.report.measures.display import display_summary
from tis.deploy.report.measures.duration import active_duration_s
from tis.deploy.report.measures.estimation.error_by_age import errors_by_age
from tis.deploy.report.measures.estimation.freshness import age_of_information_ms, freshest_arrivals, tick_modes
from tis.deploy.report.measures.estimation.offsets import actuation_ms
from tis.deploy.report.measures.estimation.orientation_error import gripper_rad, orientation_by_age, orientation_deg
from tis.deploy.report.measures.estimation.own_estimators import mark_failed, own_estimators
from tis.deploy.report.measures.estimation.tracking import (
    HandTrack,
    accuracy_of_track,
    pooled_accuracy,
    track_of_hand,
)
from tis.deploy.report.measures.estimation.wrist_track import wrist_track
from tis.deploy.report.measures.evidence import evidence_summary
from tis.deploy.report.measures.latency import (
    UsedSamples,
    ages_ns,
    network_round_trips,
    round_trips,
    sample_latency,
    used_samples,
)
from tis.deploy.report.measures.network.refusals import refused
from tis.deploy.report.measures.network.traffic import surgeon_traffic
from tis.deploy.report.measures.processors import processors_summary
from tis.deploy.report.measures.redundancy import redundancy
from tis.deploy.report.measures.safety import safety_summary
from tis.deploy.report.measures.ticks_away import ticks_away
from tis.deploy.report.measures.uncertainty import clock_figures
from tis.deploy.report.tables.redundancy_rows import sample_loss_text
from tis.deploy.report.verdict.invalidity import invalidities, two_recordings
from tis.deploy.report.verdict.measured_values import measured_values
from tis.deploy.report.verdict.requirements import verdicts
from tis.patient_side.provenance import in_sample, model_file
from tis.patient_side.safety.gate import Kind
from tis.patient_side.statespace import ArmModel

_LINKS: Final[tuple[Direction, ...]] = ("forward", "feedback")


def build_summary(
    logs: RunLogs, scenario: Scenario, models: Sequence[ArmModel], mode: str, exit_code: int | None, command: str
) -> dict[str, Any]:
    """Return the summary of a run from its logs; a figure that cannot be computed is null.

    ``problems`` lists what makes the run invalid as a measurement; ``valid`` is true without any.
    """
    problems, links = logs.problems() + two_recordings(logs), dict[str, Any]()
    for direction in _LINKS:
        links[direction], faults = link_summary(logs, direction, scenario)
        problems += faults

    # columns that several figures share
    arms = {model.hand: model.arm for model in models}
    used = used_samples(logs, scenario.session, arms)
    parts, durations_ns = sample_latency(used), _durations(logs, scenario, used, arms)
    tracks = {model.hand: track_of_hand(logs, scenario, model.hand) for model in models}
    traffic = surgeon_traffic(logs, active_duration_s(logs, "surgeon", scenario))
    repeats = redundancy(logs, scenario, arms, traffic)

    summary: dict[str, Any] = {
        "scenario": scenario.name,
        "seed": scenario.seed,
        "mode": mode,
        "run_id": run_id_in(logs),
        "exit": exit_code,
        "command": command,
        "duration_s": scenario.duration_s,
        "source": source_label(scenario, is_foreign(logs)),
        "active_estimator": scenario.active_estimator,
        "active_orientation": scenario.patient.orientation.active,
        "links": links,
        **_latency_and_age(logs, scenario, parts, durations_ns, tracks, arms),
        **{name: _counter(logs, name) for name in ("superseded", "repeated", "recovered")},
        "surgeon_traffic": traffic,
        "redundancy": repeats,
        "security": scenario.security.kind,
        "refused": refused(logs),
        "quarantined": _quarantined(logs),
        "evidence": evidence_summary(logs, scenario),
        "rejected": {side: _count(log, "rejected") for side, log in logs.sides.items() if side != "netem"},
        **devices_summary(logs, scenario),
        "safety": safety_summary(logs, scenario, tracks),
        "display": display_summary(logs, tracks),
        "ticks": _ticks(logs, "patient", scenario),
        "surgeon_ticks": _ticks(logs, "surgeon", scenario),
        **_estimation(logs, scenario, models, tracks),
    }

    # the rest judges figures that are in the summary already
    summary |= clock_figures(summary, logs, used)
    summary["processors"] = processors_summary(logs)
    summary["logs"] = _logs(logs)
    problems += invalidities(summary, scenario, logs)
    found = measured_values(
        logs, scenario, used, parts, durations_ns, list(tracks.values()), sample_loss_text(repeats)
    )
    summary["verdicts"] = verdicts(found, scenario.limits, _over_s(logs, scenario))
    summary |= {"problems": problems, "valid": not problems}
    return summary


def _latency_and_age(
    logs: RunLogs,
    scenario: Scenario,
    parts: LatencyParts,
    durations_ns: Mapping[Metric, Instants],
    tracks: Mapping[Hand, HandTrack],
    arms: Mapping[Hand, Arm],
) -> dict[str, Any]:
    actuation_ns = [
        NS_PER_MS * actuation_ms(track, scenario.active_estimator, scenario.rate_hz) for track in tracks.values()
    ]
    others = {"actuation": np.concatenate([np.empty(0), *actuation_ns])}
    others |= {name: durations_ns[name] for name in ("round_trip", "network_round_trip")}
    arrivals = freshest_arrivals(logs, scenario.session, arms)
    return {
        "latency_ms": latency_ms(parts, others),
        "age_ms": summarise(durations_ns["age"] / NS_PER_MS),
        "age_of_information_ms": age_of_information_ms(logs, arrivals),
        "tick_modes": tick_modes(logs, scenario, arrivals),
    }


def _estimation(
    logs: RunLogs, scenario: Scenario, models: Sequence[ArmModel], tracks: Mapping[Hand, HandTrack]
) -> dict[str, Any]:
    """Return the scores of the estimators, their origin and that of their data, and the identified models."""
    scores = {model.hand: accuracy_of_track(logs, scenario, tracks[model.hand], model) for model in models}
    each = [(tracks[model.hand], model) for model in models]
    pooled = scores[models[0].hand] if len(models) == 1 else pooled_accuracy(logs, scenario, each)
    own = own_estimators(logs, scenario)
    mark_failed(own, [pooled, *scores.values()])
    found = {
        "accuracy": pooled,
        **_orientations(logs, scenario, tracks),
        "error_by_age": {model.hand: errors_by_age(logs, tracks[model.hand], model.hand) for model in models},
        **_recording(logs, scenario, models),
        "own_estimators": own,
    }
    if len(models) > 1:
        found["accuracy_by_hand"] = scores
    if models:
        found["identification"] = _identification(models[0], scenario)
    if len(models) > 1:
        found["identification_by_hand"] = {model.hand: _identification(model, scenario) for model in models}
    return found


def _orientations(logs: RunLogs, scenario: Scenario, tracks: Mapping[Hand, HandTrack]) -> dict[str, Any]:
    """Return by hand the errors of the orientation methods."""
    wrists = {hand: wrist_track(logs, scenario, track, hand) for hand, track in tracks.items()}
    return {
        "orientation_deg": {hand: orientation_deg(logs, tracks[hand], wrist, hand) for hand, wrist in wrists.items()},
        "gripper_rad": {hand: gripper_rad(tracks[hand], wrist) for hand, wrist in wrists.items()},
        "orientation_by_age": {
            hand: orientation_by_age(logs, tracks[hand], wrist, hand) for hand, wrist in wrists.items()
        },
    }


def source_label(scenario: Scenario, foreign_surgeon: bool = False) -> str:
    """Return the origin of the movement in words."""
    source = scenario.source
    hands = " and ".join(source.hands)
    return f"{'foreign surgeon' if foreign_surgeon else source.label}, {hands} hand"


def _durations(
    logs: RunLogs, scenario: Scenario, used: UsedSamples, arms: Mapping[Hand, Arm]
) -> dict[Metric, Instants]:
    return {
        "age": ages_ns(logs),
        "round_trip": round_trips(logs, scenario.session, arms),
        "network_round_trip": network_round_trips(used),
    }


def _ticks(logs: RunLogs, side: Side, scenario: Scenario) -> dict[str, Any]:
    log = logs.sides[side] if logs.coverage(side) is not None else None
    empty = np.empty(0, dtype=np.int64)
    due = empty if log is None else log.column(TICKS, "due_ns")
    begin = empty if log is None else log.column(TICKS, "begin_ns")
    missed = empty.astype(np.bool_) if log is None else log.column(TICKS, "missed").astype(np.bool_)
    found: dict[str, Any] = dict(tick_summary(scenario.rate_hz, due, begin, missed))
    if log is None:
        return found | {"count": None, "missed": None, "planned": scenario.n_samples}
    away = ticks_away(log.column(TICKS, "tick"), log.coverage, scenario.rate_hz, scenario.n_samples)
    found["count"] += away.n_missed
    found["missed"] += away.n_missed
    return found | {"planned": scenario.n_samples - away.n_left_out}


def _count(log: SideLog, name: str) -> int | None:
    return next((row["value"] for row in log.of(COUNTERS) if row["name"] == name), None)


def _quarantined(logs: RunLogs) -> dict[str, int | None]:
    """Return by kind the number of messages and earlier samples that the patient received and did not use."""
    return {kind: _counter(logs, f"{QUARANTINED}.{kind}") for kind in get_args(Kind)}


def _counter(logs: RunLogs, name: str) -> int | None:
    log = logs.sides.get("patient")
    return None if log is None else _count(log, name)


def _identification(model: ArmModel, scenario: Scenario) -> dict[str, Any]:
    return {
        "method": model.method,
        "order": model.order,
        "static": model.static,
        "block_rows": model.block_rows,
        "train": model.train,
        "model_file": model_file(scenario),
        "trained_on": [asdict(rows) for rows in model.trained_on],
        "fit_pct": list(model.fit_pct),
        "singular_values": model.singular_values.tolist(),
        "spectral_radius": model.spectral_radius,
        "pairing": model.pairing,
        "warnings": list(model.warnings),
    }


def _recording(logs: RunLogs, scenario: Scenario, models: Sequence[ArmModel]) -> dict[str, Any]:
    """Return the recording that the run plays, and the models trained on the rows played; None if unknown."""
    attached = logs.attachments("patient").get(RECORDING_FILE)
    if attached is None:
        return {"recording": None, "in_sample": None}
    rows, recording = parse_played(attached, "patient.mcap")
    return {"recording": recording, "in_sample": list(in_sample(scenario, models, rows))}


def _logs(logs: RunLogs) -> dict[str, Any]:
    """Return by side the log file that was read, its state, and the spans of run time that it lacks."""
    missing = {"state": "missing", "file": None, "unknown_s": [[0.0, None]], "lost_bytes": None}
    found = {
        side: {**log.coverage.summary(), "file": log.coverage.file or f"{side}.mcap"}
        for side, log in logs.sides.items()
    }
    return {side: found.get(side, missing) for side in get_args(Side)}


def _over_s(logs: RunLogs, scenario: Scenario) -> float | None:
    """Return the duration of the measurement; None when a log is damaged."""
    lacking = (log for log in logs.sides.values() if not log.coverage.whole)
    return None if any(lacking) else active_duration_s(logs, "surgeon", scenario)
