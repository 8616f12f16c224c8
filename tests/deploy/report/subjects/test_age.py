from pathlib import Path

import pytest

from tests.deploy.report.hand_made import ARM, COMMAND, a_scenario, message, tick, write_run
from tis.deploy.report.subjects.age import age_of_information_ms, freshest_arrivals, tick_modes

PERIOD_MS = 1000 / 30


def test_the_saw_tooth_of_three_samples(tmp_path: Path) -> None:
    """Sampled at 0, 10, 20 ms, arrived at 4, 16, 22, the arm's sample at 10 behind the command's; until 30 ms."""
    patient = [
        message(COMMAND, 0, 0, log_ms=4, sample_ms=0),
        message(ARM, 1, 10, log_ms=17, sample_ms=10),
        message(COMMAND, 1, 10, log_ms=16, sample_ms=10),
        message(COMMAND, 2, 20, log_ms=22, sample_ms=20),
        tick(0, 5, 5),
        tick(1, 30, 30),
    ]
    logs = write_run(tmp_path, patient=patient)
    found = age_of_information_ms(logs, freshest_arrivals(logs, "tis", {"left": "PSM2"}))
    assert found["mean"] == pytest.approx((120 + 54 + 48) / 26)
    assert (found["peak"]["max"], found["peak"]["mean"]) == (16, 14)


def test_what_each_mode_makes_of_a_constant_delay_of_40_ms(tmp_path: Path) -> None:
    sample_ms = [k * PERIOD_MS for k in range(60)]
    patient = [message(COMMAND, k, ms, log_ms=ms + 40, sample_ms=ms) for k, ms in enumerate(sample_ms)]
    logs = write_run(tmp_path, patient=patient)
    arrivals = freshest_arrivals(logs, "tis", {"left": "PSM2"})
    modes = tick_modes(logs, a_scenario(), arrivals)
    assert (modes["mode"], modes["shifts"]) == ("free", 0)
    assert modes["free"]["age_when_used_ms"]["p50"] == pytest.approx(2 * PERIOD_MS + 2, abs=1e-5)
    assert modes["phase_locked"]["phase_ms"] == pytest.approx(40 - PERIOD_MS + PERIOD_MS / 100, abs=1e-5)
    assert modes["phase_locked"]["age_when_used_ms"]["max"] == pytest.approx(40 + PERIOD_MS / 100, abs=1e-5)
    assert modes["on_arrival"]["age_when_used_ms"]["p50"] == pytest.approx(40)
    assert modes["on_arrival"]["saves_ms"] == pytest.approx(2 * PERIOD_MS + 2 - 40, abs=1e-4)
    assert modes["free"]["saves_ms"] == 0
    assert modes["line"] == (
        "Ticks: free. On these arrivals the mean age of a sample is 68.7 ms when a free tick at 2 ms uses it; the "
        "best fixed phase, 7 ms, would save 28.3 ms of that mean, answering on arrival 28.7 ms."
    )


def test_nothing_arrived_nothing_is_known(tmp_path: Path) -> None:
    logs = write_run(tmp_path)
    arrivals = freshest_arrivals(logs, "tis", {"left": "PSM2"})
    assert age_of_information_ms(logs, arrivals)["mean"] is None
    modes = tick_modes(logs, a_scenario(), arrivals)
    assert modes["on_arrival"]["saves_ms"] is None
    assert modes["line"] == "Ticks: free; nothing arrived."
    assert tick_modes(logs, a_scenario(), [])["line"] == modes["line"]
