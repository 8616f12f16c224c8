"""Figures of a method from results of twins and trainings that are written by hand."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from tis.deploy.compare.cells.sums import AGE_EDGES_MS, ERROR_WIDTH, histogram
from tis.deploy.compare.engine.compute import Outcome
from tis.deploy.studies.methods.computing import Computed
from tis.deploy.studies.methods.figures import figures_of
from tis.deploy.studies.methods.plans import ALL, Subject, plans_of
from tis.deploy.studies.methods.steps import Play, Stepped
from tis.deploy.studies.methods.trials import QUICK, Trials

METHOD = "arx_kf"
EXTENT = replace(QUICK, n_people=None, n_training_trials=(1, 3))


def result(trial: str, error_m: float, hold_m: float, n: int = 100) -> dict[str, Any]:
    """Return a twin's result: the same error at each of ``n`` ticks, all of it along x."""

    def entry(size_m: float, **more: Any) -> dict[str, Any]:
        return {
            "sse_m2": [n * size_m**2, 0.0, 0.0],
            "n_missing": 0,
            "sse_by_age_m2": [n * size_m**2] + [0.0] * (len(AGE_EDGES_MS) - 1),
            "error_nm": histogram(np.full(n, round(1e9 * size_m)), ERROR_WIDTH),
            **more,
        }

    own = entry(error_m, n_missing=7, n_covered=90, n_ellipsoids=n, step_ns={}, trained=True)
    hand = {
        "n_scored": n,
        "sst_m2": [1.0, 1.0, 1.0],
        "range_m": [0.1, 0.1, 0.1],
        "n_by_age": [n] + [0] * (len(AGE_EDGES_MS) - 1),
        "age_sum_by_age_ns": [0] * len(AGE_EDGES_MS),
        "age_sum_ns": 0,
        "age_ns": {},
        "orientation": {},
        "estimators": {"hold": entry(hold_m), METHOD: own},
    }
    return {
        "trial": trial,
        "seed": 7,
        "duration_s": 10.0,
        "traffic": {"sent_packets": 1, "sent_bytes": 1},
        "hands": {"left": hand},
        "unscored": None,
        "warnings": [],
        "own_faults": {},
    }


@pytest.fixture(scope="module")
def computed(people: Trials) -> Computed:
    """Return results in which the error is 2 mm without disturbance, 3 with any, 4 after one training trial."""
    subject = Subject(METHOD, people, EXTENT, 7)
    plans = plans_of(subject)
    outcome = Outcome()
    for measure, plan in plans.items():
        for digest, training in plan.trainings.items():
            n_trials = 4 if training.trials is None else len(training.trials)
            about = {"n_rows": 300 * n_trials, "process_s": 0.5 * n_trials, "warnings": [], "train_s": {}}
            outcome.trainings[digest] = about
        for cell in plan.cells:
            loss = cell.scenario.network.forward.loss
            lossy = loss is not None and loss.kind == "burst" and measure == "loss"
            disturbed = lossy or cell.scenario.surgeon.sensor_noise_mm > 0.01  # that of the fast hand
            few = measure == "data" and cell.setting == "1"
            elsewhere = measure == "adaptability" and cell.setting != "own person"
            error_m = 0.003 if disturbed or elsewhere else 0.004 if few else 0.002
            outcome.cells[cell.digest] = result(cell.trial, error_m, 0.01)
    return Computed(subject, plans, outcome, ())


def play(p50_us: float) -> Play:
    return Play(p50_us, 2 * p50_us, 1e6 / p50_us, None, 0.1)


def stepped(measure: Any, setting: str, *p50_us: float) -> Stepped:
    return Stepped(METHOD, measure, setting, (), [play(each) for each in p50_us])


def test_ratios_growth_and_percentiles_are_those_of_the_results(computed: Computed) -> None:
    found = figures_of(computed, [])
    assert [(entry["delay_ms"], entry["ratio_to_hold"]) for entry in found["accuracy"]] == [
        (100.0, pytest.approx(0.2)),
        (500.0, pytest.approx(0.2)),
    ]
    growths = [(entry["loss_pct"], entry["bursts"], entry["growth"]["ratio"]) for entry in found["loss"]]
    assert growths == [(0, False, 1.0), (20, False, 1.0), (20, True, pytest.approx(1.5))]
    for measure in ("noise", "noise_trained"):
        assert [(e["noise_mm"], e["growth"]["ratio"]) for e in found[measure]] == [(0, 1), (2, pytest.approx(1.5))]
    assert [entry["trained_on"] for entry in found["adaptability"]] == ["other person", "Knot_Tying"]
    assert [entry["ratio"] for entry in found["adaptability"]] == pytest.approx([1.5, 1.5])
    reliability = found["reliability"]
    assert (reliability["error_p50_mm"], reliability["error_p100_mm"]) == pytest.approx((2.0, 2.0), rel=0.00501)
    assert (reliability["missing_pct"], reliability["coverage_pct"]) == pytest.approx((7.0, 90.0))


def test_the_fewest_trials_within_5_per_cent_are_enough_and_costs_follow_the_rows(computed: Computed) -> None:
    found = figures_of(computed, [])
    assert [(e["n_trials"], e["n_rows"], e["train_s"]) for e in found["data"]] == [
        ("1", 300, 0.5),
        ("3", 900, 1.5),
        (ALL, 1200, 2.0),
    ]
    assert found["enough_trials"] == "3"
    assert found["training_s"] == 2.0
    assert found["exponents"]["train_rows"]["exponent"] == pytest.approx(1.0)


def test_times_of_steps_are_medians_over_rounds_and_give_exponents(computed: Computed) -> None:
    steps = [
        stepped("data", "1", 10.0, 30.0, 20.0),
        stepped("data", "3", 60.0),
        stepped("data", ALL, 80.0, 90.0, 70.0),
        stepped("size", "5", 10.0),
        stepped("size", "10", 40.0),
        Stepped("hold", "data", ALL, (), [play(1.0)]),
    ]
    found = figures_of(computed, steps)
    assert found["step"] == {
        "p50_us": 80.0,
        "p99_us": 160.0,
        "rate_hz": pytest.approx(12_500.0),
        "rate_both_hz": None,
        "n_rounds": 3,
    }
    assert found["exponents"]["step_rows"]["exponent"] == pytest.approx(1.0)  # 20, 60, 80 us at 300, 900, 1200 rows
    assert found["exponents"]["step_size"]["exponent"] == pytest.approx(2.0)
    assert found["fast"]["ratio_to_hold"] == pytest.approx(0.2)
    assert [(e["block_rows"], e["step_p50_us"]) for e in found["size"]] == [(5, 10.0), (10, 40.0)]


def test_a_method_without_results_has_its_gaps_and_nothing_else(computed: Computed) -> None:
    lacking = Computed(computed.subject, {}, Outcome(), ("needs an extra",))
    found = figures_of(lacking, [])
    assert found["gaps"] == ["needs an extra"]
    assert not any(found[name] for name in found if name not in ("method", "gaps", "n_seeds", "exponents"))
    assert set(found["exponents"].values()) == {None}
