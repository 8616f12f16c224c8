"""The summary's ``error_by_age``: how each estimator's error grows with the age of the newest sample."""

from typing import Any

import numpy as np

from common.channels import Hand
from common.units import MM_PER_M, NS_PER_MS
from deploy.logs.read.load import RunLogs
from deploy.logs.read.note_columns import place_in
from deploy.report.measures.estimation.error_by_age import error_by_age
from deploy.report.measures.estimation.tracking import HandTrack
from deploy.report.measures.latency import ages_of_hand


def errors_by_age(logs: RunLogs, track: HandTrack, hand: Hand) -> dict[str, Any]:
    """Return for each estimator of one hand ages in ms, the RMSE in mm (3D) at them and how many scored ticks.

    Bins are `deploy.report.measures.estimation.error_by_age`'s, ticks without an estimate are left out. Oracle:
    test_age_errors.
    """
    at_ns, age_ns = ages_of_hand(logs, hand)
    place, known = place_in(at_ns, track.t_ns)
    age_ms = np.full(len(track.t_ns), np.nan)
    age_ms[known] = age_ns[place[known]] / NS_PER_MS
    found = {}
    for name, estimate_m in track.estimates.items():
        error_mm = MM_PER_M * np.linalg.norm(estimate_m - track.truth_m, axis=1)
        bins = error_by_age(age_ms[track.scored], error_mm[track.scored])
        found[name] = {"age_ms": bins.age_ms.tolist(), "rmse_3d_mm": bins.rmse.tolist(), "n": bins.n.tolist()}
    return found
