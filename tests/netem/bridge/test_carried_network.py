from typing import Any

import pytest

from tis.common.errors import InputError
from tis.common.scenario.network import NetworkPart
from tis.common.scenario.network.conditions import Change, TimelineEntry
from tis.netem.bridge.carried_network import (
    backlog_bytes,
    datagram_change,
    datagram_network,
    needs_segments,
    stream_change,
    stream_network,
)
from tis.netem.control.replay import entry_in_words

RULE = "needs messages: a stream of bytes (--carry tcp) loses, copies, alters and reorders nothing"

LOSS_RULE = "needs recovery, as a stream of bytes (--carry tcp) repeats what it loses: {..., recovery: {}}"


def _network(**parts: Any) -> NetworkPart:
    return NetworkPart.model_validate(parts)


def _refused(network: NetworkPart) -> list[str]:
    with pytest.raises(InputError) as error:
        stream_network(network, "bad.yaml")
    return [str(fault) for fault in error.value.faults]


def test_what_needs_messages_is_refused_by_name_and_all_at_once() -> None:
    network = _network(
        forward={
            "loss": {"kind": "bernoulli", "p_loss": 0.1}, "duplicate": {"p_duplicate": 0.1},
            "corrupt": {"p_corrupt": 0.1}, "delay": {"kind": "constant", "delay_ms": 3}, "ordering": "reorder",
            "reorder": {"p_reorder": 0.1}, "rate": {"kbit_s": 100, "queue": {"kind": "codel"}},
        },
        rules=[{"key": "a/**", "direction": "both", "pipeline": {}}],
        timeline=[{"at_s": 1, "set": {"add_p_loss": 0.5}}],
        states={"kind": "cycle", "states": [
            {"name": "one", "for_s": 1, "feedback": {"loss": {"kind": "bernoulli", "p_loss": 1}}},
        ]},
    )  # fmt: skip
    assert _refused(network) == [
        "bad.yaml: rules: need keys, and there are none in a stream of bytes (--carry tcp)",
        f"bad.yaml: forward.loss: {LOSS_RULE}",
        *(f"bad.yaml: forward.{name}: {RULE}" for name in ("duplicate", "corrupt", "reorder", "ordering")),
        f"bad.yaml: forward.rate.queue: {RULE}",
        f"bad.yaml: timeline.0.set.add_p_loss: {LOSS_RULE}",
        f"bad.yaml: states.states.0.feedback.loss: {LOSS_RULE}",
    ]


def test_priorities_need_messages_too_and_back_pressure_is_what_a_stream_has_anyway() -> None:
    rate = {"kbit_s": 100, "queue": {"kind": "priority"}, "backpressure": True}
    assert _refused(_network(forward={"rate": rate})) == [f"bad.yaml: forward.rate.queue: {RULE}"]
    stream_network(_network(forward={"rate": {"kbit_s": 100, "backpressure": True}}), "x")


def test_an_outage_becomes_a_stall_wherever_it_stands() -> None:
    network = _network(
        outages=[{"kind": "periodic", "every_s": 2, "for_s": 1}],
        timeline=[{"at_s": 1, "set": {"outage": True}}, {"at_s": 2, "set": {"scale_delay": 2}}],
        states={"kind": "cycle", "states": [{"name": "down", "for_s": 1, "forward": {"outage": True}}]},
    )
    found = stream_network(network, "x")
    assert [part.effect for part in found.outages] == ["stall"]
    assert [(entry.set.outage, entry.set.stall) for entry in found.timeline] == [(False, True), (False, False)]
    assert found.states is not None
    down = found.states.states[0].forward
    assert (down.outage, down.stall) == (False, True)


def test_a_queue_drops_nothing_and_its_bound_holds_the_sender_back() -> None:
    queue = {"kind": "tail_drop", "max_packets": 10, "max_bytes": 9_000}
    network = _network(
        forward={"rate": {"kbit_s": 100, "queue": queue}}, feedback={"delay": {"kind": "constant", "delay_ms": 1}}
    )
    found = stream_network(network, "x")
    rate = found.forward.rate
    assert rate is not None
    assert not isinstance(rate, str)
    assert (rate.queue.max_packets, rate.queue.max_bytes) == (1_000_000_000, None)
    assert backlog_bytes(network) == {"forward": 9_000, "feedback": 4_000_000}
    assert (needs_segments(network), needs_segments(_network())) == (True, False)


