"""What tc-netem's published algorithm loses, beside what this emulator loses when asked for the same share."""

import numpy as np
import pytest

from common.scenario.network.loss import BurstLoss
from common.streams import Address, Stream
from deploy.bench.tc_netem_loss import loss_with_correlation
from netem.stages.loss import loss_blocks

N = 2_000_000
U = Stream.named(11, "tc").uniforms(0, N + 1)


def test_its_own_example_drops_nothing() -> None:
    assert loss_with_correlation(N, 0.003, 0.25, U).sum() == 0


def test_5_percent_at_25_percent_drops_a_twenty_fifth_of_it() -> None:
    assert 100 * loss_with_correlation(N, 0.05, 0.25, U).mean() == pytest.approx(0.19, abs=0.02)


def test_without_correlation_it_drops_what_was_asked_for() -> None:
    lost = loss_with_correlation(N, 0.05, 0.0, U)
    assert (lost == (U[1:] < 0.05)).all()


@pytest.mark.parametrize("p", [0.003, 0.05])
def test_here_the_share_is_kept_whatever_the_correlation(p: float) -> None:
    # neighbours correlated by 25 %: 1 - p - r = 0.25 with p = r L / (1 - L), so r = 0.75 (1 - L)
    part = BurstLoss(kind="burst", p_loss=p, mean_burst=1 / (0.75 * (1 - p)))
    blocks = loss_blocks(part, Address(1, "forward", "k"), {})
    lost = np.concatenate([blocks.block(number) for number in range(N // 4096)])
    standard_error = np.sqrt(p * (1 - p) * 1.25 / 0.75 / len(lost))
    assert abs(lost.mean() - p) <= 4 * standard_error
    assert np.corrcoef(lost[:-1], lost[1:])[0, 1] == pytest.approx(0.25, abs=0.03)


@pytest.mark.parametrize("rho", [0.0, 0.25, 0.9])
def test_the_recursion_is_that_of_32_bit_integers(rho: float) -> None:
    p, rho_32 = round(0.2 * 2**32), round(rho * 2**32)
    last, lost = int(U[0] * 2**32), []
    for u in U[1:2001]:
        last = ((2**32 - rho_32) * int(u * 2**32) + rho_32 * last) >> 32
        lost.append(last < p)
    assert loss_with_correlation(2000, 0.2, rho, U[:2001]).tolist() == lost


def test_too_few_uniforms_are_refused() -> None:
    with pytest.raises(ValueError, match="n \\+ 1"):
        loss_with_correlation(10, 0.1, 0.1, U[:10])
