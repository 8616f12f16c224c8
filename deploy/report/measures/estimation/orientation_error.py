"""The summary's ``orientation_deg`` and ``gripper_rad``: errors of the orientation methods, beside hold's."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from tis.common.channels import Hand
from tis.common.metrics.consistency import consistency, normalised_squares
from tis.common.metrics.percentiles import summarise
from tis.common.metrics.tracking import angles_deg
from tis.common.units import NS_PER_US
from tis.deploy.logs.read.load import RunLogs
from tis.deploy.logs.read.note_columns import notes
from tis.deploy.report.measures.estimation.error_by_age import error_by_age
from tis.deploy.report.measures.estimation.tracking import Array, HandTrack
from tis.deploy.report.measures.estimation.wrist_track import WristTrack, topic_of
from tis.deploy.report.measures.latency import ages_at_ms


def orientation_deg(logs: RunLogs, track: HandTrack, wrist: WristTrack, hand: Hand) -> dict[str, Any]:
    """Return, by method, RMS, percentiles and ratio to hold of the geodesic distance, in degrees.

    They are over one hand's scored ticks; a missing estimate counts with hold's. ``nees`` is
    `tis.common.metrics.consistency` about the axes of the estimated frame, ``step_us`` the time of a step, the
    gripper's part included. Oracle: an arm that turns at constant speed, test_orientation_error.
    """
    scores = _scores(track, wrist.turn_rad, wrist.turn_std_rad, np.degrees(1.0))
    return {name: {**entry, "step_us": _step_us(logs, name, hand)} for name, entry in scores.items()}


def gripper_rad(track: HandTrack, wrist: WristTrack) -> dict[str, Any]:
    """Return the same of the gripper's angle, in rad; lists of ``nees`` have one entry."""
    return _scores(track, wrist.gripper_rad, wrist.gripper_std_rad, 1.0)


def orientation_by_age(logs: RunLogs, track: HandTrack, wrist: WristTrack, hand: Hand) -> dict[str, Any]:
    """Return, by method, bins of the newest sample's age and their RMS error in degrees: see `error_by_age`."""
    age_ms, found = ages_at_ms(logs, hand, track.t_ns)[track.scored], {}
    for name, error_rad in wrist.turn_rad.items():
        bins = error_by_age(age_ms, angles_deg(error_rad)[track.scored])
        found[name] = {"age_ms": bins.age_ms.tolist(), "rms_deg": bins.rmse.tolist(), "n": bins.n.tolist()}
    return found


def _scores(track: HandTrack, errors: dict[str, Array], stds: dict[str, Array], unit: float) -> dict[str, Any]:
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
        found[name] = entry
    return found


def _step_us(logs: RunLogs, method: str, hand: Hand) -> dict[str, float | None]:
    rows = notes(logs, "patient", topic_of(method))
    steps_ns = rows.column("step_ns")[rows.where("hand", hand)]
    # virtual time logs 0 for every step: no measurement
    measured = steps_ns if steps_ns.any() else steps_ns[:0]
    return summarise(measured / NS_PER_US, percentiles=(50, 99), also=())
