"""What the surgeon's side may put on the wire, and why not more."""

from typing import Any

import pytest

from tis.common.errors import InputError
from tis.common.scenario import Scenario
from tis.common.scenario.reading import build_scenario


def _scenario(rate_hz: int = 30, tick_phase_ms: float = 0.0, **surgeon: Any) -> Scenario:
    raw = {
        "version": 1,
        "name": "test",
        "rate_hz": rate_hz,
        "patient": {"tick_phase_ms": tick_phase_ms},
        "source": {"kind": "synthetic", "hands": ["left"]},
        "surgeon": surgeon,
    }
    return build_scenario(raw, "test.yaml")


def _faults(rate_hz: int = 30, **surgeon: Any) -> list[str]:
    with pytest.raises(InputError) as caught:
        _scenario(rate_hz, **surgeon)
    return [str(fault) for fault in caught.value.faults]


@pytest.mark.parametrize(("copies", "spacing_ms"), [(1, 5000), (2, 5000), (64, 79), (8, 33), (64, 0)])
def test_the_last_copy_may_leave_up_to_5_s_after_its_sample(copies: int, spacing_ms: float) -> None:
    assert _scenario(copies=copies, copy_spacing_ms=spacing_ms).surgeon.copies == copies


def test_a_copy_that_comes_too_late_for_any_forecast_is_refused_with_what_would_do() -> None:
    (fault,) = _faults(copies=3, copy_spacing_ms=2600)
    assert fault == (
        "test.yaml: surgeon: copy_spacing_ms must let the last of 3 copies leave within 5000 ms of its sample, after "
        "which nothing is forecast from it: at most 2500, or fewer copies (got 5200 ms)"
    )
    (fault,) = _faults(copies=3, copy_spacing_ms=60_000)
    assert fault == "test.yaml: surgeon.copy_spacing_ms: must be at most 5000 (got 60000)"


def test_more_than_can_be_carried_is_refused_for_packets_and_for_bytes() -> None:
    """64 copies of 1000 samples a second on two keys, each with 256 more: 128 000 packets of 64 kB."""
    packets, size = _faults(1000, copies=64, history=256)
    assert "surgeon.copies must give at most 50000 packets a second" in packets
    assert "(128000)" in packets
    assert "at most 100 MB a second" in size
    assert "(about 8227)" in size
    (only_size,) = _faults(copies=64, history=256)
    assert "at most 100 MB a second" in only_size
    assert _scenario(1000, copies=8, history=4).surgeon.packets_per_s(1000, 1) == 16_000


def test_a_spacing_without_copies_is_said_to_do_nothing_and_no_fault() -> None:
    (warning,) = _scenario(copy_spacing_ms=8).surgeon.warnings()
    assert warning.startswith("surgeon.copy_spacing_ms has no effect")
    assert _scenario(copies=2, copy_spacing_ms=8).surgeon.warnings() == []
    assert _scenario().surgeon.warnings() == []


def test_the_noise_of_the_sensors_is_a_deviation_in_mm_up_to_a_decimetre() -> None:
    assert _scenario().surgeon.sensor_noise_mm == 0.0
    assert _scenario(sensor_noise_mm=0.5).surgeon.sensor_noise_mm == 0.5
    (fault,) = _faults(sensor_noise_mm=-1)
    assert fault.startswith("test.yaml: surgeon.sensor_noise_mm: must be at least 0")
