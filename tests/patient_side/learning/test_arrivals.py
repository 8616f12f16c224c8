import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tis.common.streams import Stream
from tis.patient_side.learning.examples import N_KINDS, TICK_PHASE, draw_arrivals
from tis.patient_side.model_fields import Floats

N = 4000


def drawn(kind: int, seed: int, n: int = N) -> Floats:
    return draw_arrivals(kind, n, Stream.named(seed, "test"))


def test_a_clean_network_delays_by_the_ticks_phase() -> None:
    np.testing.assert_allclose(drawn(0, 1) - np.arange(N), TICK_PHASE)


def test_losses_one_by_one_come_at_the_drawn_share() -> None:
    shares = [float(np.mean(np.isinf(drawn(1, seed)))) for seed in range(60)]
    assert min(shares) > 0.01
    assert max(shares) < 0.54
    assert np.mean(shares) == pytest.approx(0.26, abs=0.06)  # 0.02 + 0.48 / 2


def test_bursts_have_the_drawn_loss_and_length() -> None:
    for seed in range(6):
        p_loss, mean_burst = (Stream.named(seed, "test").uniforms(0, 2) * [0.28, 10.0] + [0.02, 2.0]).tolist()
        lost = np.isinf(drawn(2, seed, 60_000))
        n_bursts = np.count_nonzero(lost[1:] & ~lost[:-1]) + int(lost[0])
        assert np.mean(lost) == pytest.approx(p_loss, rel=0.25)
        assert np.count_nonzero(lost) / n_bursts == pytest.approx(mean_burst, rel=0.15)


@pytest.mark.parametrize(("kind", "most"), [(3, 13.0), (4, 160.0)])
def test_varying_delays_stay_in_their_range_and_some_rows_are_lost(kind: int, most: float) -> None:
    for seed in range(10):
        delay = drawn(kind, seed) - np.arange(N)
        known = delay[np.isfinite(delay)]
        assert known.min() >= 0
        assert known.max() <= most
        assert np.mean(np.isinf(delay)) == pytest.approx(0.02, abs=0.01)


@given(kind=st.integers(0, N_KINDS - 1), seed=st.integers(0, 1000))
def test_the_same_stream_gives_the_same_arrivals(kind: int, seed: int) -> None:
    assert np.array_equal(drawn(kind, seed, 50), drawn(kind, seed, 50))
