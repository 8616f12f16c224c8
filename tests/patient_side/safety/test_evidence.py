"""Evidence of forgery, by literal instants."""

from patient_side.safety.evidence import Evidence

MS = 1_000_000


def test_three_contradictions_within_a_second_are_evidence_until_a_second_has_passed() -> None:
    seen = Evidence()
    for at_ms in (0, 600, 1100):
        seen.note(at_ms * MS)
        assert not seen.holds(at_ms * MS)  # the first is more than a second ago by then
    assert seen.begun_ns is None
    seen.note(1300 * MS)
    assert seen.begun_ns == 1300 * MS
    assert seen.holds(1599 * MS)
    assert not seen.holds(1600 * MS)
    assert seen.n == 4


def test_what_began_stays_known_after_it_has_ended() -> None:
    seen = Evidence()
    for at_ms in (10, 20, 30, 9000, 9010, 9020):
        seen.note(at_ms * MS)
    assert seen.begun_ns == 30 * MS
    assert seen.holds(9020 * MS)


def test_a_flood_is_counted_and_ten_a_second_are_logged() -> None:
    seen = Evidence()
    logged = [at_ms for at_ms in range(3000) if seen.note(at_ms * MS)]
    assert seen.n == 3000
    assert len(logged) == 30
