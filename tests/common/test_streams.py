import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import kstest

from tis.common.streams import Stream

LABEL = "forward/tis/MTML/measured_cp/loss"
BLOCK = 4096  # the borders of these blocks are where an off-by-one would show


@settings(deadline=None, max_examples=30)
@given(st.lists(st.integers(0, 3 * BLOCK), min_size=1, max_size=20), st.integers(0, 2**32))
def test_an_element_is_the_same_however_it_is_asked_for(indices: list[int], seed: int) -> None:
    block = Stream.named(seed, LABEL).uniforms(0, 3 * BLOCK + 3)
    stream = Stream.named(seed, LABEL)
    assert [stream.uniform(i) for i in indices] == block[indices].tolist()
    for one, two in zip(indices, reversed(indices), strict=True):
        assert stream.uniform(one) == block[one]
        assert stream.uniforms(two, 3).tolist() == block[two : two + 3].tolist()


@pytest.mark.parametrize(("start", "count"), [(7, 0), (0, 1), (BLOCK - 1, 2), (5, 2 * BLOCK), (2 * BLOCK, BLOCK)])
def test_a_stretch_is_a_part_of_the_whole(start: int, count: int) -> None:
    whole = Stream.named(1, LABEL).uniforms(0, 4 * BLOCK)
    stretch = Stream.named(1, LABEL).uniforms(start, count)
    assert stretch.tolist() == whole[start : start + count].tolist()


def test_who_changes_what_was_drawn_changes_no_later_draw() -> None:
    stream = Stream.named(1, LABEL)
    drawn = stream.uniforms(5, 10)
    before = drawn.copy()
    drawn[:] = 0.0
    assert np.array_equal(stream.uniforms(5, 10), before)


def test_drawing_from_one_stream_shifts_no_other() -> None:
    loss, delay = Stream.named(7, "loss"), Stream.named(7, "delay")
    alone = [Stream.named(7, "delay").uniform(i) for i in range(100)]
    mixed = []
    for i in range(100):
        loss.uniform(3 * i)
        mixed.append(delay.uniform(i))
    assert mixed == alone


def test_the_numbers_of_a_seed_are_fixed_for_ever() -> None:
    """A change here would give every published run other packets."""
    drawn = Stream.named(7, LABEL).uniforms(0, 3)
    assert drawn.tolist() == [0.602129817401189, 0.5155404534133449, 0.6137795707997563]


@pytest.mark.parametrize("other", [(8, LABEL), (7, LABEL + "x"), (7, "")])
def test_seed_and_label_make_independent_streams(other: tuple[int, str]) -> None:
    n = 20_000
    a, b = Stream.named(7, LABEL).uniforms(0, n), Stream.named(*other).uniforms(0, n)
    assert abs(float(np.corrcoef(a, b)[0, 1])) < 5 / np.sqrt(n)
    assert not np.intersect1d(a, b).size


def test_seed_and_label_do_not_run_together() -> None:
    assert Stream.named(1, "2x").key != Stream.named(12, "x").key


def test_blocks_are_uniform_and_uncorrelated() -> None:
    drawn = Stream.named(3, LABEL).uniforms(0, 25 * BLOCK)
    assert kstest(drawn, "uniform").pvalue > 0.001
    # the first elements of the blocks, where the counter jumps, are as good as any
    assert kstest(drawn[::BLOCK], "uniform").pvalue > 0.001
    lag_one = float(np.corrcoef(drawn[:-1], drawn[1:])[0, 1])
    assert abs(lag_one) < 5 / np.sqrt(len(drawn))
    assert len(np.unique(drawn)) == len(drawn)


def test_quantile_functions_stay_finite() -> None:
    drawn = Stream.named(0, "open").uniforms(0, 100_000)
    assert drawn.min() > 0
    assert drawn.max() < 1