REPEATED = {"loss": {"kind": "bernoulli", "p_loss": 0.1, "recovery": {}}}


def test_a_loss_that_is_repeated_stays_and_so_do_outages_beside_it() -> None:
    network = _network(
        forward=REPEATED,
        outages=[
            {"kind": "periodic", "every_s": 2, "for_s": 1, "direction": direction}
            for direction in ("forward", "feedback", "both")
        ],
        timeline=[{"at_s": 1, "direction": "forward", "set": {"add_p_loss": 0.5, "outage": True}}],
    )
    found = stream_network(network, "x")
    assert found.forward.loss == network.forward.loss
    assert [part.effect for part in found.outages] == ["loss", "stall", "stall"]
    assert (found.timeline[0].set.outage, found.timeline[0].set.stall) == (True, False)
    assert needs_segments(found)


def test_outages_hold_up_where_the_recovery_ends_at_times() -> None:
    clean = {"at_s": 1, "direction": "forward", "set": {"clean": True}}
    outage = {"kind": "periodic", "every_s": 2, "for_s": 1, "direction": "forward"}
    network = _network(forward=REPEATED, outages=[outage], timeline=[clean])
    assert [part.effect for part in stream_network(network, "x").outages] == ["stall"]
    more = {"at_s": 2, "direction": "forward", "set": {"add_p_loss": 0.1}}
    assert _refused(_network(forward=REPEATED, timeline=[clean, more])) == [
        f"bad.yaml: timeline.1.set.add_p_loss: {LOSS_RULE}"
    ]


def test_a_live_change_is_refused_or_adapted() -> None:
    bare, repeating = _network(), _network(forward=REPEATED, feedback=REPEATED)
    with pytest.raises(InputError, match=r"control: change\.add_p_loss: needs recovery"):
        stream_change(bare, Change(add_p_loss=0.1))
    assert stream_change(repeating, Change(add_p_loss=0.1)).add_p_loss == 0.1
    outage = stream_change(bare, Change(outage=True))
    assert (outage.outage, outage.stall) == (False, True)
    assert entry_in_words(TimelineEntry(at_s=1, for_s=0.7, set=outage)) == "from 1.000 s for 0.7 s: stall"
    assert stream_change(repeating, Change(outage=True)).outage
    with pytest.raises(InputError, match=r"control: change\.clean: would end the recovery"):
        stream_change(repeating, Change(clean=True))
    plain = Change(scale_delay=2)
    assert stream_change(bare, plain) is plain


def test_datagrams_refuse_what_only_zenoh_has_and_nothing_else() -> None:
    whole = {
        "loss": {"kind": "burst", "p_loss": 0.1, "mean_burst": 3}, "duplicate": {"p_duplicate": 0.1},
        "corrupt": {"p_corrupt": 0.1}, "delay": {"kind": "constant", "delay_ms": 3}, "ordering": "reorder",
        "reorder": {"p_reorder": 0.1}, "rate": {"kbit_s": 100, "queue": {"kind": "codel"}},
    }  # fmt: skip
    network = _network(forward=whole, timeline=[{"at_s": 1, "set": {"outage": True}}])
    assert datagram_network(network, "x") is network
    rate = {"kbit_s": 100, "queue": {"kind": "priority"}, "backpressure": True}
    zenoh = _network(
        rules=[{"key": "a/**", "direction": "both", "pipeline": {}}], timeline=[{"at_s": 1, "set": {"rate": rate}}]
    )
    with pytest.raises(InputError) as error:
        datagram_network(zenoh, "x")
    fields = ["rules", "timeline.0.set.rate.queue", "timeline.0.set.rate.backpressure"]
    assert [fault.field for fault in error.value.faults] == fields
    with pytest.raises(InputError, match=r"control: change\.rate\.queue: needs priorities"):
        datagram_change(zenoh, zenoh.timeline[0].set)
