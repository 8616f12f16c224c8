import time
from io import StringIO

import numpy as np
import pytest
from rich.console import Console

from common.units import sample_instant_ns
from deploy.bench import estimators
from deploy.bench.estimators import Network, arrivals_of, bench_estimators, bench_model, step_times_us
from patient_side.estimators.hold import Hold


def test_every_network_has_a_table_with_every_estimator(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(estimators, "_N_TICKS", 200)
    monkeypatch.setattr(estimators, "_N_TRAIN", 400)
    monkeypatch.setattr(estimators, "NETWORKS", (Network("a", (50.0, 50.0), 0.0), Network("b", (50.0, 90.0), 0.1)))
    text = StringIO()
    assert bench_estimators(Console(file=text, width=100), ("hold", "innovations_kf")) == 0
    assert text.getvalue().count("innovations_kf") == 2
    assert text.getvalue().count("p99") == 2


def test_arrivals_have_the_delay_and_loss_of_the_network() -> None:
    arrivals = arrivals_of(Network("c", (50.0, 150.0), 0.25), 4000, arm=True)
    late_ms = np.array([t - sample_instant_ns(i, 30) for t, _, i in arrivals]) / 1e6
    assert 50.0 <= late_ms.min() < 51.0
    assert 149.0 < late_ms.max() <= 150.0
    assert len(arrivals) == pytest.approx(3000, abs=120)
    assert arrivals == arrivals_of(Network("c", (50.0, 150.0), 0.25), 4000, arm=True)


def test_a_step_counts_with_the_least_of_its_times(monkeypatch: pytest.MonkeyPatch) -> None:
    now = iter(range(0, 10**9, 1))
    calls = {"n": 0}

    def clock() -> int:
        calls["n"] += 1
        return next(now) if calls["n"] % 4 else next(now) + 7000

    monkeypatch.setattr(time, "perf_counter_ns", clock)
    u = np.zeros((6, 3))
    times = step_times_us(Hold(), u, u, [(0, True, 0)])
    assert times.shape == (6,)
    assert np.all(times < 7.1)


def test_the_model_is_of_the_size_that_is_promised(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(estimators, "_N_TICKS", 10)
    model, u, y = bench_model()
    assert model.innovations is not None
    assert model.innovations.order == estimators.ORDER
    assert u.shape == y.shape == (10, 3)
