"""A cell against the ordinary twin of the same scenario: other code for the training, the logs and the scores."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tis.common.channels import Side
from tis.common.scenario import Scenario
from tis.deploy.compare.cells import cell as cell_module
from tis.deploy.compare.cells.cell import Training, run_cell, train, with_models
from tis.deploy.compare.cells.measured import MeasuredEstimator
from tis.deploy.compare.cells.sums import percentile
from tis.deploy.compare.plan import Request, make_plan
from tis.deploy.compare.results.pooled import pooled
from tis.deploy.logs.read.load import RunLogs
from tis.deploy.logs.read.side_log import MemoryLog
from tis.deploy.report.subjects.age import ages_ns
from tis.deploy.report.summarise import build_summary
from tis.deploy.run.twin import build_sides, drive
from tis.patient_side.build import identify_models
from tis.patient_side.estimators.simple import Hold
from tis.patient_side.playout import Playout


def trained(job: Training, model_file: Path) -> dict[str, Any]:
    """Write the models of a training, and return what is known of it."""
    about, models = train(job)
    model_file.write_bytes(models)
    return about


def _summary(scenario: Scenario) -> tuple[dict[str, Any], RunLogs]:
    nodes, models, _ = build_sides(scenario)
    memories: dict[Side, MemoryLog] = {side: MemoryLog(side) for side in nodes}
    drive(scenario, nodes, memories)
    logs = RunLogs(Path(), {side: memory.log for side, memory in memories.items()})
    return build_summary(logs, scenario, models, "twin", 0, ""), logs


@pytest.mark.parametrize("training", ["others", "own_head"])
def test_a_cell_scores_as_the_twin_of_its_scenario_does(small: Path, tmp_path: Path, training: str) -> None:
    lossy = "network.forward.loss={kind: bernoulli, p_loss: 0.1}"
    both = "source.hands=[left, right]"
    request = Request(str(small), (f"identification.train={training}", lossy, both), trials=("T002",))
    plan = make_plan(request)
    (cell,), (job,) = plan.cells, plan.trainings.values()
    model_file = tmp_path / "model.json"
    about = trained(job, model_file)
    assert about["n_rows"] == (500 if training == "others" else 240)
    assert set(about["train_s"]) == set(cell.scenario.estimators)
    result = run_cell(cell, model_file)

    summary, logs = _summary(cell.scenario)
    for hand, scores in summary["accuracy_by_hand"].items():
        for name, exact in scores.items():
            found = pooled([[result["hands"][hand]]], name)
            for figure in ("r2_pct", "rmse_mm", "rmse_3d_mm", "rmse_normalized", "ratio_to_hold", "n_scored"):
                assert found[figure] == pytest.approx(exact[figure], rel=1e-9), (hand, name, figure)
    sent = summary["surgeon_traffic"].values()
    assert result["traffic"]["sent_packets"] == sum(key["packets"] for key in sent)
    assert result["traffic"]["sent_bytes"] == sum(key["bytes"] for key in sent)
    n_scored = result["hands"]["left"]["n_scored"]
    ages = np.concatenate([part[-n_scored:] for part in np.split(ages_ns(logs), 2)])
    assert sum(hand["age_sum_ns"] for hand in result["hands"].values()) == ages.sum()
    for hand in result["hands"].values():
        assert sum(hand["n_by_age"]) == n_scored
        assert sum(hand["age_sum_by_age_ns"]) == hand["age_sum_ns"]
        for entry in hand["estimators"].values():
            assert sum(entry["sse_by_age_m2"]) == pytest.approx(sum(entry["sse_m2"]), rel=1e-9)
            # the bins of the errors are 1 % wide, their squares 2 %
            squares = (n * (1e-9 * 1.01 ** (int(number) + 0.5)) ** 2 for number, n in entry["error_nm"].items())
            assert sum(squares) == pytest.approx(sum(entry["sse_m2"]), rel=0.02)
            assert sum(entry["error_nm"].values()) == n_scored
    damped = result["hands"]["left"]["estimators"]["damped_velocity"]
    assert 0 < damped["n_covered"] <= damped["n_ellipsoids"] <= n_scored
    assert (percentile(damped["step_ns"], 50) or 0) > 0
    assert result["hands"]["left"]["estimators"]["hold"]["n_ellipsoids"] == 0


@pytest.mark.usefixtures("models_anew")
def test_models_are_identified_once_with_the_time_of_each(
    small: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls = []

    def counted(*args: Any) -> Any:
        calls.append(args)
        return identify_models(*args)

    monkeypatch.setattr(cell_module, "identify_models", counted)
    (job,) = make_plan(
        Request(str(small), estimators=("hold", "arx_kf", "tis.patient_side.estimators:direct_ls"), trials=("T002",))
    ).trainings.values()
    times_s = trained(job, tmp_path / "model.json")["train_s"]
    assert job.timed
    assert len(calls) == 1
    assert 0 < times_s["hold"] < min(times_s["arx_kf"], times_s["tis.patient_side.estimators:direct_ls"])


def test_a_cell_is_equal_from_run_to_run_but_for_its_times(small: Path, tmp_path: Path) -> None:
    plan = make_plan(Request(str(small), trials=("S001",), duration_s=6.0))
    (cell,), (job,) = plan.cells, plan.trainings.values()
    trained(job, tmp_path / "model.json")
    runs = [run_cell(cell, tmp_path / "model.json") for _ in range(2)]
    for run in runs:
        for entry in run["hands"]["left"]["estimators"].values():
            del entry["step_ns"]
        for entry in run["hands"]["left"]["orientation"].values():
            del entry["step_ns"]
    assert runs[0] == runs[1]


def test_answers_at_arrivals_are_left_out_and_change_no_score(small: Path, tmp_path: Path) -> None:
    found = []
    for mode in ("free", "on_arrival"):
        plan = make_plan(Request(str(small), (f"patient.tick={mode}",), trials=("T002",)))
        (cell,), (job,) = plan.cells, plan.trainings.values()
        trained(job, tmp_path / "model.json")
        found.append(run_cell(cell, tmp_path / "model.json")["hands"]["left"])
    for name, entry in found[0]["estimators"].items():
        for sums in ("sse_m2", "n_missing", "n_covered", "n_ellipsoids"):
            assert found[1]["estimators"][name][sums] == entry[sums], (name, sums)


def test_the_file_of_models_decides_pairing_and_start_as_the_training_did(small: Path, tmp_path: Path) -> None:
    plan = make_plan(Request(str(small), ("identification.train=own_head",), trials=("S001",)))
    (cell,), (job,) = plan.cells, plan.trainings.values()
    trained(job, tmp_path / "model.json")
    scenario = with_models(cell.scenario, tmp_path / "model.json")
    assert scenario.source.kind == "jigsaws"
    assert (scenario.source.start, scenario.source.pairing) == (240, "cross")
    assert scenario.identification.train == str(tmp_path / "model.json")


def test_an_estimator_that_fails_is_named() -> None:
    class Broken(Hold):
        def step(self, state: None, playout: Playout, now_ns: int) -> Any:
            raise ZeroDivisionError("by nothing")

    with pytest.raises(RuntimeError, match=r"hold at 1\.500 s: ZeroDivisionError: by nothing"):
        MeasuredEstimator(Broken()).step(None, Playout(30), 1_500_000_000)
