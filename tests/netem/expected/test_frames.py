"""Shares of lost and decodable frames against closed forms and netem's own draws, and who waits behind a frame."""

import numpy as np
import pytest

from tests.netem.expected.sight_evidence import BURSTS, IID, STREAMS, Part, frames, waited
from tis.common.scenario.network import NetworkPart
from tis.common.scenario.network.loss import Loss
from tis.netem.expected.frames import frame_shares, transmission_ns


def loss(**part: object) -> Loss | None:
    return NetworkPart.model_validate({"forward": {"loss": part}}).forward.loss


@pytest.mark.parametrize(("q", "share"), [(0.01, 0.859), (0.05, 0.497), (0.1, 0.287)])
def test_equal_frames_have_the_closed_form(q: float, share: float) -> None:
    p = 1 - (1 - q) ** (1 / 7)  # each frame of seven packets is lost with q
    found = frame_shares(loss(kind="bernoulli", p_loss=p), [7] * 30, [True] + [False] * 29)
    assert found.lost == pytest.approx(q, rel=1e-9)
    assert found.decodable == pytest.approx((1 - q) * (1 - (1 - q) ** 30) / (30 * q), rel=1e-9)
    assert found.decodable == pytest.approx(share, abs=5e-4)


def test_key_frames_may_be_larger_than_others() -> None:
    p, n_key, n_other, every = 0.01, 19, 2, 12
    found = frame_shares(loss(kind="bernoulli", p_loss=p), [n_key] + [n_other] * 11, [True] + [False] * 11)
    q_key, q_other = (1 - (1 - p) ** n for n in (n_key, n_other))
    assert found.decodable == pytest.approx((1 - q_key) * sum((1 - q_other) ** j for j in range(every)) / every)
    assert found.lost == pytest.approx((q_key + 11 * q_other) / 12)


def test_bursts_have_gilbert_and_elliotts_matrices() -> None:
    a, r, bad, good = 0.002, 0.3, 0.8, 0.0005
    step, pi = np.array([[1 - a, a], [r, 1 - r]]), np.array([r, a]) / (a + r)
    arrives = np.diag([1 - good, 1 - bad])

    def survival(n: int) -> float:
        return float(pi @ arrives @ np.linalg.matrix_power(step @ arrives, n - 1) @ np.ones(2))

    part = loss(kind="gilbert_elliott", p_bad=a, p_good=r, p_loss_bad=bad, p_loss_good=good)
    found = frame_shares(part, [9, 2, 2], [True, False, False])
    assert found.lost == pytest.approx(1 - (survival(9) + 2 * survival(2)) / 3)
    assert found.decodable == pytest.approx((survival(9) + survival(11) + survival(13)) / 3)


@pytest.mark.parametrize(("part", "stream"), [(IID[2], "equal"), (BURSTS[0], "unequal")])
def test_netems_draws_keep_to_theory(part: Part, stream: str) -> None:
    assert stream in STREAMS
    for share in frames(part, stream, 3000):
        assert share.holds, share


def test_without_loss_all_frames_decode_and_a_recorded_loss_has_no_theory() -> None:
    assert frame_shares(None, [3, 1], [True, False]) == (0.0, 1.0)
    with pytest.raises(ValueError, match="recorded"):
        frame_shares(loss(kind="trace", path="losses.csv"), [1], [True])
    with pytest.raises(ValueError, match="key frame"):
        frame_shares(None, [1], [False])


@pytest.mark.parametrize(("n_bytes", "ms"), [(22_100, 17.68), (8300, 6.64)])
def test_a_frame_occupies_a_rate(n_bytes: int, ms: float) -> None:
    assert transmission_ns(n_bytes, 19, 10_000) == pytest.approx(ms * 1e6)
    assert transmission_ns(n_bytes, 19, 10_000, 50) == pytest.approx(ms * 1e6 + 19 * 50 * 800)


def test_a_force_waits_for_a_whole_frame_and_ruled_apart_not_at_all() -> None:
    found = waited(8300, 1200, 10_000, apart=False, overhead=46, n_frames=60)
    assert found.longest_ns == pytest.approx(found.theory_ns, rel=0.01)
    assert waited(8300, 1200, 10_000, apart=True, n_frames=60).longest_ns == 0
