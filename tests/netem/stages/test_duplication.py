import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import binomtest

from tis.common.scenario.network.pipeline import Duplicate
from tis.common.streams import BLOCK, Address
from tis.netem.draws.blocks import SelectionBlocks
from tis.netem.stages.single_packets import duplicated

ADDRESS = Address(7, "forward", "tis/MTML/measured_cp")


def _first(chance: SelectionBlocks, n_blocks: int = 25) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    return np.concatenate([chance.block(number) for number in range(n_blocks)])


def test_as_many_come_twice_as_were_asked_for() -> None:
    for p in (0.001, 0.05, 0.5, 0.97):
        twice = _first(duplicated(Duplicate(p_duplicate=p), ADDRESS))
        assert binomtest(int(twice.sum()), len(twice), p).pvalue > 0.001


def test_neighbours_are_independent() -> None:
    twice = _first(duplicated(Duplicate(p_duplicate=0.3), ADDRESS))
    pairs = len(twice) // 2
    assert binomtest(int((twice[0::2] & twice[1::2]).sum()), pairs, 0.09).pvalue > 0.001


def test_blocks_are_independent() -> None:
    blocks = _first(duplicated(Duplicate(p_duplicate=0.3), ADDRESS), 24).reshape(-1, BLOCK)
    both = blocks[0::2] & blocks[1::2]
    assert binomtest(int(both.sum()), both.size, 0.09).pvalue > 0.001


def test_none_and_all() -> None:
    assert not _first(duplicated(None, ADDRESS), 2).any()
    assert not _first(duplicated(Duplicate(p_duplicate=0), ADDRESS), 2).any()
    assert _first(duplicated(Duplicate(p_duplicate=1), ADDRESS), 2).all()


def test_a_smaller_probability_takes_some_of_the_same_packets() -> None:
    few, many = (_first(duplicated(Duplicate(p_duplicate=p), ADDRESS), 3) for p in (0.1, 0.4))
    assert few.any()
    assert not (few & ~many).any()


def test_packets_are_addressed_by_the_stream_of_their_stage() -> None:
    uniforms = ADDRESS.stream("duplicate").uniforms(0, 3 * BLOCK)
    assert (_first(duplicated(Duplicate(p_duplicate=0.2), ADDRESS), 3) == (uniforms < 0.2)).all()


@given(st.lists(st.integers(0, 2**20), max_size=6))
def test_a_block_does_not_depend_on_those_asked_for_before(numbers: list[int]) -> None:
    part = Duplicate(p_duplicate=0.2)
    used = duplicated(part, ADDRESS)
    for number in [*numbers, *reversed(numbers)]:
        block = used.block(number)
        assert block.shape == (BLOCK,)
        assert (block == duplicated(part, ADDRESS).block(number)).all()
