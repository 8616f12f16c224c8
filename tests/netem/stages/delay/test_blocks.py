from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats
from scipy.special import ndtri

from tests.netem.stages.delay.laws import ADDRESS, LAWS, MS, drawn, model, stages
from tis.common.scenario.network.pipeline import Stages
from tis.common.streams import BLOCK
from tis.netem.draws.blocks import HEAD
from tis.netem.stages.delay import delay_blocks

LOGNORMAL = LAWS["lognormal"].part
NORMAL_JITTER = {"kind": "normal", "std_ms": 2}


@pytest.mark.parametrize("name", LAWS)
def test_a_correlated_delay_has_the_law_asked_for(name: str) -> None:
    law = LAWS[name]
    n_blocks = 40 if "gamma" in name else 120
    delay_ms = (
        drawn(stages(law.part, correlation={"half_life_s": 0.002}), n_blocks * BLOCK, ADDRESS._replace(key=name)) / MS
    )
    apart = delay_ms[::20]  # ten half-lives
    assert stats.kstest(apart, law.cdf).pvalue > 0.001
    asked = model(law.part)
    assert apart.mean() == pytest.approx(asked.mean_ns / MS, abs=4 * asked.std_ns / MS / np.sqrt(len(apart)))


@pytest.mark.parametrize("rate_hz", [3, 30, 97])
def test_the_law_does_not_depend_on_the_message_rate(rate_hz: int) -> None:
    law = LAWS["lognormal"]
    delay_ms = drawn(stages(law.part, correlation={"half_life_s": 0.001}), 300 * BLOCK) / MS
    cells = np.arange(len(delay_ms) * rate_hz // 1000) * 1000 // rate_hz
    assert stats.kstest(delay_ms[cells], law.cdf).pvalue > 0.001


@pytest.mark.parametrize("cell", [0, 1, 2048, BLOCK - 1])
def test_every_cell_has_the_law_over_many_keys(cell: int) -> None:
    law = LAWS["lognormal"]
    pipeline = stages(law.part, correlation={"half_life_s": 5.0})
    delays_ns = [delay_blocks(pipeline, ADDRESS._replace(key=f"k{k}"), {}).block(7)[cell] for k in range(200)]
    assert stats.kstest(np.array(delays_ns) / MS, law.cdf).pvalue > 0.001


def test_the_scores_of_correlated_delays_halve_with_the_half_life() -> None:
    law = LAWS["lognormal"]
    delay_ms = drawn(stages(law.part, correlation={"half_life_s": 0.05}), 1000 * BLOCK) / MS
    z = ndtri(law.cdf(delay_ms))
    assert np.corrcoef(z[50:], z[:-50])[0, 1] == pytest.approx(0.5, abs=0.02)


def test_a_correlated_jitter_is_spread_as_asked_and_reorders_nothing() -> None:
    # 1 kHz, sd 1 ms, half-life 50 ms: neighbours differ by 0.17 ms, so a message overtakes none but very rarely
    pipeline = stages(
        {"kind": "constant", "delay_ms": 40},
        jitter={"kind": "normal", "std_ms": 1},
        correlation={"half_life_s": 0.05},
    )
    delay_ms = drawn(pipeline, 2_000_000) / MS
    assert delay_ms.std() == pytest.approx(1, rel=0.01)
    assert delay_ms.mean() == pytest.approx(40, rel=0.001)
    assert (np.diff(delay_ms) < -1).sum() == 0


def test_delay_and_jitter_follow_paths_of_their_own() -> None:
    correlation = {"half_life_s": 0.001}
    delay = {"kind": "uniform", "low_ms": 20, "high_ms": 40}
    alone = drawn(stages(delay, correlation=correlation), 40 * BLOCK)
    both = drawn(stages(delay, correlation=correlation, jitter=NORMAL_JITTER), 40 * BLOCK)
    deviation_ms = (both - alone)[::20] / MS
    assert stats.kstest(deviation_ms, stats.norm(0, 2).cdf).pvalue > 0.001
    assert abs(stats.spearmanr(alone[::20], deviation_ms).statistic) < 4 / np.sqrt(len(deviation_ms))


def test_what_blocks_count() -> None:
    assert delay_blocks(stages(LOGNORMAL), ADDRESS, {}).counts == "packet"
    assert delay_blocks(stages(LOGNORMAL, correlation={"half_life_s": 1}), ADDRESS, {}).counts == "cell"
    nothing = delay_blocks(Stages.model_validate({}), ADDRESS, {})
    assert nothing.block(3).tolist() == [0] * BLOCK


PIPELINES: list[dict[str, Any]] = [
    {"delay": LOGNORMAL},
    {"delay": LOGNORMAL, "jitter": NORMAL_JITTER},
    {"delay": LOGNORMAL, "correlation": {"half_life_s": 0.5}},
    {"delay": LOGNORMAL, "jitter": NORMAL_JITTER, "correlation": {"half_life_s": 0.5, "across_keys": True}},
]


@settings(deadline=None, max_examples=40)
@given(which=st.sampled_from(PIPELINES), numbers=st.lists(st.integers(0, 40), min_size=1, max_size=5))
def test_blocks_in_any_order_are_the_blocks_in_order(which: dict[str, Any], numbers: list[int]) -> None:
    made = Stages.model_validate(which)
    asked = delay_blocks(made, ADDRESS, {})
    fresh = delay_blocks(made, ADDRESS, {})
    in_order = [fresh.block(number) for number in range(max(numbers) + 1)]
    for number in numbers:
        block = asked.block(number)
        assert block.dtype == np.int64
        assert block.min() >= 0
        assert np.array_equal(block, in_order[number])


def test_jitter_leaves_the_delay_draws_alone_and_keys_differ() -> None:
    delay = {"kind": "uniform", "low_ms": 20, "high_ms": 40}
    alone = drawn(stages(delay), BLOCK)
    none = drawn(stages(delay, jitter={"kind": "normal", "std_ms": 0}), BLOCK)
    assert np.array_equal(alone, none)
    assert not np.array_equal(alone, drawn(stages(delay), BLOCK, ADDRESS._replace(key="other")))


def test_existing_seeds_give_the_numbers_that_they_always_gave() -> None:
    u = ADDRESS.stream("delay").uniforms(BLOCK, 3)
    block = delay_blocks(stages({"kind": "uniform", "low_ms": 10, "high_ms": 30}), ADDRESS, {}).block(1)
    assert block[:3].tolist() == np.rint(10e6 + u * 20e6).tolist()


def test_keys_that_share_a_process_are_equally_late() -> None:
    shared = stages(LOGNORMAL, correlation={"half_life_s": 0.5, "across_keys": True})
    assert np.array_equal(drawn(shared, BLOCK), drawn(shared, BLOCK, ADDRESS._replace(key="other")))


@pytest.mark.parametrize("name", LAWS)
@pytest.mark.parametrize(
    "others", [{}, {"jitter": NORMAL_JITTER}, {"jitter": {"kind": "uniform", "half_width_ms": 3}}]
)
def test_the_head_of_a_block_is_its_beginning_bit_for_bit(name: str, others: dict[str, Any]) -> None:
    blocks = delay_blocks(stages(LAWS[name].part, **others), ADDRESS, {})
    for number, n in ((0, HEAD), (0, 1), (5, HEAD)):
        assert blocks.block(number, n).tolist() == blocks.block(number)[:n].tolist()
