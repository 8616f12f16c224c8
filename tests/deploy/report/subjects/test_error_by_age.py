"""Error against age: tables worked by hand."""

from pathlib import Path

import numpy as np
import pytest

from tests.deploy.report.hand_made import COMMAND, a_scenario, estimate, fresh, message, tick, truth, write_run
from tis.deploy.report.subjects.tracking import MAX_BINS, MIN_TICKS, error_by_age, errors_by_age, track_of_hand


def test_each_age_has_the_rmse_of_its_ticks() -> None:
    age_ms = np.repeat([35.0, 68.0], 10)
    error = np.concatenate([np.tile([3.0, 4.0], 5), np.full(10, 2.0)])
    found = error_by_age(age_ms, error)
    assert found.age_ms == pytest.approx([35, 68])
    assert found.rmse == pytest.approx([np.sqrt(12.5), 2])
    assert found.n.tolist() == [10, 10]


def test_what_is_not_known_and_what_is_rare_is_left_out() -> None:
    age_ms = np.concatenate([np.full(12, 35.0), np.full(MIN_TICKS - 1, 68.0)])
    error = np.ones(len(age_ms))
    error[0], age_ms[1] = np.nan, np.nan
    found = error_by_age(age_ms, error)
    assert found.age_ms.tolist() == [35]
    assert found.n.tolist() == [10]


def test_many_ages_share_bins_of_equally_many_ticks() -> None:
    age_ms = np.arange(1400) / 10
    found = error_by_age(age_ms, age_ms)
    assert len(found.n) == MAX_BINS
    assert found.n.tolist() == [100] * MAX_BINS
    for k, (age, rmse) in enumerate(zip(found.age_ms, found.rmse, strict=True)):
        ticks = age_ms[100 * k : 100 * k + 100]
        assert age == pytest.approx(ticks.mean())
        assert rmse == pytest.approx(np.sqrt((ticks**2).mean()))


def test_rare_ages_stand_together_until_there_are_enough() -> None:
    """An outage: after many ticks of one age, each tick finds the newest sample a tick older."""
    age_ms = np.concatenate([np.full(50, 35.0), 35 + 33 * np.arange(1, 26)])
    found = error_by_age(age_ms, age_ms)
    assert found.n.tolist() == [50, 10, 10]
    assert found.age_ms == pytest.approx([35, 35 + 33 * 5.5, 35 + 33 * 15.5])


def test_of_nothing_there_is_nothing() -> None:
    found = error_by_age(np.empty(0), np.empty(0))
    assert [len(column) for column in found] == [0, 0, 0]
    assert len(error_by_age(np.full(30, np.nan), np.ones(30)).n) == 0


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
