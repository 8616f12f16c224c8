"""Orientation and gripper: errors of the orientation methods on the ticks of a hand's track, beside hold's."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import scipy
from numpy.typing import NDArray

from tis.common.channels import Hand
from tis.common.metrics.consistency import consistency, normalised_squares
from tis.common.metrics.percentiles import summarise
from tis.common.metrics.tracking import angles_deg, error_vectors, orientation_at
from tis.common.records import ORIENTATIONS, TRUTH
from tis.common.scenario import Scenario
from tis.deploy.logs.read.columns import Ints
from tis.deploy.logs.read.load import RunLogs
from tis.deploy.present.numbers import NONE, percent
from tis.deploy.present.table import Table
from tis.deploy.report.section import Section, Statistics, means, statistics
from tis.deploy.report.subjects.accuracy import Consistency, step_times_us
from tis.deploy.report.subjects.age import ages_at_ms
from tis.deploy.report.subjects.tracking import Array, HandTrack, TurnAgeBins, at_ticks, error_by_age


class AngleScores(Section):
    """The error of an orientation method, or of its gripper's angle."""

    rms: float | None = means("Root mean square of the error, over the scored ticks.")
    p50: float | None = means("Median of the error, over the scored ticks.")
    p95: float | None = means("95th percentile of the error, over the scored ticks.")
    p99: float | None = means("99th percentile of the error, over the scored ticks.")
    max: float | None = means("Largest error, over the scored ticks.")
    ratio_to_hold: float | None = means("RMS over that of `hold`; below 1 is better than `hold`.")
    n_scored: int = means("Scored ticks.")
    n_missing: int = means("Scored ticks without an estimate; they count with the error of `hold`.")
    nees: Consistency | None = means(
        "Consistency of the stated deviations about the axes of the estimated frame, of a gripper one "
        "axis; absent where none are stated.",
        default=None,
    )
    step_us: Statistics = statistics(
        "Computing time of a step, gripper included; `null` in virtual time.", "p50 p99", default={}
    )


Methods = Mapping[str, AngleScores]
_NOTE: Final = "\u00b0: angle to the true orientation; in 95 %: share within 1.96 stated deviations"


@dataclass(frozen=True)
class WristTrack:
    """Errors of one hand's orientation methods by tick (T,) of its `HandTrack`, in the scenario's order.

    ``turn_rad`` (T, 3) are rotation vectors from estimate to truth in the body frame of the estimate, in rad;
    ``gripper_rad`` (T, 1) are errors of the gripper's angle. ``turn_std_rad`` and ``gripper_std_rad`` are the
    standard deviations that methods state. NaN for none. Empty for runs from before orientations were estimated.
    """

    turn_rad: dict[str, Array]
    gripper_rad: dict[str, Array]
    turn_std_rad: dict[str, Array]
    gripper_std_rad: dict[str, Array]


def wrist_track(logs: RunLogs, scenario: Scenario, track: HandTrack, hand: Hand) -> WristTrack:
    """Return the errors of one hand's orientation methods as far as its logs reach."""
    sample_ns, recorded, recorded_rad = _true_turn(logs, hand)
    truth = orientation_at(track.t_ns, sample_ns, recorded)
    truth_rad = np.full(len(track.t_ns), np.nan)
    if len(sample_ns):
        truth_rad = np.interp(track.t_ns, sample_ns, recorded_rad, left=np.nan, right=np.nan)
    # where the logs do not know the position's truth, the orientation's is not known either
    unknown = ~np.isfinite(track.truth_m).all(axis=1)
    truth[unknown], truth_rad[unknown] = np.nan, np.nan
    found = WristTrack({}, {}, {}, {})
    for name in methods_of(logs, scenario):
        rows = logs.of("patient", topic_of_method(name))
        ours = rows.where("hand", hand)
        ticks = rows.column("tick")[ours]

        def at(field: str, rows=rows, ours=ours, ticks=ticks) -> Array:  # type: ignore[no-untyped-def]
            return at_ticks(track.tick, ticks, rows.column(field)[ours])

        found.turn_rad[name] = error_vectors(at("orientation"), truth)
        found.gripper_rad[name] = (truth_rad - at("gripper_rad"))[:, None]
        found.turn_std_rad[name] = at("std_rad")
        found.gripper_std_rad[name] = at("gripper_std_rad")[:, None]
    return found


def topic_of_method(method: str) -> str:
    """Return the topic of a method's estimates in the patient's log."""
    return f"{ORIENTATIONS}/{method}"


def methods_of(logs: RunLogs, scenario: Scenario) -> list[str]:
    """Return the orientation methods in the patient's log, the scenario's first."""
    log, prefix = logs.sides.get("patient"), f"{ORIENTATIONS}/"
    topics = () if log is None else sorted(log.rows)
    logged = [topic.removeprefix(prefix) for topic in topics if topic.startswith(prefix)]
    requested = [name for name in scenario.patient.orientation.methods if name in logged]
    return requested + [name for name in logged if name not in requested]


