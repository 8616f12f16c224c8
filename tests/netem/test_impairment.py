from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from common.scenario.network import TimelineEntry
from netem.impairment import Impairment
from netem.outage import Outages
from tests.netem.making import KEY, pipeline

LOSS = {"kind": "bernoulli", "p_loss": 0.2}
DELAY = {"kind": "normal", "mean_ms": 5, "std_ms": 4}
JITTER = {"kind": "uniform", "half_width_ms": 3}
FULL: dict[str, Any] = {"loss": LOSS, "delay": DELAY, "jitter": JITTER}


def _impairment(seed: int = 7, key: str = KEY, **stages: Any) -> Impairment:
    return Impairment(pipeline(**stages), seed, "forward", key)


def _live(impairment: Impairment, seqs: list[int]) -> list[tuple[str, int]]:
    return [impairment.decide(seq, 0) for seq in seqs]


def _vectorised(impairment: Impairment, seqs: list[int]) -> list[tuple[str, int]]:
    lost, delay_ns = impairment.decide_many(np.array(seqs, dtype=np.int64))
    pairs = zip(lost.tolist(), delay_ns.tolist(), strict=True)
    return [("loss", 0) if gone else ("deliver", ns) for gone, ns in pairs]


def test_live_path_is_the_vectorised_path() -> None:
    seqs = list(range(20_000))
    live = _live(_impairment(**FULL), seqs)
    assert live == _vectorised(_impairment(**FULL), seqs)
    assert {outcome for outcome, _ in live} == {"deliver", "loss"}
    assert len({ns for _, ns in live}) > 15_000


@settings(deadline=None, max_examples=30)
@given(st.lists(st.one_of(st.integers(0, 40_000), st.integers(0, 2**32 - 1)), max_size=12))
def test_order_and_repetition_of_packets_do_not_matter(seqs: list[int]) -> None:
    impairment = _impairment(**FULL)
    assert _live(impairment, seqs) == _vectorised(_impairment(**FULL), seqs)
    assert _live(impairment, seqs[::-1]) == _live(impairment, seqs)[::-1]


def test_same_seed_same_bytes_other_seed_other_bytes() -> None:
    seqs = np.arange(10_000)
    first, again, other = (_impairment(seed, **FULL).decide_many(seqs) for seed in (7, 7, 8))
    for a, b, c in zip(first, again, other, strict=True):
        assert a.tobytes() == b.tobytes()
        assert a.tobytes() != c.tobytes()


def test_stages_do_not_shift_each_other() -> None:
    seqs = np.arange(10_000)
    full = _impairment(**FULL).decide_many(seqs)
    without_loss = _impairment(delay=DELAY, jitter=JITTER).decide_many(seqs)
    without_delay = _impairment(loss=LOSS).decide_many(seqs)
    assert (full.delay_ns == without_loss.delay_ns).all()
    assert (full.lost == without_delay.lost).all()
    without_jitter = _impairment(delay=DELAY).decide_many(seqs)
    deviation_ns = full.delay_ns - without_jitter.delay_ns
    assert np.abs(deviation_ns).max() <= 3_000_001
    assert deviation_ns.std() > 1_000_000


def test_keys_directions_and_stages_are_independent() -> None:
    uniform = {"delay": {"kind": "uniform", "low_ms": 0, "high_ms": 1}, "loss": LOSS}
    seqs = np.arange(100_000)
    ours = Impairment(pipeline(**uniform), 7, "forward", KEY).decide_many(seqs)
    others = [
        Impairment(pipeline(**uniform), 7, "forward", "tis/MTMR/measured_cp").decide_many(seqs),
        Impairment(pipeline(**uniform), 7, "feedback", KEY).decide_many(seqs),
    ]
    four_standard_errors = 4 / np.sqrt(len(seqs))
    for other in others:
        assert abs(np.corrcoef(ours.delay_ns, other.delay_ns)[0, 1]) < four_standard_errors
    assert abs(np.corrcoef(ours.delay_ns, ours.lost)[0, 1]) < four_standard_errors


def test_an_outage_takes_every_packet_and_only_while_it_lasts() -> None:
    entry = TimelineEntry.model_validate({"at_s": 2, "for_s": 1, "set": {"outage": True}})
    outages = Outages.of_timeline([entry], "forward")
    with_outage = Impairment(pipeline(**FULL), 7, "forward", KEY, outages)
    without = _impairment(**FULL)
    for seq in range(200):
        assert with_outage.decide(seq, 1_999_999_999) == without.decide(seq, 0)
        assert with_outage.decide(seq, 2_000_000_000) == ("outage", 0)
        assert with_outage.decide(seq, 2_999_999_999) == ("outage", 0)
        assert with_outage.decide(seq, 3_000_000_000) == without.decide(seq, 0)


def test_an_empty_pipeline_passes_everything_at_once() -> None:
    assert _live(_impairment(), [0, 1, 5000]) == [("deliver", 0)] * 3


def test_no_packets_no_draws() -> None:
    lost, delay_ns = _impairment(**FULL).decide_many(np.empty(0, dtype=np.int64))
    assert lost.shape == delay_ns.shape == (0,)


@pytest.mark.parametrize("p_loss", [0.01, 0.2])
def test_share_of_loss_through_the_whole_path(p_loss: float) -> None:
    n = 200_000
    lost, _ = _impairment(loss={"kind": "bernoulli", "p_loss": p_loss}).decide_many(np.arange(n))
    assert abs(lost.mean() - p_loss) <= 4 * np.sqrt(p_loss * (1 - p_loss) / n)
