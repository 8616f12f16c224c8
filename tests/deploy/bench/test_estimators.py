import time
from collections.abc import Iterator
from io import StringIO

import numpy as np
import pytest
from rich.console import Console

from tis.common.units import sample_instant_ns
from tis.deploy.bench import estimators
from tis.deploy.bench.estimators import (
    Network,
    Samples,
    StepTimes,
    arrivals_of,
    bench_estimators,
    bench_models,
    step_times_us,
)
from tis.patient_side.estimators.simple import Hold
from tis.patient_side.statespace import ArmModel

N_TICKS = 200


@pytest.fixture(scope="module")
def made() -> Iterator[tuple[ArmModel, ArmModel, Samples]]:
    """Return what `bench_models` makes, with few samples after training; as long as it is there they are few."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(estimators, "_N_TICKS", N_TICKS)
        yield bench_models()


@pytest.mark.slow
def test_every_network_has_a_table_with_every_estimator(
    made: tuple[ArmModel, ArmModel, Samples], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(estimators, "bench_models", lambda: made)  # once for this test and the last one
    monkeypatch.setattr(estimators, "_N_PLAYS", 2)
    monkeypatch.setattr(estimators, "NETWORKS", (Network("a", (50.0, 50.0), 0.0), Network("b", (50.0, 90.0), 0.1)))
    text = StringIO()
    assert bench_estimators(Console(file=text, width=120), ("hold", "innovations_kf")) == 0
    assert text.getvalue().count("innovations_kf, 20 states") == 2
    assert text.getvalue().count("innovations_kf") == 5  # with the model that is identified, and its verdict
    assert text.getvalue().count("p99, µs") == 2
    assert text.getvalue().count("steps") == 2
    assert text.getvalue().count("load ") == 2  # before and after
    assert text.getvalue().count("times its steady median (bound 5: ") == 1


def test_arrivals_have_the_delay_and_loss_of_the_network() -> None:
    arrivals = arrivals_of(Network("c", (50.0, 150.0), 0.25), 4000, arm=True)
    late_ms = np.array([t - sample_instant_ns(i, 30) for t, _, i in arrivals]) / 1e6
    assert 50.0 <= late_ms.min() < 51.0
    assert 149.0 < late_ms.max() <= 150.0
    assert len(arrivals) == pytest.approx(3000, abs=120)
    assert arrivals == arrivals_of(Network("c", (50.0, 150.0), 0.25), 4000, arm=True)


def _still(n: int) -> Samples:
    return Samples(np.zeros((n, 3)), np.zeros((n, 3)), np.zeros(n))


def test_a_step_counts_with_the_least_of_its_times(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a clock that jumps by 7 us within every third step."""
    calls = {"n": 0, "now": 0}

    def clock() -> int:
        calls["n"] += 1
        calls["now"] += 7000 if calls["n"] % 6 == 0 else 1
        return calls["now"]

    monkeypatch.setattr(time, "perf_counter_ns", clock)
    samples, arrivals = _still(7), [(0, True, 0)]
    assert np.count_nonzero(step_times_us(Hold(), samples, arrivals) > 6.9) == 2
    measured = StepTimes()
    for _ in range(4):
        measured.play(Hold(), samples, arrivals)
    assert measured.n_plays == 4
    assert measured.least_us.shape == (7,)
    assert np.all(measured.least_us < 0.1)


def test_what_takes_long_is_played_less_often(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(estimators, "_LONG_S", 0.0)
    samples, measured = _still(3), StepTimes()
    for _ in range(9):
        measured.play(Hold(), samples, [(0, True, 0)])
    assert measured.n_plays == 3


@pytest.mark.slow
def test_the_model_is_of_the_size_that_is_promised(made: tuple[ArmModel, ArmModel, Samples]) -> None:
    model, identified, samples = made
    assert identified.innovations is not None
    assert identified.innovations.correction is not None
    assert model.innovations is not None
    assert model.innovations.order == estimators.ORDER
    assert samples.command_m.shape == samples.arm_m.shape == (N_TICKS, 3)
    assert samples.gripper_rad.shape == (N_TICKS,)
