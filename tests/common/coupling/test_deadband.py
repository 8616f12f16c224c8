"""Weber's deadband: number of packets in closed form, the receiver's error, and the edges."""

from math import log

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tis.common.coupling.deadband import LEAST, Deadband
from tis.common.vector import ZERO, Vector, minus, size

NUMBER = st.floats(-50, 50)


@pytest.mark.parametrize("share", [0.05, 0.1, 0.2])
def test_a_growth_at_a_constant_ratio_sends_as_many_packets_as_the_closed_form_says(share: float) -> None:
    """From 0.1 to 5 N in 100 000 samples."""
    deadband = Deadband(share)
    for i, force_n in enumerate(np.geomspace(0.1, 5.0, 100_000).tolist()):
        deadband.is_sent((0.0, 0.0, force_n), i)
    assert abs(deadband.n_sent - (1 + log(50) / log(1 + share))) <= 1
    assert deadband.n_sent + deadband.n_suppressed == 100_000


@given(st.lists(st.tuples(NUMBER, NUMBER, NUMBER), min_size=1, max_size=60), st.floats(0.01, 1.0))
def test_without_loss_the_receiver_errs_by_less_than_the_share(values: list[Vector], share: float) -> None:
    deadband, held = Deadband(share), ZERO
    for i, value in enumerate(values):
        if deadband.is_sent(value, i):
            held = value
        assert size(minus(value, held)) <= share * (size(held) + LEAST) + 1e-12


@given(st.lists(st.tuples(NUMBER, NUMBER, NUMBER), min_size=1, max_size=30))
def test_a_share_of_zero_sends_everything(values: list[Vector]) -> None:
    deadband = Deadband(0.0)
    assert all(deadband.is_sent(value, i) for i, value in enumerate(values))


def test_the_first_sample_is_sent_and_zero_never_divides() -> None:
    deadband = Deadband(1.0)
    assert [deadband.is_sent(ZERO, i) for i in range(3)] == [True, False, False]
    assert deadband.is_sent((2e-5, 0.0, 0.0), 3)


def test_a_constant_value_is_sent_again_when_the_keep_alive_is_due() -> None:
    deadband = Deadband(0.1, keep_alive_ns=50)
    assert [at for at in range(0, 200, 10) if deadband.is_sent((1.0, 0.0, 0.0), at)] == [0, 50, 100, 150]
