import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tis.common.streams import Stream
from tis.patient_side.dynamics.excitation import MAX_SPEED, excitation, fourier
from tis.patient_side.dynamics.parameters import base_parameters
from tis.patient_side.plant.arm_geometry import HIGH, LOW


@settings(max_examples=25)
@given(st.integers(0, 1000))
def test_any_movement_keeps_limits_and_speeds_and_repeats(seed: int) -> None:
    draws = Stream.named(seed, "movement").uniforms(0, 7 * 32).reshape(7, 32)
    moved = fourier(draws, np.arange(2001) / 100.0)
    assert (moved >= LOW).all()
    assert (moved <= HIGH).all()
    assert (np.abs(np.diff(moved, axis=0)) * 100.0 <= 1.01 * MAX_SPEED).all()
    assert moved[1000] == pytest.approx(moved[0], abs=1e-9)  # 10 s later
    assert (np.ptp(moved, axis=0) > 0.0).all()


def test_the_chosen_movement_has_the_asked_rate_and_belongs_to_its_stream() -> None:
    base = base_parameters()
    found = excitation(Stream.named(3, "a"), base.independent, 100, 4.0)
    assert found.shape == (400, 7)
    assert np.array_equal(found, excitation(Stream.named(3, "a"), base.independent, 100, 4.0))
    assert not np.array_equal(found, excitation(Stream.named(3, "b"), base.independent, 100, 4.0))
