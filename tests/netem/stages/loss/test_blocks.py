"""Losses as the emulator asks for them: in any order, key by key."""

from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from tests.netem.stages.loss.making import HERE, losses, make, netfi
from tis.common.scenario.network import loss as network
from tis.common.streams import BLOCK, Address
from tis.netem.draws.blocks import HEAD
from tis.netem.stages.loss import expected_loss, loss_blocks

PARTS: dict[str, network.Loss] = {
    "bernoulli": make("bernoulli", p_loss=0.2),
    "burst": make("burst", p_loss=0.1, mean_burst=50),
    "gilbert_elliott": make("gilbert_elliott", p_bad=0.1, p_good=0.3, p_loss_bad=0.7, p_loss_good=0.01),
    "swapping": make("gilbert_elliott", p_bad=0.9, p_good=0.7),
    "four_state": make("four_state", p13=0.05, p31=0.2, p32=0.1, p23=0.3, p14=0.1),
    "pareto_runs": make("pareto_runs", received={"shape": 2.2, "scale": 20}, lost={"shape": 2.2, "scale": 15}),
    "gilbert_pareto": netfi((3.859, 3.324), (3.797, 6.049)),
}
N_BLOCKS = 36  # three segments


@cache
def in_order(name: str) -> NDArray[np.float64]:
    blocks = loss_blocks(PARTS[name], HERE, {})
    return np.stack([blocks.block(number) for number in range(N_BLOCKS)])


@settings(max_examples=12)
@given(name=st.sampled_from(list(PARTS)), numbers=st.lists(st.integers(0, N_BLOCKS - 1), min_size=1, max_size=6))
def test_any_order_gives_the_numbers_of_the_right_order(name: str, numbers: list[int]) -> None:
    blocks = loss_blocks(PARTS[name], HERE, {})
    for number in numbers:
        assert (blocks.block(number) == in_order(name)[number]).all()


@pytest.mark.parametrize("name", PARTS)
def test_forged_sequence_numbers_reach_the_same_numbers_too(name: str) -> None:
    last = 2**32 // BLOCK - 1
    here, there = loss_blocks(PARTS[name], HERE, {}), loss_blocks(PARTS[name], HERE, {})
    far = here.block(last)
    there.block(last - 3)
    assert (there.block(last) == far).all()
    assert far.shape == (BLOCK,)
    assert (far >= 0).all()
    assert (far <= 1).all()


@pytest.mark.parametrize("name", PARTS)
def test_keys_directions_seeds_and_the_loss_stream_are_independent(name: str) -> None:
    here = losses(PARTS[name], 12)
    others = [HERE._replace(key="tis/PSM2/setpoint_cp"), HERE._replace(direction="feedback"), HERE._replace(seed=6)]
    for other in others:
        assert abs(np.corrcoef(here, losses(PARTS[name], 12, other))[0, 1]) < 0.12
    path = np.concatenate([loss_blocks(PARTS[name], HERE, {}).block(number) for number in range(12)])
    if path.std() > 1e-9:
        assert abs(np.corrcoef(path, HERE.stream("loss").uniforms(0, len(path)))[0, 1]) < 0.05


@pytest.mark.parametrize("name", ["pareto_runs", "gilbert_pareto", "burst", "four_state"])
def test_already_the_first_packets_are_lost_as_often_as_the_later_ones(name: str) -> None:
    n = 500
    parts = [Address(seed, "forward", "k") for seed in range(n)]
    first = np.stack([loss_blocks(PARTS[name], address, {}).block(0)[:64:4] for address in parts])
    share = expected_loss(PARTS[name], {}).p_loss
    assert np.abs(first.mean(axis=0) - share).max() <= 4 * np.sqrt(share * (1 - share) / n)


def test_runs_of_losses_are_not_cut_where_segments_meet() -> None:
    part = make("burst", p_loss=0.5, mean_burst=100)
    blocks = loss_blocks(part, HERE, {})
    differ = [bool(blocks.block(16 * segment - 1)[-1] != blocks.block(16 * segment)[0]) for segment in range(1, 150)]
    assert 1 <= sum(differ) + 1 <= 8  # of 149 edges 1.5 should be where a run begins or ends; independent ends: 75


def test_certainties_are_exact() -> None:
    assert not losses(None, 3).any()
    assert not losses(make("bernoulli", p_loss=0), 3).any()
    assert losses(make("bernoulli", p_loss=1), 3).all()
    alternating = losses(make("gilbert_elliott", p_bad=1, p_good=1), 3)
    assert (alternating[1:] != alternating[:-1]).all()
    assert losses(make("gilbert_elliott", p_bad=1, p_good=1e-9), 3).all()


@pytest.mark.parametrize("kind", ["bernoulli", "burst"])
def test_a_higher_share_loses_the_same_packets_and_more(kind: str) -> None:
    more = {"mean_burst": 5} if kind == "burst" else {}
    few, many = (losses(make(kind, p_loss=p_loss, **more), 10) for p_loss in (0.01, 0.02))
    assert many[few].all()
    assert many.sum() > few.sum()


@pytest.mark.parametrize("name", PARTS)
def test_the_head_of_a_block_is_its_beginning(name: str) -> None:
    blocks = loss_blocks(PARTS[name], HERE, {})
    for number in (0, 20):
        assert (blocks.block(number, HEAD)[:HEAD] == blocks.block(number)[:HEAD]).all()
