from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.netem.making import KEY, pipeline
from tis.common.streams import Address
from tis.netem.stages.loss import expected_loss
from tis.netem.stages.pipeline_draws import Draw, Draws

LOSS = {"kind": "bernoulli", "p_loss": 0.2}
BURSTS = {"kind": "burst", "p_loss": 0.2, "mean_burst": 4}
DELAY = {"kind": "normal", "mean_ms": 5, "std_ms": 4}
JITTER = {"kind": "uniform", "half_width_ms": 3}
FULL: dict[str, Any] = {"loss": LOSS, "delay": DELAY, "jitter": JITTER}
MISHAPS: dict[str, Any] = {
    "duplicate": {"p_duplicate": 0.1},
    "corrupt": {"p_corrupt": 0.1, "bits": 3},
    "reorder": {"p_reorder": 0.1, "early_ms": 1},
    "ordering": "reorder",
}
EVERYTHING: list[dict[str, Any]] = [
    {},
    FULL,
    {**FULL, **MISHAPS, "loss": BURSTS, "correlation": {"half_life_s": 0.05}},
    {**MISHAPS, "delay": {"kind": "constant", "delay_ms": 2}, "loss": {**BURSTS, "mtu_bytes": 100}},
]


def _draws(seed: int = 7, key: str = KEY, **stages: Any) -> Draws:
    return Draws(pipeline(**stages), Address(seed, "forward", key), {})


def _live(draws: Draws, seqs: list[int], cells: list[int], n_bytes: int = 256) -> list[Draw | None]:
    return [draws.decide(seq, cell, n_bytes) for seq, cell in zip(seqs, cells, strict=True)]


def _vectorised(draws: Draws, seqs: list[int], cells: list[int], n_bytes: int = 256) -> list[Draw | None]:
    many = draws.decide_many(np.array(seqs, dtype=np.int64), np.array(cells, dtype=np.int64), n_bytes)
    rows = zip(*(column.tolist() for column in many), strict=True)
    return [
        None if lost else Draw(delay_ns, copy_ns if copy_ns >= 0 else None, n_flips)
        for lost, delay_ns, copy_ns, n_flips in rows
    ]


@pytest.mark.parametrize("stages", EVERYTHING)
def test_live_path_is_the_vectorised_path(stages: dict[str, Any]) -> None:
    seqs = list(range(9_000))
    cells = [seq * 33 + seq % 3 for seq in seqs]
    assert _live(_draws(**stages), seqs, cells) == _vectorised(_draws(**stages), seqs, cells)


def test_everything_that_was_asked_for_happens() -> None:
    seqs = list(range(20_000))
    live = _live(_draws(**EVERYTHING[2]), seqs, seqs)
    assert 0.15 < sum(draw is None for draw in live) / len(seqs) < 0.25
    there = [draw for draw in live if draw is not None]
    for share in (sum(d.copy_delay_ns is not None for d in there), sum(d.n_flips == 3 for d in there)):
        assert abs(share / len(there) - 0.1) < 0.01
    assert {d.n_flips for d in there} == {0, 3}


@settings(deadline=None, max_examples=25)
@given(
    st.sampled_from(EVERYTHING),
    st.lists(
        st.tuples(st.one_of(st.integers(0, 40_000), st.integers(0, 2**32 - 1)), st.integers(0, 50_000)), max_size=12
    ),
)
def test_order_and_repetition_of_packets_do_not_matter(
    stages: dict[str, Any], packets: list[tuple[int, int]]
) -> None:
    seqs, cells = [seq for seq, _ in packets], [cell for _, cell in packets]
    draws = _draws(**stages)
    live = _live(draws, seqs, cells)
    assert live == _vectorised(_draws(**stages), seqs, cells)
    assert _live(draws, seqs[::-1], cells[::-1]) == live[::-1]


def test_same_seed_same_bytes_other_seed_other_bytes() -> None:
    seqs = np.arange(10_000)
    first, again, other = (_draws(seed, **EVERYTHING[2]).decide_many(seqs, seqs, 256) for seed in (7, 7, 8))
    for a, b, c in zip(first, again, other, strict=True):
        assert a.tobytes() == b.tobytes()
        assert a.tobytes() != c.tobytes()


def test_stages_do_not_shift_each_other() -> None:
    seqs = np.arange(10_000)
    full = _draws(**FULL).decide_many(seqs, seqs, 256)
    without_loss = _draws(delay=DELAY, jitter=JITTER).decide_many(seqs, seqs, 256)
    without_delay = _draws(loss=LOSS).decide_many(seqs, seqs, 256)
    with_mishaps = _draws(**(FULL | MISHAPS | {"reorder": None})).decide_many(seqs, seqs, 256)
    assert (full.delay_ns == without_loss.delay_ns).all()
    assert (full.lost == without_delay.lost).all()
    assert (full.delay_ns == with_mishaps.delay_ns).all()
    assert (full.lost == with_mishaps.lost).all()
    deviation_ns = full.delay_ns - _draws(delay=DELAY).decide_many(seqs, seqs, 256).delay_ns
    assert np.abs(deviation_ns).max() <= 3_000_001
    assert deviation_ns.std() > 1_000_000


