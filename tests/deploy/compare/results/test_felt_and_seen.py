"""What is felt and seen in a comparison: as the summary of the same twin has it, and cells pooled by hand."""

from typing import Any

import pytest

from tests.deploy.compare.cells.test_cell import _summary
from tis.common.runtime.recordings import load_recording
from tis.deploy.compare.cells.scores import logged_scores
from tis.deploy.compare.cells.unlogged import is_plain
from tis.deploy.compare.results.felt_and_seen import felt_and_seen_row, felt_and_seen_table
from tis.deploy.run.resolve import resolve

pytest.importorskip("PIL", reason="the extra report is not installed")

_SEEN = {"n_frames": 10, "n_whole": 9, "n_freezes": 0, "frozen_ns": 0, "watched_ns": 1000}
_FELT = {"stability": "stable", "peak_force_n": 2.0, "energy_mj": 0.0}


def test_a_cell_has_the_figures_of_the_summary() -> None:
    settings = (
        "identification.train_samples=500", "estimators=[hold]", "active_estimator=hold",
        "sight.width=320", "sight.height=240", "network.feedback.loss.p_loss=0.05",
    )  # fmt: skip
    scenario = resolve("touch_and_sight", settings, None, 3.0)
    assert not is_plain(scenario)
    scores, (summary, _) = logged_scores(scenario, load_recording(scenario)), _summary(scenario)
    row = felt_and_seen_row({"setting": None}, [scores._asdict()])
    assert row is not None
    sight, touch = summary["sight"], summary["touch"]["left"]
    for name in ("p50", "p99"):
        assert row["hand_to_eye_ms"][name] == pytest.approx(sight["hand_to_eye_ms"][name], rel=2e-3)
    assert row["decodable_pct"] == sight["decodable_pct"] < 100.0
    assert (row["n_freezes"], row["freeze_pct"]) == (sight["freezes"], sight["freeze_pct"])
    assert (row["peak_force_n"], row["energy_mj"]) == (touch["peak_force_n"], touch["energy_mj"])
    assert row[f"n_{touch['stability']}"] == 1


def test_cells_are_pooled() -> None:
    late: dict[str, Any] = {**_SEEN, "n_whole": 3, "n_freezes": 2, "frozen_ns": 500, "hand_to_eye_ns": {"20000": 1}}
    cells: list[dict[str, Any]] = [
        {"seen": {**_SEEN, "hand_to_eye_ns": {"18000": 99}}, "felt": [_FELT]},
        {"seen": late, "felt": [{**_FELT, "stability": "unstable", "peak_force_n": 7.0, "energy_mj": 5.0}]},
        {"seen": None, "felt": []},
    ]
    row = felt_and_seen_row({"setting": "0.1"}, cells)
    assert row is not None
    (middle_ms,) = {row["hand_to_eye_ms"][name] for name in ("p50", "p99")}
    assert middle_ms == pytest.approx(1.001**18000.5 / 1e6, rel=1e-3)
    assert (row["decodable_pct"], row["freeze_pct"], row["n_freezes"]) == (60.0, 25.0, 2)
    assert (row["n_stable"], row["n_unstable"], row["peak_force_n"], row["energy_mj"]) == (1, 1, 7.0, 5.0)
    assert next(iter(felt_and_seen_table([row]).texts()))[-3:] == ["1 of 2", "7.00", "5.00"]
    assert felt_and_seen_row({}, [{"seen": None, "felt": []}]) is None


def test_what_no_setting_has_is_no_column() -> None:
    row = felt_and_seen_row({"setting": None}, [{"seen": None, "felt": [_FELT]}])
    assert row is not None
    assert [column.head for column in felt_and_seen_table([row]).full_columns()] == ["setting", "stable", "N", "mJ"]
