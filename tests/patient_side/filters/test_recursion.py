import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import lfilter

from tis.patient_side.filters.recursion import filtered


@given(st.integers(0, 1000), st.integers(1, 60), st.booleans())
def test_signals_are_filtered_as_scipy_filters_them(seed: int, n: int, is_complex: bool) -> None:
    rng = np.random.default_rng(seed)
    poles = rng.uniform(-0.95, 0.95, 2) * (np.exp(1j * rng.uniform(0, 3)) if is_complex else 1.0)
    numerator, denominator = rng.normal(size=3), np.poly(poles)
    signals = rng.normal(size=(2, n))
    found = filtered(numerator, denominator, signals)
    assert np.iscomplexobj(found) == np.iscomplexobj(denominator)
    assert found == pytest.approx(lfilter(numerator, denominator, signals), abs=1e-9)
