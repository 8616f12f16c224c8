"""Jitter and loss of tc-netem's published algorithm, beside the loss of this emulator for the same request."""

from math import sqrt

import numpy as np
import pytest

from tis.common.scenario.network.loss import BurstLoss
from tis.common.streams import Address, Stream
from tis.deploy.bench.models import correlated_uniforms, jitter, loss_with_correlation
from tis.netem.stages.loss import loss_blocks

N = 400_000
U = np.random.default_rng(2).random(N)
N_PACKETS = 2_000_000
LOSS_U = Stream.named(11, "tc").uniforms(0, N_PACKETS + 1)


def _neighbours(x: np.ndarray) -> float:
    return float(np.corrcoef(x[1:], x[:-1])[0, 1])


def test_the_recipe_by_hand() -> None:
    x = correlated_uniforms(np.array([0.8, 0.4, 0.0]), 0.25)
    np.testing.assert_allclose(x, [0.8, 0.75 * 0.4 + 0.25 * 0.8, 0.25 * 0.5])
    assert correlated_uniforms(np.array([]), 0.25).tolist() == []


@pytest.mark.parametrize("rho", [0.0, 0.25, 0.9])
def test_mixing_uniforms_shrinks_their_spread_and_correlates_them(rho: float) -> None:
    x = correlated_uniforms(U, rho)
    assert x.std() * sqrt(12) == pytest.approx(sqrt((1 - rho) / (1 + rho)), rel=0.01)
    assert x.mean() == pytest.approx(0.5, abs=0.01)
    assert _neighbours(x) == pytest.approx(rho, abs=0.01)


@pytest.mark.parametrize("rho", [0.0, 0.25, 0.9])
@pytest.mark.parametrize("jitter_ms", [1, 10])
def test_its_jitter_is_the_one_asked_for_and_its_correlation_is_gone(rho: float, jitter_ms: int) -> None:
    delay_ns = jitter(50_000_000, jitter_ms * 1_000_000, correlated_uniforms(U, rho))
    assert delay_ns.std() / (jitter_ms * 1e6 / sqrt(3)) == pytest.approx(1, abs=0.01)
    assert abs(delay_ns - 50_000_000).max() <= jitter_ms * 1_000_000
    assert _neighbours(delay_ns) == pytest.approx(0, abs=0.01)


def test_its_jitter_is_that_of_whole_32_bit_numbers() -> None:
    """The kernel's own steps in integers: mix, keep, reduce."""
    rho, sigma, mu, last = round(0.25 * 2**32), 3_000_000, 20_000_000, int(U[0] * 2**32)
    found = [last % (2 * sigma) + mu - sigma]
    for u in U[1:50_000]:
        last = (int(u * 2**32) * (2**32 - rho) + last * rho) >> 32
        found.append(last % (2 * sigma) + mu - sigma)
    ours = jitter(mu, sigma, correlated_uniforms(U[:50_000], 0.25))
    # whole numbers lose less than one step in each mixture, which counts where the remainder wraps around
    assert np.mean(np.abs(ours - np.array(found)) <= 2) > 0.9999
    assert np.std(found) / (sigma / sqrt(3)) == pytest.approx(1, abs=0.01)


def test_its_own_example_drops_nothing() -> None:
    assert loss_with_correlation(N_PACKETS, 0.003, 0.25, LOSS_U).sum() == 0


def test_5_percent_at_25_percent_drops_a_twenty_fifth_of_it() -> None:
    assert 100 * loss_with_correlation(N_PACKETS, 0.05, 0.25, LOSS_U).mean() == pytest.approx(0.19, abs=0.02)


def test_without_correlation_it_drops_what_was_asked_for() -> None:
    lost = loss_with_correlation(N_PACKETS, 0.05, 0.0, LOSS_U)
    assert (lost == (LOSS_U[1:] < 0.05)).all()


@pytest.mark.parametrize("p", [0.003, 0.05])
def test_here_the_share_is_kept_whatever_the_correlation(p: float) -> None:
    # neighbours correlated by 25 %: 1 - p - r = 0.25 with p = r L / (1 - L), so r = 0.75 (1 - L)
    part = BurstLoss(kind="burst", p_loss=p, mean_burst=1 / (0.75 * (1 - p)))
    blocks = loss_blocks(part, Address(1, "forward", "k"), {})
    lost = np.concatenate([blocks.block(number) for number in range(N_PACKETS // 4096)])
    standard_error = np.sqrt(p * (1 - p) * 1.25 / 0.75 / len(lost))
    assert abs(lost.mean() - p) <= 4 * standard_error
    assert np.corrcoef(lost[:-1], lost[1:])[0, 1] == pytest.approx(0.25, abs=0.03)


@pytest.mark.parametrize("rho", [0.0, 0.25, 0.9])
def test_the_recursion_is_that_of_32_bit_integers(rho: float) -> None:
    p, rho_32 = round(0.2 * 2**32), round(rho * 2**32)
    last, lost = int(LOSS_U[0] * 2**32), []
    for u in LOSS_U[1:2001]:
        last = ((2**32 - rho_32) * int(u * 2**32) + rho_32 * last) >> 32
        lost.append(last < p)
    assert loss_with_correlation(2000, 0.2, rho, LOSS_U[:2001]).tolist() == lost


def test_too_few_uniforms_are_refused() -> None:
    with pytest.raises(ValueError, match="n \\+ 1"):
        loss_with_correlation(10, 0.1, 0.1, LOSS_U[:10])
