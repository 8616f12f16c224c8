"""A rate and its queue found again in waits that Lindley's recursion makes, and none in other records."""

import numpy as np
import pytest

from tests.netem.fit.synthetic_records import Parameters, record
from tis.common.scenario.network import NetworkPart
from tis.common.trace import LOST, Trace
from tis.netem.fit.backlogs import MESSAGE_BYTES, find_backlogs
from tis.netem.fit.candidates import with_backlogs
from tis.netem.fit.closure import closures, replays
from tis.netem.fit.record import DirectionRecord

RATE_HZ = 100
OWN_KBIT_S = MESSAGE_BYTES * 8 * RATE_HZ / 1000


def _queued(own: float, load: float, on_s: float, off_s: float, most_ms: float, seconds: float = 600.0) -> Trace:
    """Return the waits of a fluid queue: shares of the rate that the record's messages and the others' need."""
    rng = np.random.default_rng(2)
    n = int(seconds * RATE_HZ)
    on, at = np.zeros(n, dtype=bool), 0.0
    while at < seconds:
        at += rng.exponential(off_s)
        length_s = rng.exponential(on_s)
        on[int(at * RATE_HZ) : int((at + length_s) * RATE_HZ)] = True
        at += length_s
    wait, waits, lost = 0.0, np.zeros(n), np.zeros(n, dtype=bool)
    for k in range(n):
        wait = max(0.0, wait + (own + load * on[k] - 1.0) / RATE_HZ)
        full = wait > most_ms / 1000
        wait = min(wait, most_ms / 1000)
        lost[k] = full and rng.random() < 1 - 1 / (own + load)
        waits[k] = wait
    delay_ms = 15 + 1000 * waits + rng.normal(0, 0.3, n)
    sent_ns = (np.arange(n) * 1e9 / RATE_HZ).astype(np.int64)
    return Trace("queued", sent_ns, np.where(lost, LOST, np.rint(delay_ms * 1e6).astype(np.int64)))


@pytest.mark.parametrize(("own", "load"), [(0.3, 1.2), (0.1, 1.4), (0.5, 0.8)])
def test_rate_load_and_queue_are_found(own: float, load: float) -> None:
    found = find_backlogs(_queued(own, load, on_s=1.5, off_s=5.0, most_ms=200.0))
    assert found is not None
    assert found.n > 30
    assert found.rising == pytest.approx(own + load - 1, rel=0.1)
    assert found.falling == pytest.approx(1 - own, rel=0.05)
    assert found.stage["kbit_s"] == pytest.approx(OWN_KBIT_S / own, rel=0.15)
    assert found.stage["cross"]["kbit_s"] == pytest.approx(load / own * OWN_KBIT_S, rel=0.15)
    NetworkPart.model_validate({"forward": {"rate": found.stage}})


def test_backlogs_that_all_end_at_a_full_queue_tell_its_length() -> None:
    found = find_backlogs(_queued(0.3, 1.7, on_s=2.0, off_s=6.0, most_ms=80.0))
    assert found is not None
    assert found.highest_ms == pytest.approx(80, rel=0.05)
    n_own, n_cross = (
        OWN_KBIT_S / MESSAGE_BYTES,
        found.stage["cross"]["kbit_s"] / found.stage["cross"]["message_bytes"],
    )
    mean_bytes = (OWN_KBIT_S + found.stage["cross"]["kbit_s"]) / (n_own + n_cross)
    queue_ms = found.stage["queue"]["max_packets"] * mean_bytes * 8 / found.stage["kbit_s"]
    assert queue_ms == pytest.approx(80, rel=0.05)


@pytest.mark.parametrize("name", ["bursts", "outages", "bad_states", "stalls"])
def test_other_records_have_no_backlogs(name: str) -> None:
    assert find_backlogs(record(name, Parameters(), 3)) is None


def _packets(seconds: float, rate_kbit_s: float, load: float, max_packets: int) -> Trace:
    """Return a record behind a queue of packets, message by message; the others' come at random instants while on."""
    rng = np.random.default_rng(4)
    arrivals = [(k / RATE_HZ, MESSAGE_BYTES, k) for k in range(int(seconds * RATE_HZ))]
    at, gap_s = 0.0, 600 * 8 / (load * rate_kbit_s * 1000)
    while at < seconds:
        at += rng.exponential(6.0)
        end = at + rng.exponential(2.0)
        instants = at + np.cumsum(rng.exponential(gap_s, int(3 * (end - at) / gap_s) + 50))
        arrivals += [(float(instant), 600, -1) for instant in instants if instant < min(end, seconds)]
        at = end
    ends: list[float] = []
    delay_ns, free_s = np.full(int(seconds * RATE_HZ), LOST, dtype=np.int64), 0.0
    for now, n_bytes, number in sorted(arrivals):
        ends = [end for end in ends if end > now]
        if len(ends) < max_packets:
            free_s = max(now, free_s) + n_bytes * 8 / (rate_kbit_s * 1000)
            ends.append(free_s)
            if number >= 0:
                delay_ns[number] = round((free_s - now + 0.015 + rng.normal(0, 0.0002)) * 1e9)
    return Trace("packets", (np.arange(len(delay_ns)) * 1e9 / RATE_HZ).astype(np.int64), delay_ns)


def test_replays_of_the_fit_wait_as_the_record_does() -> None:
    trace = _packets(200.0, 1000.0, 1.2, 40)
    fit = with_backlogs(DirectionRecord.of(trace), None)
    assert fit is not None
    assert fit.stages["rate"]["kbit_s"] == pytest.approx(1000, rel=0.15)
    compared = closures(trace, replays(fit.network("forward"), trace, 10, ordered=True))
    close = {one.name: one.mean / one.record for one in compared}
    for name in ("mean delay, ms", "p5, ms", "p50, ms", "p95, ms", "p99, ms", "autocorrelation at 0.1 s"):
        assert close[name] == pytest.approx(1, abs=0.2)


def test_a_record_that_is_too_long_to_be_replayed_has_none() -> None:
    assert find_backlogs(_queued(0.3, 1.2, on_s=1.5, off_s=5.0, most_ms=200.0, seconds=900.0)) is not None
    assert find_backlogs(_queued(0.3, 1.2, on_s=1.5, off_s=5.0, most_ms=200.0, seconds=1200.0)) is None
