"""What there is to draw of a hand, from logs written by hand."""

from pathlib import Path

import numpy as np
import pytest

from tests.deploy.report.hand_made import COMMAND, a_scenario, estimate, fresh, message, tick, truth, write_run
from tis.common.channels import FOLLOWER
from tis.deploy.report.measured_run import MeasuredRun
from tis.deploy.report.run_view import MAX_TICKS, hand_view


def test_errors_are_distances_and_ages_are_those_of_the_ticks(tmp_path: Path) -> None:
    """The arm stands at (0, 0, 0); hold says (3, 4, 0) mm. Tick 0 has a sample of 0 ms, tick 1 no newer one."""
    logs = write_run(
        tmp_path,
        surgeon=[truth(k, 100 * k, (0, 0, 0)) for k in range(3)],
        patient=[
            message(COMMAND, 0, 0.5, log_ms=11),
            tick(0, 15, 15.1),
            tick(1, 48, 48.1),
            fresh(0, 0, 0),
            estimate(0, 15, "hold", (0.003, 0.004, 0)),
            estimate(1, 48, "hold", (0.003, 0.004, 0)),
            estimate(2, 81, "hold", None),
        ],
    )
    view = hand_view(MeasuredRun(logs, a_scenario(), FOLLOWER), "left", "left hand")
    assert view.errors_mm["hold"] == pytest.approx([5, 5, np.nan], nan_ok=True)
    assert view.age_ms == pytest.approx([15, 48, np.nan], nan_ok=True)
    data = view.source.data
    assert data["hold x"] == pytest.approx([3, 3, np.nan], nan_ok=True)
    assert data["hold error"] == pytest.approx([5, 5, np.nan], nan_ok=True)
    assert data["t"] == pytest.approx([0.015, 0.048, 0.081])
    assert view.source is view.source
    assert view.thinning_note() == ""


def test_a_long_run_is_thinned_and_keeps_its_worst_tick(tmp_path: Path) -> None:
    n, peak = 2 * MAX_TICKS + 1, 4321
    patient = [message(COMMAND, 0, 0.5, log_ms=11)]
    patient += [estimate(k, k, "hold", (0.009 if k == peak else 0.001, 0, 0)) for k in range(n)]
    # another one errs more beside it
    patient += [estimate(k, k, "moesp_kf", (0.02 if k == peak + 1 else 0.001, 0, 0)) for k in range(n)]
    logs = write_run(tmp_path, surgeon=[truth(0, 0, (0, 0, 0)), truth(1, n, (0, 0, 0))], patient=patient)
    view = hand_view(MeasuredRun(logs, a_scenario(), FOLLOWER), "left", "left hand")
    assert {peak, peak + 1} <= set(view.kept.tolist())
    assert len(view.kept) <= MAX_TICKS
    assert view.thinning_note() == f" Of {n} ticks {len(view.kept)} are drawn, the worst of each stretch among them."
