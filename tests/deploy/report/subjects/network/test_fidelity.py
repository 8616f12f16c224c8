"""Verdicts on runs that are made to order: what the models draw is faithful, what somebody else drew is not."""

import json
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

from tests.deploy.report.hand_made import COMMAND, MS, a_scenario, counter, fate, ints, message, release, write_run
from tis.common.node import Record
from tis.common.records import CONTROL, FATES, RELEASES, ControlNote, Departure, FateBatch, Outcome, ReleaseBatch
from tis.common.scenario import Scenario
from tis.deploy.report.subjects.network.link_summary import link_summary
from tis.netem.expected.simulate import Simulated, simulate

PIPELINE: dict[str, Any] = {
    "delay": {"kind": "gamma", "shift_ms": 20, "mean_ms": 10, "std_ms": 5},
    "loss": {"kind": "burst", "p_loss": 0.02, "mean_burst": 3},
    "duplicate": {"p_duplicate": 0.05},
    "corrupt": {"p_corrupt": 0.03, "bits": 2},
}


def _scenario(pipeline: dict[str, Any] = PIPELINE, **network: Any) -> Scenario:
    return a_scenario(120.0, network={"forward": pipeline, **network})


def _drawn(scenario: Scenario, n: int) -> Simulated:
    return simulate(scenario.network, "forward", scenario.seed, np.arange(n) * 10 * MS, 120, key=COMMAND)


def _logged(drawn: Simulated, error_ns: int = 0) -> list[Record]:
    """What netem would log; every packet leaves ``error_ns`` later than decided."""
    n = len(drawn.offered_ns)
    outcomes: tuple[Outcome, ...] = tuple(
        "outage" if out else "loss" if lost else "deliver" for out, lost in zip(drawn.outage, drawn.lost, strict=True)
    )
    through = ~drawn.lost
    copies = through & (drawn.copy_delay_ns >= 0)
    release_ns = drawn.offered_ns + drawn.delay_ns
    fates = FateBatch(
        direction="forward", key=COMMAND, seq=tuple(range(n)), offered_ns=ints(drawn.offered_ns), outcome=outcomes,
        delay_ns=ints(drawn.delay_ns), release_ns=ints(release_ns * through), n_bytes=(100,) * n,
        copies=ints(copies), flipped=ints(drawn.n_flips * through),
    )  # fmt: skip
    seq = np.concatenate([np.flatnonzero(through), np.flatnonzero(copies)])
    copy_index = np.concatenate([np.zeros(through.sum(), int), np.ones(copies.sum(), int)])
    left_ns = np.where(copy_index == 0, release_ns[seq], drawn.offered_ns[seq] + drawn.copy_delay_ns[seq])
    in_turn = np.lexsort((copy_index, seq))  # fifo: none leaves before an earlier one
    left_ns[in_turn] = np.maximum.accumulate(left_ns[in_turn])
    departures: tuple[Departure, ...] = ("released",)
    releases = ReleaseBatch(
        direction="forward", key=COMMAND, seq=ints(seq), copy_index=ints(copy_index),
        offered_ns=ints(drawn.offered_ns[seq]), release_ns=ints(left_ns), released_ns=ints(left_ns + error_ns),
        departure=departures * len(seq), queued_ns=(0,) * len(seq),
    )  # fmt: skip
    return [Record(FATES, 0, fates), Record(RELEASES, 0, releases)]


def _verdict(tmp_path: Path, asked: Scenario, netem: list[Record], n: int) -> dict[str, Any]:
    sent = [message(COMMAND, k, 10 * k) for k in range(n)]
    link, _ = link_summary(write_run(tmp_path, sent, netem), "forward", asked)
    verdict: dict[str, Any] = link["keys"][COMMAND]["verdict"].as_json()
    unplanned = [text for text in verdict["violations"] if text.startswith("unplanned")]
    verdict["violations"] = [text for text in verdict["violations"] if text not in unplanned]  # nobody received here
    return verdict


