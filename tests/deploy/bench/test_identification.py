from collections.abc import Sequence
from io import StringIO

import numpy as np
import pytest
from rich.console import Console

from tis.deploy.bench import identification
from tis.deploy.bench.identification import Size, bench_identification, measure, simulated_trials
from tis.deploy.bench.prediction_accuracy import PLANTS
from tis.patient_side.linear_system import Array


def test_every_size_has_a_table_with_every_method_and_its_bound(monkeypatch: pytest.MonkeyPatch) -> None:
    small = (Size("one", 1, 300, 2, 2, 10_000.0), Size("two", 3, 200, 2, 1, 0.0, 500.0, peers=False))
    monkeypatch.setattr(identification, "SIZES", small)
    monkeypatch.setattr(identification, "PLANTS", PLANTS[:1])
    text = StringIO()
    assert bench_identification(Console(file=text, width=120)) == 0
    for name in ("moesp", "pi_moesp", "n4sid", "cva", "arx", "triangular factor alone"):
        assert text.getvalue().split("ball and beam")[0].count(f" {name} ") == 2
    assert "ball and beam" in text.getvalue()
    assert " tis moesp, stable " in text.getvalue()
    assert "10000 ms: kept" in text.getvalue()
    assert "0 ms, 500 MB: MISSED" in text.getvalue()


def test_the_data_have_the_size_and_noise_that_no_input_explains() -> None:
    u, y = simulated_trials(2, 400, 3, seed=1)
    assert [(a.shape, b.shape) for a, b in zip(u, y, strict=True)] == [((400, 3), (400, 3))] * 2
    again, _ = simulated_trials(2, 400, 3, seed=1)
    assert np.array_equal(u[1], again[1])


def test_memory_is_what_a_call_holds_at_most() -> None:
    def call(u: Sequence[Array], y: Sequence[Array]) -> object:
        for _ in range(3):
            np.ones(1_000_000)  # 8 MB, given back each time
        return None

    measured = measure("some", call, [], [], 2)
    assert 7.9 < measured.memory_mb < 9.0
    assert measured.time_ms > 0