def _true_turn(logs: RunLogs, hand: Hand) -> tuple[Ints, Array, Array]:
    """Return sample instants (N,), ascending, unit quaternions (N, 4) and gripper angles (N,) of the recorded arm."""
    rows = logs.of("surgeon", TRUTH)
    rotation_rad = rows.column("rotation_rad")
    known = rows.where("hand", hand) & np.isfinite(rotation_rad).all(axis=1)
    # a surgeon that came back logs the samples before its return again
    sample_ns, first = np.unique(rows.column("sample_ns")[known], return_index=True)
    if not len(sample_ns):
        return sample_ns, np.empty((0, 4)), np.empty(0)
    recorded = scipy.spatial.transform.Rotation.from_rotvec(rotation_rad[known][first]).as_quat()
    return sample_ns, recorded, rows.column("gripper_rad")[known][first]


def orientation_deg(logs: RunLogs, track: HandTrack, wrist: WristTrack, hand: Hand) -> dict[str, AngleScores]:
    """Return, by method, RMS, percentiles and ratio to hold of the geodesic distance, in degrees.

    They are over one hand's scored ticks; a missing estimate counts with hold's. ``nees`` is
    `tis.common.metrics.consistency` about the axes of the estimated frame, ``step_us`` the time of a step, the
    gripper's part included. Oracle: an arm that turns at constant speed, test_orientation_error.
    """
    scores = _scores(track, wrist.turn_rad, wrist.turn_std_rad, np.degrees(1.0))
    found = {}
    for name, one in scores.items():
        rows = logs.of("patient", topic_of_method(name))
        steps_us = step_times_us(rows.column("step_ns")[rows.where("hand", hand)])
        found[name] = one.model_copy(update={"step_us": steps_us})
    return found


def gripper_rad(track: HandTrack, wrist: WristTrack) -> dict[str, AngleScores]:
    """Return the same of the gripper's angle, in rad; lists of ``nees`` have one entry."""
    return _scores(track, wrist.gripper_rad, wrist.gripper_std_rad, 1.0)


def orientation_by_age(logs: RunLogs, track: HandTrack, wrist: WristTrack, hand: Hand) -> dict[str, TurnAgeBins]:
    """Return, by method, bins of the newest sample's age and their RMS error in degrees: see `error_by_age`."""
    age_ms, found = ages_at_ms(logs, hand, track.t_ns)[track.scored], {}
    for name, error_rad in wrist.turn_rad.items():
        bins = error_by_age(age_ms, angles_deg(error_rad)[track.scored])
        found[name] = TurnAgeBins(age_ms=bins.age_ms.tolist(), rms_deg=bins.rmse.tolist(), n=bins.n.tolist())
    return found


def _scores(
    track: HandTrack, errors: dict[str, Array], stds: dict[str, Array], unit: float
) -> dict[str, AngleScores]:
    """Return the scores by method of errors (T, d) and their stated deviations; ``unit`` is per rad."""
    held = errors.get("hold")
    if held is None:
        return {}
    scored: NDArray[np.bool_] = np.asarray(track.scored & np.isfinite(held).all(axis=1))
    reference = float(np.sum(held[scored] ** 2))
    found = {}
    for name, error in errors.items():
        missing = np.isnan(error.sum(axis=1))
        used = np.where(missing[:, None], held, error)[scored]
        sizes, squares = unit * np.linalg.norm(used, axis=1), float(np.sum(used**2))
        entry: dict[str, Any] = {
            "rms": float(np.sqrt(np.mean(sizes**2))) if len(sizes) else None,
            **summarise(sizes),
            "ratio_to_hold": float(np.sqrt(squares / reference)) if reference > 0 else None,
            "n_scored": int(np.count_nonzero(scored)),
            "n_missing": int(np.count_nonzero(missing & scored)),
        }
        if np.isfinite(stds[name][scored]).any():
            entry["nees"] = consistency(normalised_squares(error, stds[name])[scored])
        found[name] = AngleScores(**entry)
    return found


def orientation_table(turning: Methods, gripper: Methods, hand: str) -> Table:
    """Return one hand's methods beside hold for a terminal, without any row where none is scored."""
    columns = ("method", "RMS \u00b0", "% hold", "p95", "max", "in 95 %", "grip rad", "% hold")
    rows = [row[:-1] for row in _rows(turning, gripper)]
    return Table(f"Orientation and gripper at the tick ({hand} hand)", columns, rows, _NOTE)


def orientation_page_table(turning: Methods, gripper: Methods, which: str, active: str) -> Table:
    """Return the same for the page, with the time of a step."""
    columns = (
        "orientation", "RMS, \u00b0", "share of hold's, %", "p95, \u00b0", "max, \u00b0", "in the 95 % interval, %",
        "gripper RMS, rad", "share of hold's, %", "step, median, \u00b5s",
    )  # fmt: skip
    return Table(f"Orientation and gripper at the tick, {which}", columns, _rows(turning, gripper), marked=active)


def _rows(turning: Methods, gripper: Methods) -> list[tuple[Any, ...]]:
    """Return a row for each method; coverage is the mean over the axes of the estimated frame."""
    rows = []
    for name, entry in turning.items():
        if entry.rms is None:
            continue
        beside = gripper.get(name)
        covered = [share for share in (entry.nees.coverage_pct if entry.nees else ()) if share is not None]
        rows.append(
            (
                name,
                entry.rms,
                percent(entry.ratio_to_hold),
                entry.p95,
                entry.max,
                sum(covered) / len(covered) if covered else None,
                None if beside is None else beside.rms,
                NONE if beside is None else percent(beside.ratio_to_hold),
                entry.step_us.get("p50"),
            )
        )
    return rows