def test_keys_directions_stages_and_copies_are_independent() -> None:
    stages: dict[str, Any] = {
        "delay": {"kind": "uniform", "low_ms": 0, "high_ms": 1},
        "loss": LOSS,
        "duplicate": {"p_duplicate": 1},
    }
    seqs = np.arange(100_000)
    ours = _draws(**stages).decide_many(seqs, seqs, 256)
    others = [
        _draws(key="tis/MTMR/measured_cp", **stages).decide_many(seqs, seqs, 256),
        Draws(pipeline(**stages), Address(7, "feedback", KEY), {}).decide_many(seqs, seqs, 256),
    ]
    four_standard_errors = 4 / np.sqrt(len(seqs))
    for other in others:
        assert abs(np.corrcoef(ours.delay_ns, other.delay_ns)[0, 1]) < four_standard_errors
    assert abs(np.corrcoef(ours.delay_ns, ours.lost)[0, 1]) < four_standard_errors
    assert abs(np.corrcoef(ours.delay_ns, ours.copy_delay_ns)[0, 1]) < four_standard_errors


@pytest.mark.parametrize(("n_bytes", "n_parts"), [(0, 1), (100, 1), (101, 2), (200, 2), (1000, 10)])
def test_a_message_is_lost_when_one_of_its_packets_is(n_bytes: int, n_parts: int) -> None:
    draws = _draws(loss=LOSS | {"mtu_bytes": 100})
    seqs = np.arange(100_000)
    lost = draws.decide_many(seqs, seqs, n_bytes).lost
    expected = 1 - 0.8**n_parts
    assert draws.n_parts(n_bytes) == n_parts
    assert abs(lost.mean() - expected) <= 4 * np.sqrt(expected * (1 - expected) / len(seqs))


@pytest.mark.parametrize(
    "model",
    [
        {"kind": "burst", "p_loss": 0.05, "mean_burst": 9},
        {"kind": "gilbert_elliott", "p_bad": 0.02, "p_good": 0.2, "p_loss_bad": 0.3, "p_loss_good": 0.001},
        {"kind": "four_state", "p13": 0.05, "p31": 0.4, "p32": 0.3, "p23": 0.5, "p14": 0.02},
        {"kind": "pareto_runs", "received": {"shape": 3, "scale": 50}, "lost": {"shape": 6, "scale": 4}},
        {
            "kind": "gilbert_pareto", "p_bad": 0.05, "p_good": 0.1,
            "good": {"shape": 9, "scale": 2}, "bad": {"shape": 8, "scale": 4},
        },
    ],
)  # fmt: skip
def test_a_model_with_memory_runs_through_the_packets_of_messages(model: dict[str, Any]) -> None:
    """5 MB in packets of 1500 bytes meet many bursts; so do ten packets, now and then."""
    n_messages = 60_000
    seqs = np.arange(n_messages)
    draws = _draws(loss=model | {"mtu_bytes": 1500})
    part = pipeline(loss=model).loss
    for n_bytes, n_packets in ((1500, 1), (15_000, 10)):
        lost = draws.decide_many(seqs, seqs, n_bytes).lost
        expected = expected_loss(part, {}, n_packets)
        n_runs = int((lost[1:] & ~lost[:-1]).sum()) + int(lost[0])
        deviation = 5 * np.sqrt(expected.p_loss * 2 * 9 / n_messages)  # runs inflate the variance
        assert abs(lost.mean() - expected.p_loss) <= deviation
        assert lost.sum() / n_runs == pytest.approx(expected.mean_burst, rel=0.15)
    assert [draws.decide(seq, 0, 15_000) is None for seq in range(500)] == lost[:500].tolist()
    assert sum(draws.decide(seq, 0, 5_000_000) is None for seq in range(20)) == 20


def test_an_overtaking_message_skips_its_delay_or_a_part_of_it() -> None:
    stages: dict[str, Any] = {"delay": {"kind": "constant", "delay_ms": 5}, "ordering": "reorder"}
    seqs = np.arange(10_000)
    for early_ms, left_ns in ((None, 0), (2, 3_000_000), (9, 0)):
        draws = _draws(**stages, reorder={"p_reorder": 0.25, "early_ms": early_ms})
        delay_ns = draws.decide_many(seqs, seqs, 256).delay_ns
        assert set(np.unique(delay_ns).tolist()) == {left_ns, 5_000_000}
        assert abs((delay_ns == left_ns).mean() - 0.25) < 0.02


def test_an_empty_pipeline_passes_everything_at_once() -> None:
    assert _live(_draws(), [0, 1, 5000], [0, 0, 0]) == [Draw(0)] * 3


def test_no_packets_no_draws() -> None:
    none = np.empty(0, dtype=np.int64)
    assert [column.shape for column in _draws(**EVERYTHING[2]).decide_many(none, none, 256)] == [(0,)] * 4


def test_pipelines_share_the_columns_of_equal_stages_and_nothing_else() -> None:
    seqs = list(range(5_000))
    one = _draws(**EVERYTHING[2])
    for other in (EVERYTHING[2], {**EVERYTHING[2], "loss": LOSS}, {**EVERYTHING[2], "jitter": None}, FULL):
        sharing, plain = _draws(**other), _draws(**other)
        sharing.share(one)
        assert _live(sharing, seqs, seqs) == _live(plain, seqs, seqs)
        assert (sharing._losses is one._losses) == (other["loss"] == BURSTS)


def test_the_next_blocks_are_deferred_draws() -> None:
    deferred: list[Any] = []
    draws = Draws(pipeline(**FULL), Address(7, "forward", KEY), {}, deferred)
    plain = _draws(**FULL)
    for seq in (*range(5), *range(4090, 4100)):
        while deferred:
            deferred.pop()()
        assert draws.decide(seq, 0, 256) == plain.decide(seq, 0, 256)
