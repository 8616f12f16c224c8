"""A rate that changes holds from its own instant on, for what waits and for what is being sent.

The oracle integrates bits over the piecewise constant rate, in fractions, for all messages at once.
"""

from collections.abc import Iterable, Sequence
from fractions import Fraction
from math import ceil
from typing import Any

from hypothesis import given, settings
from hypothesis import strategies as st

from tests.netem.making import KEY, link, packet
from tis.common.node import Emission
from tis.common.records import ControlNote
from tis.common.scenario.network.conditions import TimelineEntry
from tis.netem.control.replay import apply_entries, entries_json, with_live_changes
from tis.netem.link.link import Link
from tis.netem.link.packet import Packet
from tis.netem.node import NetemNode

MS = 1_000_000
S = 1_000 * MS
OTHER_KEY = "tis/PSM2/setpoint_cp"
BIT_NS = 8_000_000
"""Time that a byte takes at 1 kbit/s."""


def driven(made: Link, arrivals: Iterable[tuple[int, int, str]], until_ns: int) -> list[Packet]:
    """Offer and release as a driver does: awake when the link asks for it, and at no other instant."""
    out: list[Packet] = []

    def release(before_ns: int) -> None:
        while (next_ns := made.next_release_ns()) is not None and next_ns <= before_ns:
            out.extend(made.release(next_ns))

    for at_ns, n_bytes, key in arrivals:
        release(at_ns - 1)
        made.offer(key, b"", n_bytes, at_ns, None)
    release(until_ns)
    return out


def released_ns(made: Link, arrivals: Sequence[tuple[int, int]], until_ns: int) -> list[int | None]:
    return [due.release_ns for due in driven(made, [(at, n, KEY) for at, n in arrivals], until_ns)]


def integrated(steps: Sequence[tuple[int, float]], arrivals: Sequence[tuple[int, int]]) -> list[int]:
    """Return when each message has been sent; ``steps`` are the instants from which a rate in kbit/s holds."""
    free, left = Fraction(0), []
    for at_ns, n_bytes in arrivals:
        now, rest = max(free, Fraction(at_ns)), Fraction(n_bytes)
        for i, (_, kbit_s) in enumerate(steps):
            end = Fraction(steps[i + 1][0]) if i + 1 < len(steps) else None
            if end is not None and end <= now:
                continue
            per_byte = BIT_NS / Fraction(str(kbit_s))
            if end is None or now + rest * per_byte <= end:
                now, rest = now + rest * per_byte, Fraction(0)
                break
            rest -= (end - now) / per_byte
            now = end
        free = now
        left.append(ceil(free))
    return left


def changing(steps: Sequence[tuple[int, float]]) -> dict[str, Any]:
    """Return a network with a rate that changes; ``steps`` in ms and kbit/s, the first one at 0."""
    return {
        "forward": {"rate": {"kbit_s": steps[0][1]}},
        "timeline": [{"at_s": at_ms / 1000, "set": {"rate": {"kbit_s": kbit_s}}} for at_ms, kbit_s in steps[1:]],
    }


def test_a_rate_that_doubles_halves_what_is_left_of_what_is_being_sent() -> None:
    made = link(**changing([(0, 64), (10, 128)]))
    assert released_ns(made, [(0, 160), (0, 160)], S) == [15 * MS, 25 * MS]


def test_behind_a_stall_a_message_leaves_soon_after_the_rate_returns() -> None:
    made = link(**changing([(0, 64), (100, 0.001), (1100, 64)]))
    # in the 999 ms of the stall an eighth of a byte leaves, the rest in 20 ms after it
    assert released_ns(made, [(101 * MS, 160)], 2000 * S) == [1_119_984_391]


def test_where_no_rate_is_left_everything_that_waits_leaves() -> None:
    clean = [{"at_s": 0.01, "for_s": 0.01, "set": {"clean": True}}]
    made = link(forward={"rate": {"kbit_s": 64}}, timeline=clean)
    arrivals = [(0, 160), (0, 160), (12 * MS, 160), (15 * MS, 160), (20 * MS, 160)]
    assert released_ns(made, arrivals, S) == [10 * MS, 10 * MS, 12 * MS, 15 * MS, 40 * MS]


def test_fifo_holds_when_a_rate_disappears() -> None:
    """128 B at 120 kbit/s take 8.5 ms, and one comes every 8 ms: the queue grows until nothing limits it."""
    for stages in ({"clean": True}, {"clean": True, "delay": {"kind": "constant", "delay_ms": 1}}):
        made = link(
            forward={"rate": {"kbit_s": 120}, "delay": {"kind": "constant", "delay_ms": 20}},
            timeline=[{"at_s": 5, "direction": "forward", "set": stages}],
        )
        due = driven(made, [(i * 8 * MS, 128, KEY) for i in range(1200)], 100 * S)
        assert [one.seq for one in due] == list(range(1200))
        assert [one.release_ns for one in due] == sorted(one.release_ns or 0 for one in due)


def test_fifo_holds_when_a_key_moves_to_another_queue() -> None:
    """From the queue of the link, which stands, to one of its own, and back."""
    made = link(
        forward={"rate": {"kbit_s": 8}},
        rules=[{"key": OTHER_KEY, "direction": "forward", "pipeline": {"rate": "link"}}],
        timeline=[{"at_s": 0.1, "for_s": 0.2, "set": {"rate": {"kbit_s": 16}}}],
    )
    sizes = [(at_ms * MS, 10, key) for at_ms in range(400) for key in (KEY, OTHER_KEY)]
    due = driven(made, sizes, 100 * S)
    for key in (KEY, OTHER_KEY):
        assert [one.seq for one in due if one.name == key] == list(range(400))


