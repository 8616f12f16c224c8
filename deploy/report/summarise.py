"""The summary of a run from its logs, judged: its problems, and the verdict on each set of requirements."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from msgspec import convert

from tis.common.metrics.latency import latency_ms
from tis.common.metrics.percentiles import summarise
from tis.common.records import CONTROL, ControlNote
from tis.common.scenario import Scenario
from tis.common.units import NS_PER_MS
from tis.deploy.logs.read.columns import joined
from tis.deploy.logs.read.load import RunLogs, run_id_in
from tis.deploy.report.measured_run import MeasuredRun
from tis.deploy.report.subjects import (
    accuracy,
    age,
    clocks,
    devices,
    display,
    identification,
    intrusion,
    orientation,
    own_estimators,
    processors,
    safety,
    seen_pictures,
    sight,
    stretches,
    touch,
    tracking,
)
from tis.deploy.report.subjects.latency import Latency
from tis.deploy.report.subjects.logs import bypass_problems, count_of, log_states
from tis.deploy.report.subjects.measured_values import measured_values
from tis.deploy.report.subjects.redundancy import redundancy, surgeon_traffic
from tis.deploy.report.subjects.requirements import Measured, verdicts
from tis.deploy.report.subjects.ticks import active_duration_s, tick_figures
from tis.deploy.report.summary import Summary
from tis.deploy.report.validity import invalidities
from tis.netem.control.replay import made_changes
from tis.patient_side.statespace import ArmModel


def build_summary(
    logs: RunLogs, scenario: Scenario, models: Sequence[ArmModel], mode: str, exit_code: int | None, command: str
) -> dict[str, Any]:
    """Return the content of ``summary.json``."""
    return summary_of(MeasuredRun.of(logs, scenario, models), mode, exit_code, command).as_json()


def summary_of(run: MeasuredRun, mode: str, exit_code: int | None, command: str) -> Summary:
    """Return the summary of a run from its logs; a figure that cannot be computed is None.

    ``problems`` lists what makes the run invalid as a measurement; ``valid`` is true without any.
    """
    found = _measured(run, mode, exit_code, command)
    problems = found.problems + invalidities(found, run.scenario, run.logs)
    tracks, samples_lost = list(run.tracks.values()), found.redundancy.loss_text
    values = measured_values(run.logs, run.scenario, run.used, run.latency, run.durations_ns, tracks, samples_lost)
    if run.pictures is not None and (frozen_pct := run.pictures.freezes.share_pct) is not None:
        values["freeze", None] = Measured(np.array([frozen_pct]))
    judged = verdicts(values, run.scenario.limits, _over_s(run.logs, run.scenario))
    return found.model_copy(update={"verdicts": judged, "problems": problems, "valid": not problems})


def _over_s(logs: RunLogs, scenario: Scenario) -> float | None:
    """Return the duration of the measurement; None when a log is damaged."""
    lacking = (log for log in logs.sides.values() if not log.coverage.whole)
    return None if any(lacking) else active_duration_s(logs, "surgeon", scenario)


def _measured(run: MeasuredRun, mode: str, exit_code: int | None, command: str) -> Summary:
    """Return the figures of a run, not judged yet: its problems are only those of logs and books."""
    logs, scenario = run.logs, run.scenario
    played = identification.recording_figures(logs, scenario, run.models)
    traffic = surgeon_traffic(logs, active_duration_s(logs, "surgeon", scenario))
    seen = sight.sight_summary(run.pictures, logs, scenario, run.arms)
    if run.pictures is not None:
        compared = seen_pictures.quality(logs.run_dir, scenario, run.pictures)
        seen["sight"] = seen["sight"].model_copy(update={"quality": compared})
    return Summary(
        scenario=scenario.name,
        seed=scenario.seed,
        mode=mode,
        run_id=run_id_in(logs),
        exit=exit_code,
        command=command,
        duration_s=_over_s(logs, scenario) or scenario.duration_s,
        source=identification.source_label(scenario, devices.is_foreign(logs), played["recording"]),
        active_estimator=scenario.active_estimator,
        active_orientation=scenario.patient.orientation.active,
        links={direction: link for direction, (link, _) in run.links.items()},
        changes=[*map(str, made_changes(convert(row, ControlNote) for row in logs.of("netem", CONTROL)))],
        superseded=count_of(logs, "patient", "superseded"),
        repeated=count_of(logs, "patient", "repeated"),
        recovered=count_of(logs, "patient", "recovered"),
        surgeon_traffic=traffic,
        redundancy=redundancy(logs, scenario, run.arms, traffic),
        security=scenario.security.kind,
        refused=intrusion.refused(logs),
        quarantined=intrusion.quarantined(logs),
        evidence=intrusion.evidence_summary(logs, scenario),
        rejected={side: count_of(logs, side, "rejected") for side in logs.sides if side != "netem"},
        **devices.devices_summary(logs, scenario),
        **devices.camera_summary(logs, scenario, 0 if run.pictures is None else run.pictures.n_unreadable),
        safety=safety.safety_summary(logs, scenario, run.tracks, run.models),
        display=display.display_summary(logs, run.tracks),
        **touch.touch_summary(logs, scenario, run.arms),
        **stretches.stretches(logs, scenario, run.requests, run.tracks, run.arms),
        **seen,
        ticks=tick_figures(logs, "patient", scenario),
        surgeon_ticks=tick_figures(logs, "surgeon", scenario),
        **_latency_and_age(run, seen),
        **_estimation(run),
        **played,
        processors=processors.processors_summary(logs),
        logs=log_states(logs),
        verdicts=[],
        problems=logs.problems()
        + bypass_problems(logs)
        + identification.two_recordings(logs)
        + [text for _, faults in run.links.values() for text in faults],
        valid=False,
    )


def _latency_and_age(run: MeasuredRun, seen: dict[str, Any]) -> dict[str, Any]:
    """Return latencies and ages, and what the clocks leave open of them."""
    logs, scenario = run.logs, run.scenario
    actuation_ns = []
    for hand, track in run.tracks.items():
        driven = safety.set_points(logs, scenario, track, hand)
        follows = None if driven is None else driven.mode == "tracking"
        late_ms = tracking.actuation_ms(track, scenario.active_estimator, scenario.rate_hz, follows)
        actuation_ns.append(NS_PER_MS * late_ms)
    others = {"actuation": joined(actuation_ns, float)}
    others |= {name: run.durations_ns[name] for name in ("round_trip", "network_round_trip")}
    arrivals = age.freshest_arrivals(logs, scenario.session, run.arms)
    latency, age_ms = Latency(**latency_ms(run.latency, others)), summarise(run.durations_ns["age"] / NS_PER_MS)
    over_time, modes = age.age_of_information_ms(logs, arrivals), age.tick_modes(logs, scenario, arrivals)
    figures = {
        "latency_ms.network": latency.network,
        "latency_ms.end_to_end": latency.end_to_end,
        "age_ms": age_ms,
        "age_of_information_ms": {"mean": over_time.mean},
        "age_of_information_ms.peak": over_time.peak,
        **{f"tick_modes.{name}.age_when_used_ms": modes[name].age_when_used_ms for name in age.TICK_MODES},
    }
    bounds = clocks.one_way_uncertainty(figures, logs, run.used)
    if run.pictures is not None and (of_glass := sight.glass_bounds(run.pictures, logs)) is not None:
        figures[sight.GLASS], bounds[sight.GLASS] = seen["sight"].glass_to_glass_ms, of_glass
    return {
        "latency_ms": latency,
        "age_ms": age_ms,
        "age_of_information_ms": over_time,
        "tick_modes": modes,
        "clocks": clocks.clock_figures(logs),
        "uncertainty_ms": bounds,
        "not_resolvable": clocks.not_resolvable(figures, bounds),
    }


def _estimation(run: MeasuredRun) -> dict[str, Any]:
    """Return the scores of the estimators, their origin, and the identified models."""
    logs, scenario, models, tracks = run.logs, run.scenario, run.models, run.tracks
    each = [(tracks[model.hand], model) for model in models]
    scores = {one[1].hand: accuracy.pooled_accuracy(logs, scenario, [one]) for one in each}
    pooled = scores[models[0].hand] if len(models) == 1 else accuracy.pooled_accuracy(logs, scenario, each)
    own = own_estimators.own_estimators(logs, scenario)
    found: dict[str, Any] = {
        "accuracy": accuracy.with_failures(pooled, own),
        "orientation_deg": {
            hand: orientation.orientation_deg(logs, tracks[hand], wrist, hand) for hand, wrist in run.wrists.items()
        },
        "gripper_rad": {hand: orientation.gripper_rad(tracks[hand], wrist) for hand, wrist in run.wrists.items()},
        "orientation_by_age": {
            hand: orientation.orientation_by_age(logs, tracks[hand], wrist, hand)
            for hand, wrist in run.wrists.items()
        },
        "error_by_age": {
            model.hand: tracking.errors_by_age(logs, tracks[model.hand], model.hand) for model in models
        },
        "own_estimators": own,
    }
    if models:
        found["identification"] = identification.identified(models[0], scenario)
    if len(models) > 1:
        found["accuracy_by_hand"] = {hand: accuracy.with_failures(one, own) for hand, one in scores.items()}
        found["identification_by_hand"] = {model.hand: identification.identified(model, scenario) for model in models}
    return found
