"""Evidence of forgery, by literal instants."""

from tis.patient_side.safety.gated_intake import Evidence

MS = 1_000_000


def _noted(*at_ms: int) -> Evidence:
    seen = Evidence()
    for one in at_ms:
        seen.note(one * MS)
    return seen


def test_three_contradictions_within_a_second_are_evidence_for_a_second() -> None:
    assert not _noted(0, 600, 1100).holds(1100 * MS)  # the first was more than a second ago
    assert _noted(0, 600, 1100).begun_ns is None
    seen = _noted(0, 600, 1100, 1300)
    assert seen.begun_ns == 1300 * MS
    assert seen.holds(2299 * MS)
    assert not seen.holds(2300 * MS)
    assert seen.n == 4


def test_each_further_contradiction_prolongs_it() -> None:
    seen = _noted(0, 450, 900, 1800, 2700)
    assert seen.holds(3699 * MS)
    assert not seen.holds(3700 * MS)


def test_what_began_stays_known_after_it_has_ended() -> None:
    seen = _noted(10, 20, 30, 9000, 9010, 9020)
    assert seen.begun_ns == 30 * MS
    assert seen.holds(9020 * MS)


def test_a_flood_is_counted_and_ten_a_second_are_logged() -> None:
    seen = Evidence()
    assert sum(seen.is_to_be_logged(at_ms * MS) for at_ms in range(3000)) == 30
