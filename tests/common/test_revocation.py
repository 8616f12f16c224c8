"""The file of revoked certificates."""

from hypothesis import given
from hypothesis import strategies as st

from tis.common.refusal import MAX_BYTES, NONE_REVOKED, read_revoked

_NAMES = st.from_regex(r"[A-Za-z0-9_][A-Za-z0-9_.-]{0,63}", fullmatch=True)


@given(st.lists(st.tuples(_NAMES, st.none() | st.integers(0, 2**159))), st.sampled_from(["", "  # stolen", "\r"]))
def test_each_line_revokes_a_name_or_one_certificate_of_it(rows: list[tuple[str, int | None]], end: str) -> None:
    text = "".join(f"{name}{'' if serial is None else f' {serial:x}'}{end}\n" for name, serial in rows)
    found = read_revoked(f"# of this week\n\n{text}".encode())
    assert found.names == {name for name, _ in rows}
    assert found.serials == {(name, serial) for name, serial in rows if serial is not None}
    assert found.faults == ()


def test_a_certificate_is_revoked_by_its_number_and_a_name_without_one_whatever_its_certificate() -> None:
    found = read_revoked(b"operator\nsurgeon 1f\n")
    assert found.covers("operator", 5)
    assert found.covers("surgeon", 31)
    assert not found.covers("surgeon", 32)
    assert not found.covers("patient", 31)
    assert not NONE_REVOKED.covers("surgeon", 31)


def test_a_line_that_is_none_is_told_and_the_others_count() -> None:
    found = read_revoked(b"operator\n\xff\xfe\n-x\nsurgeon 0x1f\nwatcher\n")
    assert found.names == {"operator", "watcher"}
    assert [text[:6] for text in found.faults] == ["line 2", "line 3", "line 4"]
    assert len(read_revoked(b"-\n" * 1000).faults) == 10
    assert "at most" in read_revoked(b" " * MAX_BYTES + b"x").faults[0]
