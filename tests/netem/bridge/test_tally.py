import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.netem.making import link
from tis.common.node import Record
from tis.common.records import FATES, RELEASES, FateBatch, ReleaseBatch
from tis.common.units import NS_PER_MS, NS_PER_S
from tis.netem.bridge.tally import Realised, ReleaseErrors, Tally, WatchedLog, table
from tis.netem.bridge.watches import NamesWatch

ASKED = ("forward: delay 2 ms, sd 1", "feedback: nothing injected")
NOTHING = {"loss": 0, "outage": 0, "refused": 0, "overflow": 0, "queue_full": 0, "late": 0, "codel": 0, "evicted": 0}


@given(st.lists(st.integers(1, 10**10), min_size=1, max_size=200), st.sampled_from([0.5, 0.99, 1.0]))
def test_a_quantile_is_that_of_the_sorted_errors_within_a_bin(errors_ns: list[int], p: float) -> None:
    errors = ReleaseErrors()
    errors.add(np.array(errors_ns[::2], dtype=np.int64), np.array(errors_ns[::2], dtype=np.int64))
    errors.add(np.array(errors_ns[1::2], dtype=np.int64), np.array(errors_ns[1::2], dtype=np.int64))
    exact = sorted(errors_ns)[int(np.ceil(p * len(errors_ns))) - 1]
    assert exact <= errors.quantile_ns(p) * (1 + 1e-12)
    assert errors.quantile_ns(p) <= exact * 2.0 ** (1 / 32) * (1 + 1e-12)


def test_without_packets_it_is_0() -> None:
    assert ReleaseErrors().quantile_ns(0.5) == 0.0


def test_only_what_was_released_is_counted() -> None:
    tally = Tally(None, lambda _: None)
    batch = ReleaseBatch(
        direction="forward", key="a", seq=(0, 1, 2), copy_index=(0, 0, 0), offered_ns=(0, 0, 0),
        release_ns=(1000, 2000, 3000), released_ns=(1500, 0, 3100), departure=("released", "late", "released"),
        queued_ns=(0, 0, 0),
    )  # fmt: skip
    tally.record(Record(RELEASES, 0, batch))
    assert tally.errors["forward"].n == 2
    # a copy is released, too, but is no further message: the report's mean has none either
    tally.record(Record(RELEASES, 0, msgspec.structs.replace(batch, copy_index=(0, 0, 1))))
    assert tally.errors["forward"].n == 4
    assert tally.realised["forward"].n == 3
    assert tally.errors["forward"].most_ns == 500
    assert tally.errors["feedback"].n == 0


def test_the_table_says_what_was_counted() -> None:
    counters = {"before_epoch": 2, "leaks": 1}
    for direction, n in (("forward", 10), ("feedback", 5)):
        counters |= {f"{direction}.{name}": n for name in ("offered", "released", "held_at_end", "copied")}
        counters |= {f"{direction}.dropped.{cause}": n for cause in NOTHING}
    tally = Tally(None, lambda _: None)
    tally.errors["forward"].add(np.array([20_000], dtype=np.int64), np.array([30_000], dtype=np.int64))
    head, forward, feedback, *_, more = table(counters, tally, ASKED)
    causes = "loss outage refused overflow queue_full late codel evicted"
    assert " ".join(head.split()) == f"offered released {causes} held copies released late, us: p50 p99 max"
    assert " ".join(forward.split()) == "forward (west to east) 10 10" + 8 * " 10" + " 10 10 20 20 20"
    assert " ".join(feedback.split()) == "feedback (east to west) 5 5" + 8 * " 5" + " 5 5 0 0 0"
    assert more == (
        "2 messages before the beginning, 1 way past netem found: not valid, 30 messages dropped by a full buffer: "
        "not part of the configured network"
    )


def test_recent_delays_are_those_of_what_left_in_the_last_seconds() -> None:
    realised = Realised()
    assert realised.recent(0) is None
    second = NS_PER_S
    for k in range(10):  # one delay in each second: 0, 10, ..., 90 ms
        realised.add(np.array([k * second], dtype=np.int64), np.array([10 * k * NS_PER_MS], dtype=np.int64))
    found = realised.recent(9 * second)
    assert found is not None
    assert (found.n, found.p50_ms) == (5, 70.0)
    assert found.p99_ms == pytest.approx(89.6)
    later = realised.recent(13 * second)
    assert later is not None
    assert (later.n, later.p50_ms) == (1, 90.0)
    assert realised.recent(14 * second) is None


def test_delays_and_what_was_sent_again_stand_below_the_table() -> None:
    tally = Tally(None, lambda _: None)
    fates = FateBatch(direction="forward", key="a", seq=(0, 1, 2), recovered=(0, 1, 1))
    left = ReleaseBatch(
        direction="forward", key="a", seq=(0, 1, 2), copy_index=(0, 0, 0), offered_ns=(NS_PER_MS,) * 3,
        release_ns=(NS_PER_MS,) * 3, released_ns=(2 * NS_PER_MS, 0, 4 * NS_PER_MS),
        departure=("released", "late", "released"), queued_ns=(0, 0, 0),
    )  # fmt: skip
    tally.record(Record(FATES, 0, fates))
    tally.record(Record(RELEASES, 0, left))
    counters = {
        f"{way}.{name}": 0 for way in tally.errors for name in ("offered", "released", "held_at_end", "copied")
    }
    counters |= {f"{way}.dropped.{cause}": 0 for way in tally.errors for cause in NOTHING}
    assert table(counters, tally, ASKED)[3:] == [
        "forward: delay 2 ms, sd 1; realised: delay 2 ms, sd 1, 2 sent again (recovery)",
        "feedback: nothing injected; realised: nothing left",
    ]
    assert "realised, with changes: nothing" in table(counters | {"control.accepted": 1}, tally, ASKED)[4]


