"""Figures of persons: from the sums of cells against the summary of the same twin with logs, and by names."""

import math
from pathlib import Path

import pytest

from tis.deploy.compare.cells.cell import Cell, run_cell, train
from tis.deploy.compare.cells.identity import summarised
from tis.deploy.compare.plan import Request, make_plan
from tis.deploy.studies.admissible.criterion import ESTIMATOR, OF_CELLS, Limit, name_faults, of_cells, of_summaries

LOSSY = "network={forward: {delay: {kind: constant, delay_ms: 60}, loss: {kind: bernoulli, p_loss: 0.2}}}"
SHORT = ("identification={train_samples: 240, block_rows: 4, order: 0}", "estimators=[hold, damped_velocity]")


@pytest.fixture(scope="module")
def twin(tmp_path_factory: pytest.TempPathFactory) -> tuple[Cell, Path]:
    request = Request("default", (*SHORT, "active_estimator=damped_velocity", LOSSY), n_seeds=1, duration_s=4.0)
    plan = make_plan(request)
    (cell,), (job,) = plan.cells, plan.trainings.values()
    file = tmp_path_factory.mktemp("models") / "model.json"
    _, models = train(job)
    file.write_bytes(models)
    return cell, file


def test_figures_of_a_cell_are_those_of_the_summary(twin: tuple[Cell, Path]) -> None:
    cell, models = twin
    result, summary = run_cell(cell, models), run_cell(summarised(cell), models)["summary"]
    for name, key in (
        ("rmse_3d_mm", "accuracy.ESTIMATOR.rmse_3d_mm"),
        ("rmse_mm_y", "accuracy.ESTIMATOR.rmse_mm.1"),
        ("r2_pct_z", "accuracy.ESTIMATOR.r2_pct.2"),
        ("ratio_to_hold", "accuracy.ESTIMATOR.ratio_to_hold"),
    ):
        for estimator in ("hold", "damped_velocity"):
            expected = of_summaries(Limit(key, True, 1.0), [summary], estimator)
            assert of_cells(name, [result], estimator) == pytest.approx(expected, rel=1e-9)
    ages = [of_cells(name, [result], "hold") for name in ("age_p50_ms", "age_mean_ms", "age_p99_ms")]
    assert all(60 < age < 200 for age in ages)
    assert ages[0] <= ages[2]
    assert ages[0] == pytest.approx(summary["age_ms.p50"], abs=5)
    assert of_cells("missing_pct", [result], "hold") == 0
    assert summary["links.forward.loss_pct"] == pytest.approx(20, abs=8)
    assert name_faults([Limit(key, True, 1.0) for key in summary], summary, ("hold",)) == []


def test_twins_pool_by_their_sums_and_one_without_a_score_is_unknown(twin: tuple[Cell, Path]) -> None:
    result = run_cell(*twin)
    for name in OF_CELLS:
        alone = of_cells(name, [result], "damped_velocity")
        assert of_cells(name, [result, result], "damped_velocity") == pytest.approx(alone)
    assert math.isnan(of_cells("rmse_3d_mm", [result, {**result, "unscored": "nothing arrived"}], "hold"))


def test_summaries_pool_errors_by_squares_and_others_by_means() -> None:
    summaries = [{"a.hold.rmse_mm": 3.0, "loss_pct": 1.0}, {"a.hold.rmse_mm": 4.0, "loss_pct": 2.0}]
    assert of_summaries(Limit(f"a.{ESTIMATOR}.rmse_mm", True, 1.0), summaries, "hold") == pytest.approx(12.5**0.5)
    assert of_summaries(Limit("loss_pct", True, 1.0), summaries, "hold") == 1.5
    assert math.isnan(of_summaries(Limit("loss_pct", True, 1.0), [*summaries, {"loss_pct": None}], "hold"))


def test_unknown_names_get_near_ones() -> None:
    keys = ["accuracy.hold.rmse_3d_mm", "links.forward.loss_pct"]
    (fault,) = name_faults([Limit("rmse3d", True, 1.0)], keys, ("hold",))
    assert "did you mean rmse_3d_mm" in str(fault)
    (fault,) = name_faults([Limit("loss_pct", True, 1.0)], keys, ("hold",))
    assert "links.forward.loss_pct" in str(fault)
    (fault,) = name_faults([Limit("zzz", True, 1.0)], keys, ("hold",))
    assert "there are rmse_3d_mm" in str(fault)
    assert name_faults([Limit("accuracy.ESTIMATOR.rmse_3d_mm", True, 1.0)], keys, ("hold",)) == []