def test_what_the_models_draw_is_faithful(tmp_path: Path) -> None:
    scenario = _scenario()
    verdict = _verdict(tmp_path, scenario, _logged(_drawn(scenario, 8000)), 8000)
    assert verdict["violations"] == verdict["not_decidable"] == verdict["warnings"] == []


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"delay": {"kind": "gamma", "shift_ms": 21, "mean_ms": 10, "std_ms": 5}}, "decided delay: mean 31"),
        ({"delay": {"kind": "constant", "delay_ms": 30.1}}, "decided delay: 0 % of 7829 messages got at most"),
        ({"delay": {"kind": "normal", "mean_ms": 30, "std_ms": 5}}, "decided delay: "),
        ({"loss": {"kind": "burst", "p_loss": 0.06, "mean_burst": 3}}, "decided loss: "),
        ({"loss": None}, "decided loss: 0 % of 8000 messages were lost, asked for are 2 %"),
        ({"duplicate": {"p_duplicate": 0.1}}, "decided duplication: "),
        ({"corrupt": None}, "decided corruption: 0 % of "),
    ],
)
def test_what_somebody_else_drew_is_not(tmp_path: Path, change: dict[str, Any], sentence: str) -> None:
    verdict = _verdict(tmp_path, _scenario(), _logged(_drawn(_scenario({**PIPELINE, **change}), 8000)), 8000)
    assert verdict["faithful"] is False
    assert len(verdict["violations"]) == 1
    assert verdict["violations"][0].startswith(sentence)


def test_a_constant_delay_is_held_to_the_ns(tmp_path: Path) -> None:
    one, other = ({"delay": {"kind": "constant", "delay_ms": ms}} for ms in (10.0, 10.00001))
    verdict = _verdict(tmp_path, _scenario(one), _logged(_drawn(_scenario(other), 3)), 3)
    assert verdict["violations"] == [
        "decided delay: mean 10 ms of 3 messages, asked for are 10 ms: 0.01 us too long, chance explains 0.001 us"
    ]


def test_few_packets_decide_nothing_and_say_so(tmp_path: Path) -> None:
    scenario = _scenario()
    verdict = _verdict(tmp_path, scenario, _logged(_drawn(scenario, 20)), 20)
    assert verdict["violations"] == []
    assert verdict["not_decidable"] == [
        "loss of 2 %: not decidable with 20 messages",
        "corruption of 3 %: not decidable with 20 messages",
        "duplication of 5 %: not decidable with 20 messages",
        "mean delay: not decidable with 20 messages",
        "release error: not decidable with 21 messages",
    ]
    left_open = {"loss": 20, "corruption": 20, "duplication": 20, "mean delay": 20, "release error": 21}
    assert verdict["undecided"] == left_open


@pytest.mark.parametrize(
    ("n", "n_late", "is_decided"), [(39, 39, True), (39, 6, True), (39, 5, False), (2, 2, False)]
)
def test_few_packets_decide_on_a_release_error_that_chance_does_not_explain(
    tmp_path: Path, n: int, n_late: int, is_decided: bool
) -> None:
    """Oracle: P(at least k of n late), each with 1 %: 5.8e-5 for 5 of 39, 3.3e-6 for 6; 3.2e-5 decides."""
    scenario = _scenario({"delay": {"kind": "constant", "delay_ms": 40}})
    fates, releases = _logged(_drawn(scenario, n))
    batch = releases.data
    assert isinstance(batch, ReleaseBatch)
    late_ns = [0] * (n - n_late) + [452 * MS] * n_late
    left_ns = tuple(at_ns + error_ns for at_ns, error_ns in zip(batch.released_ns, late_ns, strict=True))
    releases = Record(RELEASES, 0, msgspec.structs.replace(batch, released_ns=left_ns))
    verdict = _verdict(tmp_path, scenario, [fates, releases], n)
    late = f"release error: {n_late} of {n} messages left more than 2 ms after their instant, up to 452 ms"
    told = [text.partition("; late ones left from 0.")[0] for text in verdict["violations"]]
    assert told == ([f"{late}; allowed is 1 %"] if is_decided else [])
    assert ("release error" in verdict["undecided"]) != is_decided