def _late_batch(late_ms: int) -> Record:
    batch = ReleaseBatch(
        direction="forward", key="a", seq=(0,), copy_index=(0,), offered_ns=(0,), release_ns=(1000,),
        released_ns=(1000 + late_ms * NS_PER_MS,), departure=("released",), queued_ns=(0,),
    )  # fmt: skip
    return Record(RELEASES, 0, batch)


def test_late_releases_are_told_once_in_ten_seconds_and_at_the_end() -> None:
    said: list[str] = []
    tally = Tally(None, said.append)
    tally.record(_late_batch(10))
    tally.flush()
    assert said == []  # that is the bound
    for late_ms in (11, 300, 40):
        tally.record(_late_batch(late_ms))
    tally.flush()
    assert len(said) == 1
    assert "forward (west to east)" in said[0]
    assert "300 ms" in said[0]
    for _ in range(19):
        tally.record(_late_batch(2700))
        tally.flush()
    assert len(said) == 1
    tally.flush()
    assert len(said) == 2
    assert "2700 ms after their instants, the worst at 2.70 s" in said[1]
    tally.record(_late_batch(27_000))
    tally.flush()
    assert len(said) == 3  # much worse
    for _ in range(50):
        tally.flush()
    assert len(said) == 3
    counters = {
        f"{way}.{name}": 0 for way in tally.errors for name in ("offered", "released", "held_at_end", "copied")
    }
    counters |= {f"{way}.dropped.{cause}": 0 for way in tally.errors for cause in NOTHING}
    (line,) = [line for line in table(counters, tally, ASKED) if "23 messages left more than 10 ms" in line]
    assert line.endswith("; late ones left from 0.01 s to 27.00 s, the worst at 27.00 s")


def test_names_near_a_bound_are_told_once_and_at_the_end() -> None:
    said: list[str] = []
    made = link()
    watch = NamesWatch({"forward": made}, said.append)
    watch.look()
    assert said == []
    made.flows.most_open = 17_000
    watch.look()
    watch.look()
    assert len(said) == 1
    assert "17000 names at once" in said[0]
    counters = made.counters() | {name.replace("forward", "feedback"): n for name, n in link().counters().items()}
    last = table(counters, Tally(None, said.append), ASKED)[-1]
    assert last == said[0]


def test_what_dropped_nothing_is_no_column() -> None:
    counters = {
        f"{direction}.{name}": 7
        for direction in ("forward", "feedback")
        for name in ("offered", "released", "held_at_end", "copied")
    }
    counters |= {f"{way}.dropped.{cause}": 0 for way in ("forward", "feedback") for cause in NOTHING}
    counters |= {"feedback.dropped.queue_full": 709, "leaks": 2}
    counters |= {"forward.held_back": 3, "feedback.held_back": 4, "forward.held_back_overdue": 1}
    head, forward, feedback, *_, more = table(counters, Tally(None, lambda _: None), ASKED)
    assert head.split()[:4] == ["offered", "released", "queue_full", "held"]
    assert forward.split()[4:7] == ["7", "7", "0"]
    assert feedback.split()[4:7] == ["7", "7", "709"]
    held = "7 messages held back at a full queue, 1 let go on before there was room"
    assert more == f"2 ways past netem found: not valid, {held}"


class _Kept:
    def __init__(self) -> None:
        self.calls: list[str] = []

    def record(self, record: Record) -> None:
        self.calls.append(record.topic)

    def attach(self, name: str, data: bytes) -> None:
        self.calls.append(name)

    def flush(self) -> None:
        self.calls.append("flush")

    def close(self) -> None:
        self.calls.append("close")


def test_a_watched_log_gets_everything_and_is_looked_at_when_flushed_and_closed() -> None:
    kept = _Kept()
    log = WatchedLog(kept, lambda: kept.calls.append("look"))
    log.attach("a.json", b"{}")
    log.record(Record("/t", 0, b""))
    log.flush()
    log.close()
    assert kept.calls == ["a.json", "/t", "look", "flush", "look", "close"]


@given(st.lists(st.integers(1, 10**9)), st.lists(st.integers(1, 10**9)))
def test_two_histograms_together_are_that_of_all_errors(one_ns: list[int], other_ns: list[int]) -> None:
    one, other, both = ReleaseErrors(), ReleaseErrors(), ReleaseErrors()
    one.add(np.array(one_ns, dtype=np.int64), np.array(one_ns, dtype=np.int64))
    other.add(np.array(other_ns, dtype=np.int64), np.array(other_ns, dtype=np.int64))
    both.add(np.array(one_ns + other_ns, dtype=np.int64), np.array(one_ns + other_ns, dtype=np.int64))
    one.add_all(other)
    assert (one.n, one.most_ns, one.late_at_ns) == (both.n, both.most_ns, both.late_at_ns)
    assert (one.most_at_ns, one.newest_ns) == (both.most_at_ns, both.newest_ns)
    assert [one.quantile_ns(p) for p in (0.01, 0.5, 1)] == [both.quantile_ns(p) for p in (0.01, 0.5, 1)]
