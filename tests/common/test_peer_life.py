"""Lives of the other sides, by literal times."""

import json
from itertools import product

import pytest
from msgspec import DecodeError
from msgspec.structs import replace

from tis.common.messages import decode
from tis.common.peer_life import Beat, Change, Event, PeerLife, described
from tis.common.units import NS_PER_MS
from tis.deploy.logs.blocks import MAX_NUMBER

_MS = NS_PER_MS


def _beat(at_ms: int, loop_ms: int | None = None, doing: str = "") -> Beat:
    return Beat(side="patient", at_ns=at_ms * _MS, loop_ns=(at_ms if loop_ms is None else loop_ms) * _MS, doing=doing)


def _live(life: PeerLife, from_ms: int, to_ms: int, ahead_ms: int = 0) -> list[Change]:
    """Let beats come every 200 ms and look as often; ``ahead_ms`` is how far the peer's clock is ahead."""
    found = []
    for at_ms in range(from_ms, to_ms, 200):
        life.hear(_beat(at_ms + ahead_ms), at_ms * _MS)
        found += life.look(at_ms * _MS, True, False, None)
    return found


def _look(life: PeerLife, at_ms: int, **known: object) -> list[tuple[str, int]]:
    values = {"is_present": True, "link_is_down": False, "view": None} | known
    changes = life.look(at_ms * _MS, **values)  # type: ignore[arg-type]
    return [(change.event, change.for_ns // _MS) for change in changes]


def test_a_side_whose_beats_come_has_nothing_to_tell() -> None:
    assert _live(PeerLife("patient"), 0, 60_000) == []


def test_a_side_is_told_when_its_token_goes_and_when_it_comes_back() -> None:
    life = PeerLife("patient")
    _live(life, 0, 5_000)
    assert _look(life, 5_000, is_present=False) == [("left", 200)]
    assert _look(life, 5_200, is_present=False) == []
    assert _look(life, 9_000) == []  # it waits for a run, and does not beat
    life.hear(_beat(9_100), 9_100 * _MS)
    assert _look(life, 9_200) == [("back", 4_400)]
    assert _live(life, 9_400, 12_000) == []


@pytest.mark.parametrize(("link_is_down", "event"), [(True, "link_down"), (False, "frozen"), (None, "silent")])
def test_a_silence_is_told_after_a_second_with_its_reason(link_is_down: bool | None, event: str) -> None:
    life = PeerLife("patient")
    _live(life, 0, 5_000)
    assert _look(life, 5_799, link_is_down=link_is_down) == []
    assert _look(life, 5_801, link_is_down=link_is_down) == [(event, 1_001)]
    assert _look(life, 6_600, link_is_down=link_is_down) == []
    life.hear(_beat(8_000), 8_000 * _MS)
    assert _look(life, 8_000) == [("back", 3_200)]


def test_a_better_reason_is_told_when_it_shows() -> None:
    life = PeerLife("patient")
    _live(life, 0, 5_000)
    assert _look(life, 6_000) == [("frozen", 1_200)]
    assert _look(life, 7_000, link_is_down=True) == [("link_down", 2_200)]
    assert _look(life, 7_200) == []


def test_netem_says_what_is_with_a_side_behind_it() -> None:
    life = PeerLife("patient", is_neighbour=False)
    _live(life, 0, 5_000)
    assert _look(life, 6_100, link_is_down=None, view="frozen") == []
    assert _look(life, 6_300, link_is_down=None, view="frozen") == [("frozen", 1_500)]


def test_a_pause_of_ones_own_is_nobodys_silence_and_no_step_of_a_clock() -> None:
    life = PeerLife("patient")
    _live(life, 0, 5_000)
    life.pause(3_000 * _MS, 8_000 * _MS)
    assert _look(life, 8_000) == []
    for at_ms in range(5_000, 8_000, 200):  # held up meanwhile, all at once
        life.hear(_beat(at_ms), 8_100 * _MS)
    assert _look(life, 8_200) == []
    assert _live(life, 8_200, 15_000) == []


def test_beats_that_a_broken_link_held_up_are_no_step_of_a_clock() -> None:
    life = PeerLife("patient")
    _live(life, 0, 5_000)
    _look(life, 6_000, link_is_down=True)
    for at_ms in range(5_000, 9_000, 200):
        life.hear(_beat(at_ms), 9_000 * _MS)
    assert _look(life, 9_000) == [("back", 4_200)]
    assert _live(life, 9_200, 20_000) == []


@pytest.mark.parametrize("step_ms", [10_000, -10_000])
def test_a_step_of_its_clock_is_told_once(step_ms: int) -> None:
    life = PeerLife("patient")
    _live(life, 0, 5_000)
    found = _live(life, 5_000, 10_000, step_ms)
    assert [(one.event, one.for_ns // _MS) for one in found] == [("clock_step", step_ms)]


def _events(life: PeerLife, n_forged: int, forged_ms: int) -> set[Event]:
    """Return what is told of a peer whose beats somebody forges, ``n_forged`` between two of its own."""
    _live(life, 0, 5_000)
    found = set[Event]()
    for at_ms in range(5_000, 15_000, 200):
        life.hear(_beat(at_ms), at_ms * _MS)
        for k in range(n_forged):
            life.hear(_beat(at_ms + forged_ms), (at_ms + 10 * (k + 1)) * _MS)
        found |= {change.event for change in life.look((at_ms + 150) * _MS, True, False, None)}
    return found


@pytest.mark.parametrize("n_forged", [1, 3, 12])
def test_forged_beats_among_its_own_are_told_and_no_step_of_its_clock(n_forged: int) -> None:
    assert _events(PeerLife("patient"), n_forged, 10_000) == {"foreign_beat"}


@pytest.mark.parametrize("n_forged", [1, 12])
def test_old_beats_sent_again_are_no_step_of_its_clock(n_forged: int) -> None:
    assert "clock_step" not in _events(PeerLife("patient"), n_forged, -4_000)


def test_a_single_forged_beat_blames_nobody() -> None:
    life = PeerLife("patient")
    _live(life, 0, 5_000)
    life.hear(_beat(50_000), 5_050 * _MS)
    assert _live(life, 5_200, 15_000) == []


def test_a_drift_and_a_late_beat_are_no_step() -> None:
    life = PeerLife("patient")
    found = []
    for at_ms in range(0, 100_000, 200):
        late_ms = 900 if at_ms % 5_000 == 0 else 0
        life.hear(_beat(at_ms + at_ms // 1000), (at_ms + late_ms) * _MS)
        found += life.look((at_ms + late_ms) * _MS, True, False, None)
    assert found == []


def test_a_loop_that_stays_in_one_step_is_told_with_the_step() -> None:
    life = PeerLife("patient")
    _live(life, 0, 5_000)
    found = []
    for at_ms in range(5_000, 9_000, 200):
        life.hear(_beat(at_ms, 5_000, "mine:Slow"), at_ms * _MS)
        found += life.look(at_ms * _MS, True, False, None)
    found += _live(life, 9_000, 12_000)
    assert [(one.event, one.for_ns // _MS, one.doing) for one in found] == [
        ("stalled", 1_200, "mine:Slow"),
        ("resumed", 4_000, ""),
    ]
    assert described(found[0], "surgeon") == (
        "patient does not tick: its loop has been in one step for 1.2 s, mine:Slow, at 6.2 s"
    )


def test_a_side_that_never_beats_is_silent_from_the_first_look() -> None:
    life = PeerLife("patient")
    assert _look(life, 0) == []
    assert _look(life, 900) == []
    assert _look(life, 1_100) == [("frozen", 1_100)]


def test_an_alarm_of_a_beat_is_told_once_with_when_it_began() -> None:
    life = PeerLife("patient")
    _live(life, 0, 1_000)
    for at_ms in (1_000, 1_200):
        life.hear(replace(_beat(at_ms), alarms={"conflict": 700 * _MS}), at_ms * _MS)
    assert life.look(1_200 * _MS, True, False, None) == [Change("patient", "conflict", 700 * _MS, 0)]
    life.hear(replace(_beat(1_400), alarms={"conflict": 900 * _MS}), 1_400 * _MS)
    assert life.look(1_400 * _MS, True, False, None) == []
    text = described(Change("patient", "conflict", 700 * _MS, 0), "surgeon")
    assert text.startswith("patient receives samples of the surgeon in two versions")
    assert text.endswith("at 0.7 s")


def test_no_beat_makes_a_note_that_no_log_can_hold() -> None:
    ends = (-(1 << 62), -(1 << 60), 0, 1 << 60, 1 << 62)
    life, changes = PeerLife("patient"), list[Change]()
    for k, (at_ns, loop_ns) in enumerate(product(ends, repeat=2)):
        payload = json.dumps({"side": "patient", "at_ns": at_ns, "loop_ns": loop_ns}).encode()
        for i in range(12):
            now_ns = (12 * k + i) * 200 * _MS
            try:
                life.hear(decode(payload, Beat), now_ns)
            except DecodeError:
                continue
            changes += life.look(now_ns, True, False, None)
    assert {"stalled", "clock_step"} <= {change.event for change in changes}
    assert max(abs(change.for_ns) for change in changes) <= MAX_NUMBER