def test_fifo_waits_also_for_what_another_ordering_still_holds() -> None:
    """Before and after 0.1 to 0.2 s, when messages may overtake each other, they wait for all earlier ones."""
    made = link(
        forward={"delay": {"kind": "uniform", "low_ms": 0, "high_ms": 50}},
        timeline=[{"at_s": 0.1, "for_s": 0.1, "set": {"ordering": "reorder"}}],
    )
    due = driven(made, [(at_ms * MS, 10, KEY) for at_ms in range(300)], S)
    place = {one.seq: i for i, one in enumerate(due)}
    assert any(place[seq] > place[seq + 1] for seq in range(100, 199))
    for seq in range(200, 300):
        assert place[seq] > max(place[earlier] for earlier in range(seq))
    assert [one.seq for one in due if one.seq < 100] == list(range(100))


_CHANGES = st.lists(
    st.tuples(st.integers(1, 60), st.sampled_from([0.001, 0.3, 7.0, 64.0, 128.0, 1544.0, 12345.678])), max_size=8
)
_ARRIVALS = st.lists(st.tuples(st.integers(0, 15 * MS), st.integers(0, 400)), min_size=1, max_size=25)


@settings(deadline=None, max_examples=200)
@given(_CHANGES, _ARRIVALS)
def test_departures_are_those_of_the_integral(changes: list[tuple[int, float]], gaps: list[tuple[int, int]]) -> None:
    steps, at_ms = [(0, 56.0)], 0
    for gap_ms, kbit_s in changes:
        at_ms += gap_ms
        steps.append((at_ms, kbit_s))
    arrivals, at_ns = [], 0
    for gap_ns, n_bytes in gaps:
        at_ns += gap_ns
        arrivals.append((at_ns, n_bytes))
    expected = integrated([(at * MS, kbit_s) for at, kbit_s in steps], arrivals)
    assert released_ns(link(**changing(steps)), arrivals, 10**18) == expected


@settings(deadline=None, max_examples=60)
@given(
    st.integers(0, 40), st.integers(1, 80), st.integers(0, 200),
    st.sampled_from([0.001, 0.25, 1.0, 3.0]), _ARRIVALS,
)  # fmt: skip
def test_a_ramp_is_a_step_each_millisecond(
    at_ms: int, ramp_ms: int, hold_ms: int, factor: float, gaps: list[tuple[int, int]]
) -> None:
    end_ms = at_ms + 2 * ramp_ms + hold_ms
    entry = {"at_s": at_ms / 1000, "for_s": (end_ms - at_ms) / 1000, "ramp_s": ramp_ms / 1000}
    made = link(forward={"rate": {"kbit_s": 512}}, timeline=[entry | {"set": {"scale_rate": factor}}])
    steps = [(0, 512.0)] if at_ms else []
    for ms in range(at_ms, end_ms):
        share = min(1.0, (ms - at_ms) / ramp_ms, (end_ms - ms) / ramp_ms)
        # a rate is a whole number of bits per second, so that its arithmetic stays exact
        steps.append((ms * MS, round(512 * (1.0 - share + share * factor), 3)))
    steps.append((end_ms * MS, 512.0))
    arrivals, at_ns = [], 0
    for gap_ns, n_bytes in gaps:
        at_ns += gap_ns
        arrivals.append((at_ns, n_bytes))
    assert released_ns(made, arrivals, 10**18) == integrated(steps, arrivals)


def test_a_factor_of_a_state_scales_the_rate() -> None:
    states = [{"name": "good", "for_s": 0.01}, {"name": "poor", "for_s": 10, "forward": {"scale_rate": 0.5}}]
    made = link(forward={"rate": {"kbit_s": 128}}, states={"kind": "cycle", "states": states})
    # 160 bytes take 10 ms, then 20
    assert released_ns(made, [(0, 160), (0, 160)], S) == [10 * MS, 30 * MS]


def _note(at_ns: int, entries: str) -> ControlNote:
    return ControlNote(
        at_ns=at_ns, applied_ns=at_ns, operation="set", request="", added=entries, accepted=True, reason=""
    )


def test_a_rate_set_live_holds_for_what_waits_and_its_replay_agrees() -> None:
    faster = TimelineEntry.model_validate({"at_s": 0.01, "set": {"rate": {"kbit_s": 128}}})
    stalled: dict[str, Any] = {"forward": {"rate": {"kbit_s": 64}}}
    # live: nothing is offered after the request
    made = link(**stalled)
    for _ in range(2):
        made.offer(KEY, b"", 160, 0, None)
    apply_entries({"forward": made}, [faster], False, 9 * MS + 5)
    assert [due.release_ns for due in driven(made, [], S)] == [15 * MS, 25 * MS]
    # replayed in virtual time
    node = with_live_changes(
        NetemNode(forward=link(**stalled), feedback=link("feedback")), [_note(9 * MS + 5, entries_json([faster]))]
    )
    for seq in range(2):
        node.receive(packet(0, seq, payload=bytes(140)))
    instants = []
    while (next_ns := node.next_wake_ns()) is not None and next_ns < S:
        instants += [next_ns for output in node.wake(next_ns) if isinstance(output, Emission)]
    assert instants == [15 * MS, 25 * MS]