def test_correlated_delays_are_fewer_draws(tmp_path: Path) -> None:
    """80 s of a process with a half-life of 10 s are some 3 independent draws."""
    scenario = _scenario({"delay": PIPELINE["delay"], "correlation": {"half_life_s": 10}})
    verdict = _verdict(tmp_path, scenario, _logged(_drawn(scenario, 8000)), 8000)
    assert verdict["violations"] == []
    assert verdict["not_decidable"] == ["mean delay: not decidable with 8000 messages"]


def test_conditions_that_change_are_held_against_what_they_ask(tmp_path: Path) -> None:
    timeline = [
        {"at_s": 10, "for_s": 5, "set": {"outage": True}},
        {"at_s": 20, "for_s": 20, "ramp_s": 0.2, "set": {"scale_delay": 3, "add_p_loss": 0.2}},
        {"at_s": 60, "set": {"delay": {"kind": "uniform", "low_ms": 1, "high_ms": 2}}},
    ]
    changing = _scenario(timeline=timeline)
    assert _verdict(tmp_path, changing, _logged(_drawn(changing, 8000)), 8000)["violations"] == []
    violations = _verdict(tmp_path, changing, _logged(_drawn(_scenario(), 8000)), 8000)["violations"]
    assert [text.partition(":")[0] for text in violations] == ["outages", "decided loss", "decided delay"]
    assert violations[0].endswith("of 8000 messages were not dropped in an outage")
    violations = _verdict(tmp_path, _scenario(), _logged(_drawn(changing, 8000)), 8000)["violations"]
    assert violations[0] == "outages: 500 of 8000 messages were dropped as in an outage where there was none"


@pytest.mark.parametrize(
    ("error_ms", "delay_ms", "allowed"),
    [(0.99, 10, None), (1.01, 10, "1 ms: 10 us too much"), (4.9, 100, None), (5.1, 100, "5 ms: 100 us too much")],
)
def test_realised_is_held_against_decided(
    tmp_path: Path, error_ms: float, delay_ms: float, allowed: str | None
) -> None:
    """1 ms, or 5 % of the median delay."""
    scenario = _scenario({"delay": {"kind": "constant", "delay_ms": delay_ms}})
    verdict = _verdict(tmp_path, scenario, _logged(_drawn(scenario, 100), round(error_ms * MS)), 100)
    late = f"{error_ms * 1000:.0f} us" if error_ms < 1 else f"{error_ms} ms"
    expected = [f"release error: 99 % of 100 messages left within {late} of their instant, allowed are {allowed}"]
    told = [text.partition("; late ones left from 0.")[0] for text in verdict["violations"]]
    assert told == (expected if allowed else [])


def test_what_vanished_is_a_violation(tmp_path: Path) -> None:
    scenario = _scenario({})
    drawn = _drawn(scenario, 100)
    sent = [message(COMMAND, k, 10 * k) for k in range(100)]
    received = [message(COMMAND, k, 10 * k) for k in range(97)]
    link, _ = link_summary(write_run(tmp_path, sent, _logged(drawn), received), "forward", scenario)
    assert link["verdict"]["violations"] == [
        f"{COMMAND}: unplanned loss: 3 of 100 messages vanished outside netem: 0 on the way to it, 3 behind it"
    ]
    assert link["verdict"]["faithful"] is False


def test_a_request_below_what_netem_itself_takes_is_a_warning(tmp_path: Path) -> None:
    overhead = counter("base_overhead_ns", 80_000)
    for delay_ms, warnings in ((0.05, 1), (0.2, 0), (0, 0)):
        scenario = _scenario({"delay": {"kind": "constant", "delay_ms": delay_ms}})
        verdict = _verdict(tmp_path, scenario, [*_logged(_drawn(scenario, 10)), overhead], 10)
        assert len(verdict["warnings"]) == warnings
        if warnings:
            when = "(median of a third of a second before the start)"
            assert verdict["warnings"] == [f"a delay of 50 us is asked for, but netem itself takes 80 us {when}"]


def _change(at_ms: int, **entry: Any) -> Record:
    """A change that was asked for while running and holds from the next ms on."""
    added = json.dumps([{"at_s": at_ms / 1000, "set": {"add_delay_ms": 5}, **entry}])
    note = ControlNote(at_ns=at_ms * MS, applied_ns=(at_ms + 1) * MS, request="{}", added=added, accepted=True)
    return Record(CONTROL, note.at_ns, note)


