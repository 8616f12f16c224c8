import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from common.channels import Direction
from common.node import Record
from common.records import RELEASES, ReleaseBatch
from netem.bridge_tally import ReleaseErrors, Tally, table

NOTHING = {"loss": 0, "outage": 0, "refused": 0, "overflow": 0, "queue_full": 0, "late": 0, "codel": 0, "evicted": 0}


@given(st.lists(st.integers(1, 10**10), min_size=1, max_size=200), st.sampled_from([0.5, 0.99, 1.0]))
def test_a_quantile_is_that_of_the_sorted_errors_within_a_bin(errors_ns: list[int], p: float) -> None:
    errors = ReleaseErrors()
    errors.add(np.array(errors_ns[::2], dtype=np.int64))
    errors.add(np.array(errors_ns[1::2], dtype=np.int64))
    exact = sorted(errors_ns)[int(np.ceil(p * len(errors_ns))) - 1]
    assert exact <= errors.quantile_ns(p) * (1 + 1e-12)
    assert errors.quantile_ns(p) <= exact * 2.0 ** (1 / 32) * (1 + 1e-12)


def test_without_packets_it_is_0() -> None:
    assert ReleaseErrors().quantile_ns(0.5) == 0.0


def test_only_what_was_released_is_counted() -> None:
    tally = Tally(None)
    batch = ReleaseBatch(
        direction="forward", key="a", seq=(0, 1, 2), copy_index=(0, 0, 0), offered_ns=(0, 0, 0),
        release_ns=(1000, 2000, 3000), released_ns=(1500, 0, 3100), departure=("released", "late", "released"),
        queued_ns=(0, 0, 0),
    )  # fmt: skip
    tally.record(Record(RELEASES, 0, batch))
    assert tally.errors["forward"].n == 2
    assert tally.errors["forward"].most_ns == 500
    assert tally.errors["feedback"].n == 0


def test_the_table_says_what_was_counted() -> None:
    counters = {"before_epoch": 2, "leaks": 1}
    for direction, n in (("forward", 10), ("feedback", 5)):
        counters |= {f"{direction}.{name}": n for name in ("offered", "released", "held_at_end", "copied")}
        counters |= {f"{direction}.dropped.{cause}": n for cause in NOTHING}
    errors: dict[Direction, ReleaseErrors] = {"forward": ReleaseErrors(), "feedback": ReleaseErrors()}
    errors["forward"].add(np.array([20_000], dtype=np.int64))
    head, forward, feedback, more = table(counters, errors)
    assert " ".join(head.split()) == "offered released loss outage refused other held copies late us: p50 p99 max"
    assert " ".join(forward.split()) == "forward (west to east) 10 10 10 10 10 50 10 10 20 20 20"
    assert " ".join(feedback.split()) == "feedback (east to west) 5 5 5 5 5 25 5 5 0 0 0"
    assert more == "2 messages before the beginning, 1 ways past netem found: not valid"
