"""What is lost in the long run, against a walk by packets and against formulas of the literature."""

from math import inf

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.netem.stages.loss.making import big_chain, make
from tis.common.scenario.network import loss as network
from tis.netem.stages.loss import ExpectedLoss, expected_loss
from tis.netem.stages.loss.expected_loss import of_message

p = st.floats(0.01, 1.0)


def test_nothing_is_lost_without_a_model() -> None:
    assert expected_loss(None, {}) == ExpectedLoss(0.0, 0.0)
    assert expected_loss(make("bernoulli", p_loss=0), {}) == ExpectedLoss(0.0, 0.0)


def test_all_lost_is_one_endless_run() -> None:
    assert expected_loss(make("bernoulli", p_loss=1), {}) == ExpectedLoss(1.0, inf)
    both = make("gilbert_elliott", p_bad=0.3, p_good=0.6, p_loss_bad=1, p_loss_good=1)
    assert expected_loss(both, {}) == ExpectedLoss(1.0, inf)


@given(p_loss=st.floats(0.001, 0.6), mean_burst=st.floats(2, 2000))
def test_burst_is_what_was_asked_for(p_loss: float, mean_burst: float) -> None:
    got = expected_loss(make("burst", p_loss=p_loss, mean_burst=mean_burst), {})
    assert got == pytest.approx(ExpectedLoss(p_loss, mean_burst), rel=1e-9)


@given(p_bad=p, p_good=p, p_loss_bad=p, p_loss_good=st.floats(0, 0.9))
def test_gilbert_elliott(p_bad: float, p_good: float, p_loss_bad: float, p_loss_good: float) -> None:
    part = make(
        "gilbert_elliott", p_bad=p_bad, p_good=p_good, p_loss_bad=min(p_loss_bad, 0.99), p_loss_good=p_loss_good
    )
    chain = big_chain(part)
    assert expected_loss(part, {}) == pytest.approx((chain.p_loss(), chain.mean_burst()), rel=1e-6)


@given(p13=p, p14=p, p31=p, p32=p, p23=p)
def test_four_state(p13: float, p14: float, p31: float, p32: float, p23: float) -> None:
    part = make("four_state", p13=p13 / 2, p14=p14 / 2, p31=p31 / 2, p32=p32 / 2, p23=p23)
    assert isinstance(part, network.FourStateLoss)
    got, chain = expected_loss(part, {}), big_chain(part)
    assert got == pytest.approx((chain.p_loss(), chain.mean_burst()), rel=1e-6)
    # the balance of flows: 1 -> 4 alone, and into and out of the burst {2, 3}
    share_3 = part.p13 / part.p31
    shares = np.array([1, share_3 * part.p32 / part.p23, share_3, part.p14])
    assert got.p_loss == pytest.approx(shares[2:].sum() / shares.sum(), rel=1e-9)


def test_four_states_that_are_never_entered_lose_nothing() -> None:
    assert expected_loss(make("four_state", p13=0, p31=0), {}) == ExpectedLoss(0.0, 0.0)
    assert expected_loss(make("four_state", p13=0, p31=0, p14=1), {}) == ExpectedLoss(0.5, 1.0)


@given(
    p_bad=p, p_good=p, good=st.tuples(st.floats(8, 50), st.floats(0.001, 3)), bad=st.tuples(p, st.floats(0.001, 3))
)
def test_gilbert_pareto(p_bad: float, p_good: float, good: tuple[float, float], bad: tuple[float, float]) -> None:
    laws = {"good": {"shape": good[0], "scale": good[1]}, "bad": {"shape": 12 + bad[0], "scale": bad[1]}}
    part = make("gilbert_pareto", p_bad=p_bad, p_good=p_good, **laws)
    got, chain = expected_loss(part, {}), big_chain(part, longest=30)
    assert got.p_loss == pytest.approx(chain.p_loss(), rel=1e-4, abs=1e-9)
    if got.p_loss > 1e-6:
        assert got.mean_burst == pytest.approx(chain.mean_burst(), rel=1e-4)


def test_equal_states_leave_pareto_bursts_alone() -> None:
    law = {"shape": 3.5, "scale": 2.0}
    part = make("gilbert_pareto", p_bad=0.3, p_good=0.01, good=law, bad=law)
    at_least = (1 + np.arange(1, 10**6) / 2.0) ** -3.5
    mean = at_least.sum()
    assert expected_loss(part, {}) == pytest.approx((mean / (1 + mean), mean / at_least[0]), rel=1e-9)


