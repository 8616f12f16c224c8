"""Set points of twins: bounded after outages, the estimate itself without any."""

import pytest

from tests.patient_side.safety.outages import one, watched


@pytest.mark.parametrize("number", range(4))
def test_after_an_outage_no_step_is_large_and_the_estimate_is_met_within_a_second(number: int) -> None:
    found = one(number)
    assert found.step_mm <= 8.0 + 1e-9
    assert found.error_mm <= 1.1 * found.estimate_error_mm


@pytest.mark.parametrize(
    ("name", "duration_s"),
    [("default", 10.0), ("lossy", 10.0), pytest.param("kilohertz", 1.5, marks=pytest.mark.slow)],
)
def test_without_outages_the_set_point_is_the_estimate_bit_for_bit(name: str, duration_s: float) -> None:
    seen, _ = watched(name, ("source.hands=[left]",), 7, duration_s)
    assert seen.driven == seen.estimates
    assert len(seen.driven) > 250
    assert [note.mode for note in seen.notes] == ["tracking"]
