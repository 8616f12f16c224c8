"""The summary's ``orientation_deg``: how far the orientation of the answers is from the recorded arm's."""

import numpy as np
from scipy.spatial.transform import Rotation

from common.channels import Hand
from common.metrics.orientation import geodesic_deg, orientation_at
from common.metrics.percentiles import Summary, summarise
from common.metrics.tick_phase import Arrivals
from common.records import TRUTH
from common.scenario import Scenario
from deploy.report.load import RunLogs
from deploy.report.note_columns import notes
from deploy.report.tracking import HandTrack
from patient_side.statespace import ArmModel


def orientation_deg(logs: RunLogs, scenario: Scenario, track: HandTrack, model: ArmModel) -> Summary:
    """Return the geodesic distances over the scored ticks, ``rms`` and percentiles, of one hand's answers.

    No estimator turns the arm: answers carry the orientation of the arm's newest sample, whichever estimator is
    active. Which one that was at a tick follows from the arrivals, its orientation from the surgeon's record. Oracle:
    an arm that turns at constant speed, test_held_orientation.
    """
    error_deg = _errors_deg(logs, scenario, track, model.hand, f"{scenario.session}/{model.arm}/setpoint_cp")
    rms = float(np.sqrt(np.mean(error_deg**2))) if len(error_deg) else None
    return {"rms": rms, **summarise(error_deg)}


def _errors_deg(logs: RunLogs, scenario: Scenario, track: HandTrack, hand: Hand, key: str) -> np.ndarray:
    arrived = logs.messages("patient", "forward", scenario.session).get(key)
    rows = notes(logs, "surgeon", TRUTH)
    rotation_rad = rows.column("rotation_rad")
    known = rows.where("hand", hand) & np.isfinite(rotation_rad).all(axis=1)
    sample_ns, first = np.unique(rows.column("sample_ns")[known], return_index=True)
    if arrived is None or not len(sample_ns):
        return np.empty(0)
    recorded = Rotation.from_rotvec(rotation_rad[known][first]).as_quat()
    fresh = Arrivals.of(arrived.log_ns, arrived.sample_ns)
    t_ns = track.t_ns[track.scored]
    newest = np.searchsorted(fresh.recv_ns, t_ns, side="right") - 1
    t_ns, held_ns = t_ns[newest >= 0], fresh.sample_ns[newest[newest >= 0]]
    truth, held = (orientation_at(ns, sample_ns, recorded) for ns in (t_ns, held_ns))
    both = np.isfinite(truth).all(axis=1) & np.isfinite(held).all(axis=1)
    return geodesic_deg(held[both], truth[both])