def test_pareto_runs_by_their_sums() -> None:
    part = make("pareto_runs", received={"shape": 3, "scale": 50}, lost={"shape": 2.5, "scale": 4})
    k = np.arange(10**6)
    received, lost = ((1 + k / 50) ** -3.0).sum(), ((1 + k / 4) ** -2.5).sum()
    assert expected_loss(part, {}) == pytest.approx((lost / (received + lost), lost), rel=1e-6)


def test_a_message_of_many_packets_is_lost_with_any_of_them() -> None:
    assert of_message(0.01, 10) == pytest.approx(0.0956179, abs=1e-7)
    got = expected_loss(make("bernoulli", p_loss=0.01), {}, n_packets=10)
    assert got == pytest.approx((0.0956179, 1 / (1 - 0.0956179)), abs=1e-6)


_OF_PACKETS = {
    "burst": make("burst", p_loss=0.05, mean_burst=9),
    "gilbert_elliott": make("gilbert_elliott", p_bad=0.02, p_good=0.2, p_loss_bad=0.3, p_loss_good=0.001),
    "four_state": make("four_state", p13=0.05, p31=0.4, p32=0.3, p23=0.5, p14=0.02),
    "gilbert_pareto": make(
        "gilbert_pareto", p_bad=0.05, p_good=0.1, good={"shape": 9, "scale": 2}, bad={"shape": 8, "scale": 4}
    ),
}


@pytest.mark.parametrize("name", list(_OF_PACKETS))
@pytest.mark.parametrize("n_packets", [2, 3, 10, 40])
def test_losses_of_messages_are_those_of_the_packets_path(name: str, n_packets: int) -> None:
    """The oracle groups the model's packets, one by one: a message survives when all of its packets do."""
    chain = big_chain(_OF_PACKETS[name], longest=40)
    survives = np.diag(1 - chain.lost)  # the state says whether its packet is lost
    here = chain.stationary @ survives
    all_of_one = None
    for i in range(1, 2 * n_packets):
        all_of_one = float(here.sum()) if i == n_packets else all_of_one
        here = here @ chain.P @ survives
    assert all_of_one is not None
    p_loss, p_end = 1 - all_of_one, all_of_one - float(here.sum())
    got = expected_loss(_OF_PACKETS[name], {}, n_packets=n_packets)
    assert got == pytest.approx((p_loss, p_loss / p_end), rel=1e-4 if name == "gilbert_pareto" else 1e-9)


@pytest.mark.parametrize("n_packets", [2, 7, 300])
def test_messages_within_pareto_runs_by_their_sums(n_packets: int) -> None:
    part = make("pareto_runs", received={"shape": 3, "scale": 50}, lost={"shape": 2.5, "scale": 4})
    k = np.arange(3 * 10**6)
    received, lost = (1 + k / 50) ** -3.0, (1 + k / 4) ** -2.5  # P(run > k)
    survive = [received[n - 1 :].sum() / (received.sum() + lost.sum()) for n in (n_packets, 2 * n_packets)]
    got = expected_loss(part, {}, n_packets=n_packets)
    assert got == pytest.approx((1 - survive[0], (1 - survive[0]) / (survive[0] - survive[1])), rel=1e-5)


def test_rare_losses_of_many_packets_keep_their_digits() -> None:
    got = expected_loss(make("burst", p_loss=1e-12, mean_burst=2), {}, n_packets=1000)
    # a message meets a burst that begins in it (rate 5e-13 a packet) or the rest of one that began before
    assert got.p_loss == pytest.approx(1e-12 + 999 * 5e-13, rel=1e-6)


@pytest.mark.parametrize(
    "part",
    [
        make("gilbert_elliott", p_bad=1e-9, p_good=1e-9),
        make("gilbert_elliott", p_bad=1, p_good=1e-9),
        make("burst", p_loss=1e-300, mean_burst=1),
        make("four_state", p13=1e-300, p31=1e-9, p14=1e-300),
        make("pareto_runs", received={"shape": 1.0001, "scale": 1e6}, lost={"shape": 50, "scale": 0.001}),
        make("pareto_runs", received={"shape": 50, "scale": 1e6}, lost={"shape": 1.0001, "scale": 1e6}),
        make(
            "gilbert_pareto",
            p_bad=1e-9,
            p_good=1,
            good={"shape": 50, "scale": 1e6},
            bad={"shape": 1.0001, "scale": 0.001},
        ),
        make(
            "gilbert_pareto", p_bad=1, p_good=1, good={"shape": 1.01, "scale": 9}, bad={"shape": 50, "scale": 0.001}
        ),
    ],
)
def test_at_the_limits_of_the_parameters_it_is_a_share_and_a_length(part: network.Loss) -> None:
    p_loss, mean_burst = expected_loss(part, {})
    assert 0 <= p_loss <= 1
    assert mean_burst >= 1 or p_loss == 0
