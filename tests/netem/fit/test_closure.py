"""What closes, by hand; a replay of the network that made the record closes."""

import numpy as np
import pytest

from tis.common.scenario.network import NetworkPart
from tis.common.trace import LOST, Trace
from tis.netem.fit.closure import closures, replay, replays
from tis.netem.fit.statistics import NAMES

MS = 1_000_000
NETWORK = {
    "forward": {
        "loss": {"kind": "gilbert_elliott", "p_bad": 0.01, "p_good": 0.05, "p_loss_bad": 0.5},
        "delay": {"kind": "gamma", "shift_ms": 10, "mean_ms": 5, "std_ms": 3},
        "correlation": {"half_life_s": 0.2},
    }
}


def record(n: int = 4000) -> Trace:
    return Trace("t", np.arange(n) * 10 * MS, np.zeros(n, dtype=np.int64))


def test_a_replay_of_the_network_that_made_the_record_closes() -> None:
    made = Trace("t", record().sent_ns, replay(NetworkPart.model_validate(NETWORK), record(), 1234, ordered=True))
    found = closures(made, replays(NETWORK, made, 20, ordered=True))
    assert len(found) == len(NAMES)
    # 20 replays say little about their middle 95 %: nothing may lie more than twice as far out
    assert not [one for one in found if one.severity > 2.0]


def test_another_network_does_not_close_and_is_named() -> None:
    other = {"forward": {**NETWORK["forward"], "loss": {"kind": "bernoulli", "p_loss": 0.08}}}
    made = Trace("t", record().sent_ns, replay(NetworkPart.model_validate(NETWORK), record(), 1234, ordered=True))
    missed = {one.name for one in closures(made, replays(other, made, 20, ordered=True)) if not one.closes}
    assert "longest run of losses" in missed
    assert "mean delay, ms" not in missed


def test_the_bounds_by_hand() -> None:
    """Constant replays: 10 % for a mean; a run of two losses in one tenth of the record does not exclude three."""
    sent_ns = np.arange(100) * 100 * MS
    trace = Trace("t", sent_ns, np.where(np.arange(100) < 2, LOST, 10 * MS))
    row = [2.0, 10.9, 9.2, 10.0, 10.0, 11.5, *[np.nan] * 3, 10.0, 3.0, 0.0]
    found = {one.name: one for one in closures(trace, np.array([row] * 5))}
    assert not {name for name in found if name.startswith("auto")}
    closed = {name for name, one in found.items() if one.closes}
    assert set(found) - closed == {"p99, ms"}
    assert found["mean delay, ms"].severity == pytest.approx(0.9)


@pytest.mark.parametrize(
    ("ordering", "delays"), [("fifo", [30, 20, 5]), ("reorder", [30, 5, 5]), ("drop_late", [None, 5, 5])]
)
def test_a_replay_orders_as_the_pipeline_says(ordering: str, delays: list[int]) -> None:
    points = {"kind": "quantiles", "points": [{"p": 0, "delay_ms": 5}, {"p": 1, "delay_ms": 5}]}
    states = {
        "kind": "cycle",
        "states": [{"name": "a", "for_s": 0.005, "forward": {"add_delay_ms": 25}}, {"name": "b", "for_s": 9}],
    }
    network = NetworkPart.model_validate({"forward": {"delay": points, "ordering": ordering}, "states": states})
    trace = Trace("t", np.array([0, 10, 40]) * MS, np.zeros(3, dtype=np.int64))
    in_order, drawn = (replay(network, trace, 1, ordered) for ordered in (True, False))
    assert [None if delay == LOST else delay / MS for delay in in_order.tolist()] == delays
    assert (drawn / MS).tolist() == [30, 5, 5]