@pytest.mark.parametrize(
    ("entry", "last", "when", "n_changed"),
    [
        ({"direction": "forward", "for_s": 0.5}, 150, "from 1.000 s to 1.500 s", 50),
        ({"direction": "both"}, 200, "from 1.000 s on", 100),
    ],
)
def test_a_change_made_while_running_leaves_out_what_was_offered_meanwhile(
    tmp_path: Path, entry: dict[str, Any], last: int, when: str, n_changed: int
) -> None:
    """A message every 10 ms; those of the change have 5 ms more, and then the network is as it was."""
    scenario = _scenario({"delay": {"kind": "constant", "delay_ms": 10}})
    drawn = _drawn(scenario, 200)
    drawn.delay_ns[100:last] += 5 * MS
    between = _change(501, direction="forward", for_s=0.005)  # it met no message, so it is not told
    verdict = _verdict(tmp_path, scenario, [*_logged(drawn), between, _change(999, **entry)], 200)
    assert verdict["violations"] == []
    assert verdict["faithful"] is not None
    assert verdict["warnings"] == [
        f"changed while running {when}: {n_changed} of 200 messages are not held against the network asked for; "
        "netem's own part, such as its release error, counts all"
    ]
    found = _verdict(tmp_path, scenario, _logged(drawn), 200)["violations"]
    assert [text.partition(":")[0] for text in found] == ["decided delay"]
    drawn.delay_ns[:] += 5 * MS  # what is wrong outside the change is still seen
    found = _verdict(tmp_path, scenario, [*_logged(drawn), _change(999, **entry)], 200)["violations"]
    assert [text.partition(":")[0] for text in found] == ["decided delay"]


def test_messages_offered_under_a_change_count_for_netem_s_own_release_error(tmp_path: Path) -> None:
    scenario = _scenario({"delay": {"kind": "constant", "delay_ms": 10}})
    change = _change(0, direction="both")
    verdict = _verdict(tmp_path, scenario, [*_logged(_drawn(scenario, 200), error_ns=2 * MS), change], 200)
    assert (verdict["judged"], verdict["set_aside"]) == (1, 199)
    assert [text.partition(" messages")[0] for text in verdict["violations"]] == ["release error: 99 % of 200"]


def test_a_change_of_the_other_direction_changes_nothing(tmp_path: Path) -> None:
    scenario = _scenario({"delay": {"kind": "constant", "delay_ms": 10}})
    records = [*_logged(_drawn(scenario, 200)), _change(999, direction="feedback")]
    link, _ = link_summary(write_run(tmp_path, netem=records), "forward", scenario)
    assert link["verdict"]["warnings"] == []
    assert not link["requested"]["varies"]


@pytest.mark.parametrize(
    ("buffer", "most_held", "words"),
    [
        ({"max_mb": 20}, 20, "buffer of 20 MB full"),
        ({"max_packets": 20}, 20, "buffer of 20 messages full"),
        ({"max_mb": 20, "max_packets": 20}, None, "buffer of 20 MB or 20 messages full"),
    ],
)
def test_what_a_full_buffer_drops_was_not_asked_for(
    tmp_path: Path, buffer: dict[str, Any], most_held: int | None, words: str
) -> None:
    scenario = _scenario({"delay": {"kind": "constant", "delay_ms": 10}}, buffer=buffer)
    counted = [] if most_held is None else [counter("forward.most_held", most_held)]
    dropped = [fate(COMMAND, 200 + k, 2000 + 10 * k, None, "overflow") for k in range(7)]
    evicted = [fate(COMMAND, 207, 2070, 10), release(COMMAND, 207, 2070, 2071, 2071, "evicted")]
    netem = [*_logged(_drawn(scenario, 200)), *dropped, *evicted, *counted]
    verdict = _verdict(tmp_path, scenario, netem, 208)
    assert verdict["faithful"] is False
    assert verdict["violations"] == [
        f"{words}: 8 messages dropped of 208 offered, which is no part of the network asked for"
    ]


