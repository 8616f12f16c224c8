"""Orientation and gripper: errors of the orientation methods on the ticks of a hand's track, beside hold's."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import scipy
from numpy.typing import NDArray

from tis.common.channels import Hand
from tis.common.metrics.consistency import consistency, normalised_squares, region_pct
from tis.common.metrics.percentiles import summarise
from tis.common.metrics.tracking import angles_deg, error_vectors, moves, orientation_at
from tis.common.records import ORIENTATIONS, TRUTH
from tis.common.scenario import Scenario
from tis.deploy.logs.read.columns import Ints
from tis.deploy.logs.read.load import RunLogs
from tis.deploy.present.numbers import NONE, percent
from tis.deploy.present.table import Column, Table
from tis.deploy.report.section import Section, Statistics, means, statistics
from tis.deploy.report.subjects.accuracy import Consistency, step_times_us
from tis.deploy.report.subjects.tracking import Array, HandTrack, TurnAgeBins, at_ticks, logged_names, scored_by_age


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
    region_pct: float | None = means(
        "Errors within the 95 % region of the stated deviations, as in a comparison; 95 for a consistent method.",
        default=None,
    )
    step_us: Statistics = statistics(
        "Computing time of a step, gripper included; `null` in virtual time.", "p50 p99", default={}
    )


Methods = Mapping[str, AngleScores]
_NOTE: Final = "\u00b0: angle to the true orientation"
_REGION_NOTE: Final = "; in 95 %: share within the stated 95 % region"


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

    @property
    def turns_deg(self) -> dict[str, Array]:
        """Return each method's angle to the truth (T,) in degrees, NaN for none."""
        return {name: angles_deg(error_rad) for name, error_rad in self.turn_rad.items()}


def wrist_track(logs: RunLogs, scenario: Scenario, track: HandTrack, hand: Hand) -> WristTrack:
    """Return the errors of one hand's orientation methods as far as its logs reach.

    An orientation or a gripper that never moves is taken for one that the recording lacks: there is no truth.
    """
    sample_ns, recorded, recorded_rad = _true_turn(logs, hand)
    truth = orientation_at(track.t_ns, sample_ns, recorded)
    truth_rad = np.full(len(track.t_ns), np.nan)
    if len(sample_ns):
        truth_rad = np.interp(track.t_ns, sample_ns, recorded_rad, left=np.nan, right=np.nan)
    # where the logs do not know the position's truth, the orientation's is not known either
    unknown = ~np.isfinite(track.truth_m).all(axis=1)
    truth[unknown | (not moves(recorded))] = np.nan
    truth_rad[unknown | (not moves(recorded_rad))] = np.nan
    found = WristTrack({}, {}, {}, {})
    for name in logged_names(logs, ORIENTATIONS, scenario.patient.orientation.methods):
        rows, ticks = logs.of_hand("patient", f"{ORIENTATIONS}/{name}", hand), track.tick
        found.turn_rad[name] = error_vectors(at_ticks(ticks, rows, "orientation"), truth)
        found.gripper_rad[name] = (truth_rad - at_ticks(ticks, rows, "gripper_rad"))[:, None]
        found.turn_std_rad[name] = at_ticks(ticks, rows, "std_rad")
        found.gripper_std_rad[name] = at_ticks(ticks, rows, "gripper_std_rad")[:, None]
    return found


def _true_turn(logs: RunLogs, hand: Hand) -> tuple[Ints, Array, Array]:
    """Return sample instants (N,), ascending, unit quaternions (N, 4) and gripper angles (N,) of the recorded arm."""
    rows = logs.of_hand("surgeon", TRUTH, hand)
    # a surgeon that came back logs the samples before its return again
    rows = rows.at(np.isfinite(rows.rotation_rad).all(axis=1)).first_of_each("sample_ns")
    if not len(rows):
        return rows.sample_ns, np.empty((0, 4)), np.empty(0)
    recorded = scipy.spatial.transform.Rotation.from_rotvec(rows.rotation_rad).as_quat()
    return rows.sample_ns, recorded, rows.gripper_rad


def orientation_deg(logs: RunLogs, track: HandTrack, wrist: WristTrack, hand: Hand) -> dict[str, AngleScores]:
    """Return, by method, RMS, percentiles and ratio to hold of the geodesic distance, in degrees.

    They are over one hand's scored ticks; a missing estimate counts with hold's. ``nees`` is
    `tis.common.metrics.consistency` about the axes of the estimated frame, ``step_us`` the time of a step, the
    gripper's part included. Oracle: an arm that turns at constant speed, test_orientation_error.
    """
    scores = _scores(track, wrist.turn_rad, wrist.turn_std_rad, np.degrees(1.0))
    found = {}
    for name, one in scores.items():
        steps_ns = logs.of_hand("patient", f"{ORIENTATIONS}/{name}", hand).step_ns
        found[name] = one.model_copy(update={"step_us": step_times_us(steps_ns)})
    return found


def gripper_rad(track: HandTrack, wrist: WristTrack) -> dict[str, AngleScores]:
    """Return the same of the gripper's angle, in rad; lists of ``nees`` have one entry."""
    return _scores(track, wrist.gripper_rad, wrist.gripper_std_rad, 1.0)


def orientation_by_age(logs: RunLogs, track: HandTrack, wrist: WristTrack, hand: Hand) -> dict[str, TurnAgeBins]:
    """Return, by method, bins of the newest sample's age and their RMS error in degrees: see `error_by_age`."""
    found = scored_by_age(logs, track, hand, wrist.turns_deg)
    return {
        name: TurnAgeBins(age_ms=bins.age_ms.tolist(), rms_deg=bins.rmse.tolist(), n=bins.n.tolist())
        for name, bins in found.items()
    }


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
            normalised = normalised_squares(error, stds[name])[scored]
            entry |= {"nees": consistency(normalised), "region_pct": region_pct(normalised)}
        found[name] = AngleScores(**entry)
    return found


def orientation_table(turning: Methods, gripper: Methods, which: str, active: str) -> Table:
    """Return a row for each method that is scored, with the share of errors in their regions."""
    rows: list[tuple[Any, ...]] = []
    for name, entry in turning.items():
        beside = gripper.get(name)
        if entry.rms is None and (beside is None or beside.rms is None):
            continue
        rows.append(
            (
                name,
                entry.rms,
                percent(entry.ratio_to_hold),
                entry.p95,
                entry.max,
                entry.region_pct,
                None if beside is None else beside.rms,
                NONE if beside is None else percent(beside.ratio_to_hold),
                entry.step_us.get("p50"),
            )
        )
    columns: tuple[str | Column, ...] = (
        "orientation", "RMS, \u00b0", Column("share of hold's", "%", short="% hold"),
        Column("p95", "\u00b0", short="p95"), Column("max", "\u00b0", short="max"),
        Column("in the 95 % region", "%", short="in 95 %"), Column("gripper RMS", "rad", short="grip rad"),
        Column("share of hold's", "%", short="% hold"), Column("step, median", "\u00b5s", on_page_only=True),
    )  # fmt: skip
    # in virtual time no step takes any, and a recording may lack one of the two
    some = [k for k in range(len(columns)) if not rows or any(row[k] not in (None, NONE) for row in rows)]
    columns, rows = tuple(columns[k] for k in some), [tuple(row[k] for k in some) for row in rows]
    note = _NOTE + _REGION_NOTE * any(entry.region_pct is not None for entry in turning.values())
    return Table(f"Orientation and gripper at the tick, {which}", columns, rows, note, active)
