import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tis.common.scenario.source import SyntheticSource
from tis.common.sources.plausibility import anomalies, rate_doubts
from tis.common.sources.synthetic import synthesise
from tis.common.sources.trajectory import Array


def swing(n_rows: int = 900, rate_hz: int = 30, size_m: float = 0.1) -> Array:
    """Return a slow movement (n_rows, 3): at its quickest 2 pi 0.1 / 4 s = 0.16 m/s and 0.25 m/s^2."""
    t_s = np.arange(n_rows) / rate_hz
    return size_m * np.stack([np.sin(np.pi * t_s / 2), np.cos(np.pi * t_s / 2), np.sin(np.pi * t_s / 3)], axis=1)


def test_a_slow_movement_raises_no_doubt() -> None:
    assert anomalies(swing(), 30, "MTML", True) == ()


def test_millimetres_are_asked_about_and_nothing_else_is() -> None:
    [text] = anomalies(1000 * swing(), 30, "PSM2", False)
    assert text == "PSM2 moves over 200 m, further than any arm: are these millimetres?"


def test_rows_that_were_cut_out_are_named() -> None:
    whole = swing()
    cut = np.delete(whole, slice(300, 361), axis=0)
    jumped_mm = 1000 * float(np.linalg.norm(whole[361] - whole[299]))
    assert jumped_mm > 100
    [text] = anomalies(cut, 30, "MTML", True)
    expected = f"MTML jumps as no hand moves it, from row 299 to 300 ({jumped_mm:.0f} mm): are rows missing?"
    assert text == expected
    # the same rows, of a recorder a hundred times slower, are no jump
    assert anomalies(cut, 0.3, "MTML", False) == ()


def test_more_jumps_than_are_shown_are_counted() -> None:
    steps = swing()
    for row in range(100, 700, 100):
        steps[row:] += 0.05
    [text] = anomalies(steps, 30, "MTML", True)
    assert "from row 99 to 100 (" in text
    assert "299 to 300 (" in text
    assert text.endswith(") and 3 more times: are rows missing?")


def test_zeros_are_named_and_so_are_the_jumps_to_them() -> None:
    filled = swing() + 0.5
    filled[400:460] = 0.0
    zeros, jumps = anomalies(filled, 30, "PSM1", False)
    assert zeros == "PSM1 is at exactly 0 0 0 in rows 400-459: were rows filled in?"
    assert "from row 399 to 400 (" in jumps
    assert "459 to 460 (" in jumps


@pytest.mark.parametrize(("n_repeats", "told"), [(59, False), (60, False), (61, True), (99, True)])
def test_a_master_that_repeats_a_row_for_longer_than_two_seconds_is_doubted(n_repeats: int, told: bool) -> None:
    held = np.concatenate([swing()[:200], np.repeat(swing()[199:200], n_repeats, axis=0), swing()[200:]])
    found = anomalies(held, 30, "MTMR", True)
    assert len(found) == told
    if told:
        span = f"rows 199-{199 + n_repeats}"
        assert found[0].startswith(
            f"MTMR repeats one position to the last digit for up to {n_repeats / 30:.1f} s, in {span}:"
        )
    assert anomalies(held, 30, "PSM2", False) == ()  # an arm stands still while a clutch is pressed


@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 1000), rate_hz=st.sampled_from([30, 200]), recorded=st.booleans())
def test_the_synthetic_surgeon_raises_none(seed: int, rate_hz: int, recorded: bool) -> None:
    source = SyntheticSource(kind="synthetic", recorder_hz=51.33 if recorded and rate_hz == 30 else None)
    [hand] = synthesise(source, seed, rate_hz, 30 * rate_hz, 0).hands
    assert anomalies(hand.command.position_m, rate_hz, "MTML", True) == ()
    assert anomalies(hand.follower.position_m, rate_hz, "PSM2", False) == ()


@pytest.mark.parametrize("rate_hz", [20, 30, 50])
def test_velocities_of_about_the_rate_raise_no_doubt(rate_hz: int) -> None:
    positions = swing(rate_hz=rate_hz)
    velocities = np.gradient(positions, 1 / rate_hz, axis=0)
    assert rate_doubts(positions, np.roll(velocities, -2, axis=0), 30, "MTML") == ()


@pytest.mark.parametrize("rate_hz", [10, 200])
def test_velocities_tell_another_rate(rate_hz: int) -> None:
    positions = swing(rate_hz=rate_hz)
    [text] = rate_doubts(positions, np.gradient(positions, 1 / rate_hz, axis=0), 30, "MTML")
    found = re.search(r"taken for 30 rows per second; by its velocities it has ([\d.]+):", text)
    assert found is not None
    assert float(found[1]) == pytest.approx(rate_hz, rel=0.02)


def test_velocities_that_were_not_recorded_and_an_arm_that_stands_still_tell_nothing() -> None:
    still = np.zeros((90, 3))
    assert rate_doubts(swing(90), still, 30, "MTML") == rate_doubts(still, swing(90), 30, "MTML") == ()