def test_what_a_full_queue_drops_is_the_network_asked_for(tmp_path: Path) -> None:
    rate = {"kbit_s": 64, "queue": {"kind": "tail_drop", "max_packets": 2}}
    netem = [fate(COMMAND, k, 10 * k, 0) for k in range(100)]
    netem += [release(COMMAND, k, 10 * k, 10 * k + 20, 10 * k + 20, queued_ms=20) for k in range(100)]
    netem += [fate(COMMAND, 100 + k, 1000 + k, None, "queue_full") for k in range(7)]
    verdict = _verdict(tmp_path, _scenario({"rate": rate}), netem, 107)
    assert verdict["violations"] == []


def test_a_key_that_no_rule_lets_pass_must_be_refused(tmp_path: Path) -> None:
    key = "demo/chat"
    batch = FateBatch(
        direction="forward", key=key, foreign=True, seq=(0, 1), offered_ns=(0, 1), outcome=("refused", "deliver"),
        delay_ns=(0, 0), release_ns=(0, 1), n_bytes=(1, 1), copies=(0, 0), flipped=(0, 0),
    )  # fmt: skip
    link, _ = link_summary(write_run(tmp_path, netem=[Record(FATES, 0, batch)]), "forward", _scenario({}))
    assert link["keys"]["demo/chat (foreign)"]["verdict"]["violations"] == [
        "no rule lets this key pass, but 1 of 2 messages were not refused"
    ]


def test_a_link_that_carried_nothing_has_no_verdict(tmp_path: Path) -> None:
    link, problems = link_summary(write_run(tmp_path), "forward", _scenario())
    assert link["verdict"].as_json() == {
        "faithful": None,
        "violations": [],
        "not_decidable": [],
        "warnings": [],
        "judged": 0,
        "set_aside": 0,
        "undecided": {},
    }
    assert link["keys"] == {}
    assert problems == []


@pytest.mark.parametrize(("ordering", "left_open"), [("fifo", False), ("drop_late", False), ("reorder", True)])
def test_a_packet_that_left_behind_a_later_one_is_said_where_none_may(
    tmp_path: Path, ordering: str, left_open: bool
) -> None:
    """Number 2 leaves behind 3, which was offered after it; 0 was offered behind 1, so it may leave behind it."""
    delay = {"kind": "constant", "delay_ms": 10}
    scenario = _scenario({"delay": delay, "ordering": ordering})
    offered = [fate(COMMAND, seq, 10 * k, 10) for k, seq in enumerate((1, 0, 2, 3))]
    left = [(1, 10.0, 10.0), (0, 20.0, 20.0), (3, 40.0, 40.0), (2, 30.0, 40.1)]
    netem = [*offered, *(release(COMMAND, seq, due_ms - 10, due_ms, at_ms) for seq, due_ms, at_ms in left)]
    found = _verdict(tmp_path, scenario, netem, 4)["violations"]
    words = f"order: 1 of 4 messages left netem behind later ones, though asked for is {ordering}"
    assert found == ([] if left_open else [words])


@pytest.mark.parametrize(
    ("ordering", "change", "left_open"),
    [
        ("fifo", {"clean": True}, False),
        ("fifo", {"rate": {"kbit_s": 9}}, False),
        ("fifo", {"ordering": "reorder"}, True),
        ("drop_late", {"clean": True}, True),
    ],
)
def test_fifo_is_judged_also_where_other_stages_change(
    tmp_path: Path, ordering: str, change: dict[str, Any], left_open: bool
) -> None:
    delay = {"kind": "constant", "delay_ms": 10}
    scenario = _scenario({"delay": delay, "ordering": ordering}, timeline=[{"at_s": 100, "set": change}])
    offered = [fate(COMMAND, seq, 10 * seq, 10) for seq in range(3)]
    left = [(0, 10.0, 10.0), (2, 30.0, 30.0), (1, 20.0, 30.1)]
    netem = [*offered, *(release(COMMAND, seq, due_ms - 10, due_ms, at_ms) for seq, due_ms, at_ms in left)]
    found = _verdict(tmp_path, scenario, netem, 3)["violations"]
    assert any(text.startswith("order: 1 of 3 messages") for text in found) != left_open
