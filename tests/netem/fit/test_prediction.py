"""Where further records of one network lie: of 40 each, and the statistics of tenths put together anew."""

import numpy as np
import pytest

from tests.netem.fit.synthetic_records import Parameters, record
from tis.common.streams import Stream
from tis.common.trace import Trace
from tis.netem.fit.candidates import fit_closing
from tis.netem.fit.prediction import between_shares, half_widths, interval, resampled, scaled
from tis.netem.fit.record import DirectionRecord
from tis.netem.fit.statistics import AUTOCORRELATIONS, HIGH, LONGEST, LOSS, NAMES, statistics_of

OF = Parameters(seconds=300, rate_hz=50)
SHORT = Parameters(seconds=120, rate_hz=25, step=7)
TRUTHS = ("stalls", "bad_states", "steps", "bufferbloat", "bursts")
N_FURTHER = 40


def inside(truth: str, of: Parameters, firsts: range, n_further: int) -> dict[str, list[tuple[float, bool]]]:
    """Return for each statistic the share of further records in the interval of each first one, and if it closes."""
    further = [record(truth, of, seed) for seed in range(1000, 1000 + n_further)]
    values = np.array([statistics_of(one.sent_ns, one.delay_ns) for one in further])
    found: dict[str, list[tuple[float, bool]]] = {}
    for seed in firsts:
        for one in fit_closing(DirectionRecord.of(record(truth, of, seed)), n=40).closures:
            column = values[:, NAMES.index(one.name)]
            share = float(((column >= one.low) & (column <= one.high)).mean())
            found.setdefault(one.name, []).append((share, one.closes))
    return found


def judged(found: dict[str, list[tuple[float, bool]]]) -> float:
    """Return the share inside, after the intervals that are not warned of held each statistic often enough."""
    for name, shares in found.items():
        closing = [share for share, closes in shares if closes]
        assert not closing or np.mean(closing) >= 34 / 40, name
    return float(np.mean([share for shares in found.values() for share, _ in shares]))


@pytest.mark.slow
def test_of_further_records_of_five_networks_95_in_100_lie_in_the_intervals() -> None:
    """Of each, eight records are fitted, and 40 further ones judged by each of their fits."""
    shares = [judged(inside(truth, OF, range(1, 9), N_FURTHER)) for truth in TRUTHS]
    assert 0.9 <= np.mean(shares) <= 0.99


@pytest.mark.parametrize("truth", ["bursts", "steps"])
def test_of_further_records_most_lie_in_the_intervals(truth: str) -> None:
    assert judged(inside(truth, SHORT, range(1, 4), 20)) >= 0.9


def test_tenths_put_together_message_by_message_have_the_same_statistics() -> None:
    """Oracle: the statistics of the joined tenths; across their joints there are no pairs, runs or neighbours."""
    trace = record("bad_states", Parameters(seconds=100, rate_hz=50), 3)
    part = np.minimum(trace.sent_ns * 10 // trace.sent_ns[-1], 9)
    uniforms = Stream.named(0, "fit/tenths").uniforms(0, 50)
    expected = []
    for chosen in (uniforms * 10).astype(int).reshape(5, 10):
        tenths = [(trace.sent_ns[part == k] - trace.sent_ns[part == k][0], trace.delay_ns[part == k]) for k in chosen]
        # apart by a minute in which nothing was sent, so that nothing reaches from one to the next
        sent_ns = np.concatenate([sent + number * 70_000_000_000 for number, (sent, _) in enumerate(tenths)])
        expected.append(statistics_of(sent_ns, np.concatenate([delay for _, delay in tenths])))
    found = resampled(trace, 5)
    for name in set(NAMES) - {AUTOCORRELATIONS[2]}:  # ten seconds are a tenth: there are no pairs
        place = NAMES.index(name)
        off = 0.1 if name in AUTOCORRELATIONS else 1.0 if name == HIGH else 0.0
        assert found[:, place] == pytest.approx(np.array(expected)[:, place], rel=0.02, abs=off), name


def test_an_interval_is_about_its_record_and_within_what_is_possible() -> None:
    assert interval(LOSS, 0.0, 0.5) == (0.0, 0.25)
    assert interval("p50, ms", 20.0, np.log(2)) == pytest.approx((10.0, 40.0))
    low, high = interval(AUTOCORRELATIONS[0], 0.9, 10.0)
    assert -1 <= low < 0.9 < high <= 1
    assert float(scaled(LONGEST, 9.0)) == 3.0


def test_a_model_that_spreads_too_far_counts_twice_the_record_at_most_but_for_extremes() -> None:
    rng = np.random.default_rng(1)
    record_, drawn = np.full(len(NAMES), 20.0), 20 + rng.normal(0, 0.1, (200, len(NAMES)))
    narrow, wide = (half_widths(record_, drawn, 20 + rng.normal(0, sd, (50, len(NAMES))), 100) for sd in (0.01, 5))
    median, longest = NAMES.index("p50, ms"), NAMES.index(LONGEST)
    assert wide[median] == pytest.approx(2 * narrow[median])
    assert wide[longest] > 20 * narrow[longest]


def test_a_median_between_two_regimes_may_be_in_either() -> None:
    """Of ten tenths six are all at 10 ms, and four at 20: the share below is 0.6 +- 0.65, by Student's t."""
    delay_ms = np.repeat([10, 20, 10, 20, 10, 10, 20, 10, 20, 10], 100)
    trace = Trace("t", np.arange(1000) * 20_000_000, delay_ms * 1_000_000)
    assert between_shares(trace)["p50, ms"] == (10.0, 20.0)
    assert between_shares(trace)["p5, ms"] == (10.0, 20.0)


def test_a_quantile_that_all_tenths_share_is_not_widened() -> None:
    trace = Trace("t", np.arange(1000) * 20_000_000, np.tile(np.arange(1, 101), 10) * 1_000_000)
    assert between_shares(trace)["p50, ms"] == pytest.approx((50.5, 50.5), abs=1.0)


def test_a_record_without_a_loss_does_not_exclude_a_run_of_one() -> None:
    trace = Trace("t", np.arange(3000) * 20_000_000, np.full(3000, 5_000_000))
    row = statistics_of(trace.sent_ns, trace.delay_ns)
    reach = dict(zip(NAMES, half_widths(row, resampled(trace), np.array([row, row]), 3000), strict=True))
    assert interval(LONGEST, 0.0, reach[LONGEST]) == (0.0, 1.0)
    assert interval(LOSS, 0.0, reach[LOSS]) == pytest.approx((0.0, 0.1))
