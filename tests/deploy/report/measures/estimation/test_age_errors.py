from pathlib import Path

import pytest

from deploy.report.measures.estimation.age_errors import errors_by_age
from deploy.report.measures.estimation.tracking import track_of_hand
from tests.deploy.report.hand_made import COMMAND, a_scenario, estimate, fresh, message, tick, truth, write_run


def test_the_error_of_each_age_is_that_of_its_ticks(tmp_path: Path) -> None:
    """Ticks each 100 ms from 2.1 s on; every other one finds a sample 40 ms old, so ages are 40 and 140 ms."""
    n = 40
    due = [2100 + 100 * k for k in range(n)]
    errors_mm = [1.0 if k % 2 == 0 else 3.0 for k in range(n)]
    logs = write_run(
        tmp_path,
        surgeon=[truth(k, 100 * k, (0, 0, 0)) for k in range(70)],
        patient=[
            message(COMMAND, 0, 0, log_ms=50),
            *(tick(k, ms, ms) for k, ms in enumerate(due)),
            *(fresh(k, k, due[k] - 40) for k in range(0, n, 2)),
            *(estimate(k, due[k], "hold", (0, errors_mm[k] / 1000, 0)) for k in range(n)),
            *(estimate(k, due[k], "moesp_kf", None) for k in range(n)),
        ],
    )
    found = errors_by_age(logs, track_of_hand(logs, a_scenario(), "left"), "left")
    assert found["hold"]["age_ms"] == pytest.approx([40, 140])
    assert found["hold"]["rmse_3d_mm"] == pytest.approx([1, 3])
    assert found["hold"]["n"] == [20, 20]
    assert found["moesp_kf"]["n"] == []
