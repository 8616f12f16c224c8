import numpy as np
import pytest
from scipy import stats

from common.scenario import network
from common.streams import Stream
from netem.loss import BernoulliLoss, build_loss

N = 1_000_000
U = Stream.named(3, "forward/tis/MTML/measured_cp/loss").uniforms(0, N)


@pytest.mark.parametrize("p_loss", [0.0001, 0.01, 0.3, 0.5, 0.99])
def test_share_of_lost_packets_is_within_four_standard_errors(p_loss: float) -> None:
    lost = BernoulliLoss(p_loss).lost(U)
    assert abs(lost.mean() - p_loss) <= 4 * np.sqrt(p_loss * (1 - p_loss) / N)


def test_losses_do_not_remember_each_other() -> None:
    lost = BernoulliLoss(0.3).lost(U)
    # lengths of loss runs are geometric: P(run >= 1 + k) = 0.3^k
    edges = np.flatnonzero(np.diff(np.concatenate([[0], lost.astype(int), [0]])))
    runs = edges[1::2] - edges[::2]
    observed = np.bincount(np.minimum(runs, 8))[1:]
    law = np.append(0.7 * 0.3 ** np.arange(7), 0.3**7)
    assert stats.chisquare(observed, law * len(runs)).pvalue > 0.001


def test_certainties_are_exact() -> None:
    assert not BernoulliLoss(0.0).lost(U).any()
    assert BernoulliLoss(1.0).lost(U).all()
    assert not build_loss(None).lost(U).any()


def test_a_higher_probability_loses_the_same_packets_and_more() -> None:
    few, many = (build_loss(network.BernoulliLoss(kind="bernoulli", p_loss=p)).lost(U) for p in (0.01, 0.02))
    assert (many[few]).all()
    assert many.sum() > few.sum()
