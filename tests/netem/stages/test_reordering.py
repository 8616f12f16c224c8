import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import binomtest

from tis.common.scenario.network.pipeline import Reorder
from tis.common.streams import Address
from tis.netem.stages.single_packets import reordered, skipped_ns

ADDRESS = Address(7, "forward", "tis/MTML/measured_cp")
DELAYS = np.array([0, 1, 2_499_999, 2_500_000, 2_500_001, 9_000_000, 9_000_000])
SKIPS = np.array([True, True, True, True, True, True, False])


def test_as_many_skip_as_were_asked_for() -> None:
    chance = reordered(Reorder(p_reorder=0.07), ADDRESS)
    skips = np.concatenate([chance.block(number) for number in range(25)])
    assert binomtest(int(skips.sum()), len(skips), 0.07).pvalue > 0.001
    assert (skips[:4096] == (ADDRESS.stream("reorder").uniforms(0, 4096) < 0.07)).all()
    assert not reordered(None, ADDRESS).block(0).any()


@pytest.mark.parametrize(
    ("part", "expected"),
    [
        (None, [0, 0, 0, 0, 0, 0, 0]),
        (Reorder(p_reorder=1), [0, 1, 2_499_999, 2_500_000, 2_500_001, 9_000_000, 0]),
        (Reorder(p_reorder=1, early_ms=2.5), [0, 1, 2_499_999, 2_500_000, 2_500_000, 2_500_000, 0]),
        (Reorder(p_reorder=1, early_ms=0), [0, 0, 0, 0, 0, 0, 0]),
    ],
)
def test_a_packet_skips_all_of_its_delay_or_so_much_of_it(part: Reorder | None, expected: list[int]) -> None:
    skipped = skipped_ns(part, DELAYS, SKIPS)
    assert skipped.dtype == np.int64
    assert skipped.tolist() == expected


@given(st.lists(st.tuples(st.integers(0, 10**12), st.booleans())), st.one_of(st.none(), st.floats(0, 3_600_000)))
def test_what_is_left_is_never_negative_and_others_keep_their_delay(
    packets: list[tuple[int, bool]], early_ms: float | None
) -> None:
    delay_ns = np.array([delay for delay, _ in packets], dtype=np.int64)
    skips = np.array([skip for _, skip in packets], dtype=np.bool_)
    left_ns = delay_ns - skipped_ns(Reorder(p_reorder=0.5, early_ms=early_ms), delay_ns, skips)
    assert (left_ns >= 0).all()
    assert (left_ns <= delay_ns).all()
    assert (left_ns[~skips] == delay_ns[~skips]).all()
